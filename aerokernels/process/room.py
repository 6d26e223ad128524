"""Whether there is room in memory for what a file announces, asked before it is allocated.

A damaged or hostile file of some bytes may announce terabytes. Left to the allocation, the system grants what it cannot
give and ends the process when it is written to; so a size is held against the memory first.
"""

from contextlib import suppress
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from .machine import free_memory

SHARE = 0.5  # of the memory that is free, which one reading may take


class NoRoomError(ValueError):
    """What a file announces does not go into memory."""


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


def check_file(path: Path, what: str, most_axes: float = float("inf")) -> None:
    """Refuse an HDF5 file, or a Zarr store, whose arrays do not go into memory together; none is read for that.

    Args:
        path: The file; one that cannot be opened is left to its reader.
        what: Begins the message.
        most_axes: Arrays of more axes do not count: 1 for those that xarray reads when it opens a file.

    Raises:
        NoRoomError: As `check_room`.
    """
    sizes: list[float] = []

    def take(name: str, entry: Any) -> None:
        shape = getattr(entry, "shape", None)
        if shape is not None and len(shape) <= most_axes:
            sizes.append(prod(map(float, shape)) * np.dtype(entry.dtype).itemsize)

    with suppress(OSError, ValueError, RuntimeError, LookupError, TypeError):
        if path.is_dir():
            import zarr

            for name, entry in zarr.open_group(str(path), mode="r").arrays():
                take(name, entry)
        else:
            import h5py

            with h5py.File(path, "r") as file:
                file.visititems(take)
    check_room(sum(sizes), what)


def _text(size: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1e3:
            return f"{size:.3g} {unit}"
        size /= 1e3
    return f"{size:.4g} TB"
