"""Check by their own headers whether files of compiled code are complete: a crash or a full disk cuts them short."""

import struct
from typing import BinaryIO

BITCODE, ELF = b"BC\xc0\xde", b"\x7fELF"


def is_whole(file: BinaryIO, size: int) -> bool:
    """Whether a file of bitcode or a library, `size` bytes long, is complete according to its own headers."""
    try:
        head = _read(file, 0, 64) if size >= 64 else b""
        if head[:4] == BITCODE:
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
