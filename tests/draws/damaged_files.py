"""Damage flow files on purpose, as a broken disk, a broken transfer or another program would.

Whatever the damage, a file must be read as a density field of a gas, or refused with one line.
"""

import random
import shutil
from pathlib import Path

import numpy as np
from numpy.random import Generator

from aerokernels.flow import DensityField, read
from aerokernels.process.fragile import LibraryEndedError


def damage(data: bytes, generator: Generator) -> bytes:
    """Damage a file's bytes in one of ten ways."""
    way = int(generator.integers(10))
    size = len(data)
    at, length = int(generator.integers(size)), int(generator.integers(1, max(2, size // 4)))
    if way == 0:
        return data[:at]
    if way == 1:
        return data[:at] + data[at + length :]
    if way == 2:
        return data[:at] + data[at : at + length] + data[at:]
    if way == 3:  # text in place of numbers, or the reverse
        return data[:at] + b"not a number " * 3 + data[at + 39 :]
    if way == 4:
        return data[:at] + bytes(generator.integers(0, 256, 8, dtype=np.uint8)) + data[at + 8 :]
    if way == 5:  # the byte order of a part
        part = data[at // 8 * 8 : at // 8 * 8 + length // 8 * 8 + 8]
        part = part[: len(part) // 8 * 8]
        swapped = np.frombuffer(part, "<u8").byteswap().tobytes()
        return data[: at // 8 * 8] + swapped + data[at // 8 * 8 + len(part) :]
    if way == 6:
        wild = generator.choice(np.array([np.nan, np.inf, -1.0, 1e300, 0.0]))
        return data[: at // 8 * 8] + np.float64(wild).tobytes() + data[at // 8 * 8 + 8 :]
    if way == 7:  # a digit of a count or of a number
        digits = [k for k, byte in enumerate(data) if 48 <= byte <= 57]
        if not digits:
            return data[:at]
        place = digits[int(generator.integers(len(digits)))]
        return data[:place] + generator.choice(np.array([b"9", b"-", b"0", b"999999999", b"e"])) + data[place + 1 :]
    if way == 8:
        return data + data[at : at + length]
    wild = int(generator.choice(np.array([-1, 0, 2**31 - 1, -(2**31), 65536])))
    return data[: at // 4 * 4] + np.int32(wild).tobytes() + data[at // 4 * 4 + 4 :]


def damaged(data: bytes, draw: random.Random) -> bytes:
    """Damage data that may be empty, using another generator."""
    return damage(data, np.random.default_rng(draw.randrange(2**32))) if data else data


def outcome_of(path: Path) -> str:
    """Return what happened to a file: "read", "refused", or "ended" if the library that reads it ended its process.

    Any other exception is passed on to the caller.
    """
    try:
        flow = read(path)
    except ValueError as fault:
        assert str(fault) and "\n" not in str(fault), repr(fault)
        return "ended" if isinstance(fault.__cause__, LibraryEndedError) else "refused"
    assert isinstance(flow, DensityField)
    density = np.asarray(flow.density)  # type: ignore[attr-defined]  # every field that is read has samples
    assert np.isfinite(density).all() and (density > 0.0).all()
    return "read"


class DamagedCopies:
    """Copies of a valid file or case, in which each seed damages one file: its bytes, or the contents of HDF5.

    Args:
        path: The file, or the case's folder.
        sound: The folder with all that belongs to it.
        copy: Where the copies are made; must not exist yet.

    Raises:
        ValueError: The original cannot be read.
    """

    def __init__(self, path: Path, sound: Path, copy: Path):
        """Copy the valid files."""
        if outcome_of(path) != "read":
            raise ValueError(f"{path} is not sound")
        self._contents = {file: file.read_bytes() for file in sorted(sound.rglob("*")) if file.is_file()}
        self._sound, self._copy, self._damaged = sound, copy, copy / path.relative_to(sound)
        shutil.copytree(sound, copy)

    def outcome(self, seed: int) -> str:
        """Outcome of reading the copy damaged by a seed, as returned by `outcome_of`."""
        generator = np.random.default_rng(seed)
        chosen, content = list(self._contents.items())[int(generator.integers(len(self._contents)))]
        place = self._copy / chosen.relative_to(self._sound)
        place.write_bytes(damage(content, generator))
        try:
            return outcome_of(self._damaged)
        except BaseException as fault:
            fault.add_note(f"seed {seed}, {chosen.name}")
            raise
        finally:
            place.write_bytes(content)
