"""Start Warp once, without output, and with a folder of compiled kernels that takes them and holds no damaged files.

AEROKERNELS_WARP_FLAGS, if set, replaces Warp's compiler flags on the CPU. With "-march=native" alone kernels compile in
two thirds of the time, give the same bits, and run 15 to 45 % slower: useful if little is traced.
A crash or a full disk leaves files empty or cut short, which neither Warp nor PoCL notices before it loads them.
"""

import atexit
import json
import os
import re
import shutil
import struct
import sys
import tempfile
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from .opened import OPENED


def start_warp() -> None:
    """Start Warp without its banner; raises NoCacheError where no folder takes the kernels that Warp builds."""
    OPENED.once("Warp", _start)


def open_device(name: str) -> Any:
    """Start Warp, and return its device of this name after one thread has made its context and streams.

    Warp makes them when they are first asked for, without a lock: threads that ask at the same time each make their
    own, and destroy streams on which others have launched. Raises a ValueError if the device does not exist.
    """
    import warp as wp

    start_warp()
    device = wp.get_device(name)
    OPENED.once(("context", device.alias), lambda: device.context)
    return device


def _start() -> None:
    import warp as wp

    wp.config.quiet = True
    wp.config.log_level = wp.LOG_WARNING
    if flags := os.environ.get("AEROKERNELS_WARP_FLAGS"):
        wp.config.cpu_compiler_flags = flags
    try:
        _silently(wp.init)
        why = why_unusable(Path(wp.config.kernel_cache_dir))
    except OSError as error:
        why = f"Warp's kernel cache cannot be made ({error})"
    if why:
        wp.config.kernel_cache_dir = spare_cache("warp", why)
        _silently(wp.init)
    remove_damaged(Path(wp.config.kernel_cache_dir))


def _silently(call: Callable[[], None]) -> None:
    """Call a function with the output of native code to stderr suppressed."""
    try:
        spoken = os.dup(2)
    except OSError:  # stderr is closed: nothing can be heard
        call()
        return
    if sys.stderr is not None:
        sys.stderr.flush()
    silent = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silent, 2)
        call()
    finally:
        os.dup2(spoken, 2)
        os.close(silent)
        os.close(spoken)


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
    with suppress(OSError):  # unknown
        if shutil.disk_usage(folder).free < LEAST_SPACE:
            return f"the disk of {folder} is full"
    return ""


def spare_cache(engine: str, why: str) -> str:
    """Make a temporary folder for the kernels of an engine until the process ends, and warn why; return its path.

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


def remove_damaged(cache: Path) -> list[Path]:
    """Remove modules of Warp's cache with an empty file, cut code, or a description that is not JSON; return them."""
    removed = []
    with suppress(OSError):  # no cache yet, or another process is removing modules too
        for folder in cache.glob("wp_*"):
            if folder.is_dir() and not BEING_MADE.search(folder.name) and not all(map(_is_sound, folder.iterdir())):
                shutil.rmtree(folder, ignore_errors=True)
                removed.append(folder)
    return removed


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
