"""Damaging flow files on purpose: what a broken disk, a broken transfer or another program leaves of them.

Whatever the damage, a file is read as a density field of a gas, or refused with one line: nothing else may happen.
"""

import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.random import Generator

from ..flow import DensityField, read


def damage(data: bytes, random: Generator) -> bytes:
    """One of many ways to spoil a file."""
    way = int(random.integers(10))
    size = len(data)
    at, length = int(random.integers(size)), int(random.integers(1, max(2, size // 4)))
    if way == 0:
        return data[:at]
    if way == 1:
        return data[:at] + data[at + length :]
    if way == 2:
        return data[:at] + data[at : at + length] + data[at:]
    if way == 3:  # a text where numbers were, or the reverse
        return data[:at] + b"not a number " * 3 + data[at + 39 :]
    if way == 4:
        return data[:at] + bytes(random.integers(0, 256, 8, dtype=np.uint8)) + data[at + 8 :]
    if way == 5:  # the byte order of a part
        part = data[at // 8 * 8 : at // 8 * 8 + length // 8 * 8 + 8]
        part = part[: len(part) // 8 * 8]
        swapped = np.frombuffer(part, "<u8").byteswap().tobytes()
        return data[: at // 8 * 8] + swapped + data[at // 8 * 8 + len(part) :]
    if way == 6:
        wild = random.choice(np.array([np.nan, np.inf, -1.0, 1e300, 0.0]))
        return data[: at // 8 * 8] + np.float64(wild).tobytes() + data[at // 8 * 8 + 8 :]
    if way == 7:  # a digit of a count or of a number
        digits = [k for k, byte in enumerate(data) if 48 <= byte <= 57]
        if not digits:
            return data[:at]
        place = digits[int(random.integers(len(digits)))]
        return data[:place] + random.choice(np.array([b"9", b"-", b"0", b"999999999", b"e"])) + data[place + 1 :]
    if way == 8:
        return data + data[at : at + length]
    wild = int(random.choice(np.array([-1, 0, 2**31 - 1, -(2**31), 65536])))
    return data[: at // 4 * 4] + np.int32(wild).tobytes() + data[at // 4 * 4 + 4 :]


def outcome_of(path: Path) -> str:
    """Whether it was "read" or "refused"; whatever else happens, happens to the caller."""
    try:
        flow = read(path)
    except ValueError as fault:
        assert str(fault) and "\n" not in str(fault), repr(fault)
        return "refused"
    assert isinstance(flow, DensityField)
    density = np.asarray(flow.density)  # type: ignore[attr-defined]  # every field that is read has samples
    assert np.isfinite(density).all() and (density > 0.0).all()
    return "read"


def damaged_copies(path: Path, sound: Path, copy: Path, seeds: Iterable[int]) -> Iterator[str]:
    """The outcomes of damaged copies of a sound file or case, one for each seed.

    Args:
        path: The file, or the case's folder.
        sound: The folder with all that belongs to it; one of its files is damaged each time.
        copy: Where the copies are made.
        seeds: What tells one damage from another.
    """
    if outcome_of(path) != "read":
        raise ValueError(f"{path} is not sound")
    files = sorted(file for file in sound.rglob("*") if file.is_file())
    contents = {file: file.read_bytes() for file in files}
    shutil.copytree(sound, copy)
    for seed in seeds:
        random = np.random.default_rng(seed)
        chosen = files[int(random.integers(len(files)))]
        damaged = copy / chosen.relative_to(sound)
        damaged.write_bytes(damage(contents[chosen], random))
        try:
            yield outcome_of(copy / path.relative_to(sound))
        except BaseException as fault:
            fault.add_note(f"seed {seed}, {chosen.name}")
            raise
        damaged.write_bytes(contents[chosen])
