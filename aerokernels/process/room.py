"""Check that the arrays a file announces fit in memory before allocating them.

A damaged or hostile file of a few bytes may announce terabytes. The system grants such an allocation and ends the
process when the memory is written to, so the size is compared with the free memory first.
"""

from contextlib import suppress
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from .fault_text import FileFault
from .machine import free_memory

SHARE = 0.5  # fraction of the free memory that one reading may take


class NoRoomError(FileFault):
    """The arrays that a file announces do not fit in memory."""


def check_room(size: float, what: str) -> None:
    """Check that data fit in memory.

    Args:
        size: Size of the data [bytes].
        what: The data and their place, in words: begins the message.

    Raises:
        NoRoomError: The data take more than half of the free memory.
    """
    room = SHARE * free_memory()
    if size > room:
        raise NoRoomError(
            f"{what} announces {_text(size)} and there is memory for {_text(room)}: the file is damaged, or must be "
            "cut to the part that is needed"
        )


def check_file(path: Path, what: str, most_axes: float = float("inf")) -> None:
    """Check that the arrays of an HDF5 file or a Zarr store fit in memory together, without reading them.

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
