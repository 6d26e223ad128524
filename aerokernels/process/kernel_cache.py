"""Folders of compiled kernels: a temporary one where the usual one cannot take them, and none with damaged files.

A crash or a full disk leaves files empty or cut short, which neither Warp nor PoCL notices before it loads them.
"""

import atexit
import json
import os
import re
import shutil
import stat
import struct
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

LEAST_SPACE = 8 << 20  # [bytes] needed to build kernels; compilers may end the process if they cannot write them
ELF = b"\x7fELF"
BEING_MADE = re.compile(r"_p\d+_t\d+$")  # folder in which a process is compiling; it is renamed at the end


class NoCacheError(OSError):
    """No folder takes compiled kernels; the message says why and what to do."""


def why_unusable(folder: Path) -> str:
    """Return why no kernels can be built in a folder, which is made if missing; empty if they can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return f"{folder} cannot be written ({error.strerror or type(error).__name__})"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"{folder} cannot be written (no right to write)"
    return f"the disk of {folder} is full" if _free_space(folder) < LEAST_SPACE else ""


def why_untrusted(folder: Path) -> str:
    """Return why another user could have put code into a folder; empty if none could.

    It, its links and the folders that contain it belong to this user or to root; others may write in none of them, but
    in those above it that keep each user's files from the others, as /tmp does.
    """
    if not hasattr(os, "geteuid"):  # Windows gives each user folders of his own
        return ""
    trusted = {os.geteuid(), 0, os.stat("/").st_uid}
    whole, real = Path(os.path.abspath(folder)), Path(os.path.realpath(folder))
    for place in dict.fromkeys((real, *real.parents, whole, *whole.parents)):
        try:
            state = os.lstat(place)
        except OSError as error:
            return f"{place} cannot be examined ({error.strerror or type(error).__name__})"
        if state.st_uid not in trusted:
            return f"{place} belongs to another user"
        others = stat.S_IWOTH | (stat.S_IWGRP if place == real and state.st_gid != os.getegid() else 0)
        if state.st_mode & others and not stat.S_ISLNK(state.st_mode):
            if place == real or not state.st_mode & stat.S_ISVTX:
                return f"{place} may be written by other users"
    return ""


def spare_cache(engine: str, why: str) -> str:
    """Make a new temporary folder, removed when the process ends, warn by a RuntimeWarning, and return its path.

    Args:
        engine: The engine that builds the kernels.
        why: Why the usual folder is not used.

    Raises:
        NoCacheError: The folder for temporary files cannot take kernels.
    """
    try:
        temporary = Path(tempfile.gettempdir())
        reason = why_unusable(temporary)
    except FileNotFoundError:
        reason = "there is no folder for temporary files"
    if reason:
        raise NoCacheError(
            f"{why}; {reason}: no folder takes the kernels that {engine} builds; set TMPDIR to a folder that can be "
            f"written and has {LEAST_SPACE >> 20} MiB of space"
        )
    place = tempfile.mkdtemp(prefix=f"aerokernels-{engine}-", dir=temporary)
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    warnings.warn(f"{why}: kernels are built in {place} for this process", RuntimeWarning, stacklevel=2)
    return place


def _free_space(folder: Path) -> float:
    """Return the free space in a folder [bytes]; infinite if unknown."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return float("inf")


def remove_damaged(cache: Path) -> list[Path]:
    """Remove the modules of Warp's cache that have an empty file, code that is cut, or a description that is not JSON.

    Returns:
        The folders that were removed.
    """
    removed = []
    with suppress(OSError):  # no cache yet, or another process is removing modules too
        for folder in _modules(cache):
            if not all(map(_is_sound, folder.iterdir())):
                shutil.rmtree(folder, ignore_errors=True)
                removed.append(folder)
    return removed


def lend_modules(cache: Path, place: Path) -> None:
    """Link the modules of a cache of Warp's that takes no files into a new one, so that only others are compiled."""
    with suppress(OSError, NotImplementedError):  # not on this system: all are compiled
        for folder in _modules(cache):
            (place / folder.name).mkdir()
            for file in folder.iterdir():
                (place / folder.name / file.name).symlink_to(file)


def _modules(cache: Path) -> list[Path]:
    return [folder for folder in cache.glob("wp_*") if folder.is_dir() and not BEING_MADE.search(folder.name)]


def _is_sound(file: Path) -> bool:
    """Whether a file of a module is complete."""
    size = file.stat().st_size
    if size and file.suffix == ".o":
        with open(file, "rb") as code:
            return code.read(len(ELF)) != ELF or is_whole(code, size)  # other systems have other formats
    try:
        return bool(size) and (file.suffix != ".meta" or isinstance(json.loads(file.read_bytes()), dict))
    except (ValueError, RecursionError):
        return False


def is_whole(file: BinaryIO, size: int) -> bool:
    """Whether a file of bitcode or a library, `size` bytes long, is complete according to its own headers."""
    try:
        head = _read(file, 0, 64) if size >= 64 else b""
        if head[:4] == b"BC\xc0\xde":
            return _is_whole_bitcode(file, size)
        return head[:5] == ELF + b"\x02" and _is_whole_elf(file, head, size)
    except struct.error:
        return False


def _is_whole_bitcode(file: BinaryIO, size: int) -> bool:
    """Whether blocks fill the file: each has an opening word (LLVM: abbreviation 1, of two bits) and a length."""
    place = 4
    while place < size:
        opening, words = struct.unpack("<II", _read(file, place, 8))
        if opening & 3 != 1:
            return False
        place += 8 + 4 * words
    return place == size


def _is_whole_elf(file: BinaryIO, head: bytes, size: int) -> bool:
    """Whether the table of sections, which a linker writes last, and the names of the sections are within the file."""
    (start,) = struct.unpack_from("<Q", head, 40)
    width, count, names = struct.unpack_from("<HHH", head, 58)
    if not start or not count or start + width * count > size:
        return False
    kind, _, _, offset, length = struct.unpack("<IQQQQ", _read(file, start + width * names + 4, 36))
    return kind == 3 and offset + length <= size


def _read(file: BinaryIO, place: int, count: int) -> bytes:
    file.seek(place)
    return file.read(count)
