"""Whether there is room in memory for what a file announces, asked before it is allocated.

A damaged or hostile file of some bytes may announce terabytes. Left to the allocation, the system grants what it cannot
give and ends the process when it is written to; so a size is held against the memory first.
"""

import os
from math import prod
from typing import Any

SHARE = 0.5  # of the memory that is free, which one reading may take


class NoRoomError(ValueError):
    """What a file announces does not go into memory."""


def free_memory() -> float:
    """Memory that can be had without ending other processes [bytes]; infinite where the system does not say."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return 1024.0 * int(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (ValueError, OSError, AttributeError):
        return float("inf")


def check_room(size: float, what: str) -> None:
    """Refuse what does not go into memory.

    Args:
        size: Of it [bytes].
        what: What it is, with its place: begins the message.

    Raises:
        NoRoomError: It takes more than half of the memory that is free.
    """
    room = SHARE * free_memory()
    if size > room:
        raise NoRoomError(
            f"{what} announces {_text(size)} and there is room for {_text(room)}: the file is damaged, or is to be "
            "cut down to the part that is needed"
        )


def check_arrays(arrays: Any, what: str) -> None:
    """Refuse a dataset of xarray whose arrays do not go into memory together; nothing of it is read for that.

    Raises:
        NoRoomError: As `check_room`.
    """
    check_room(sum(prod(array.shape) * array.dtype.itemsize for array in arrays.variables.values()), what)


def _text(size: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1e3:
            return f"{size:.3g} {unit}"
        size /= 1e3
    return f"{size:.4g} TB"
