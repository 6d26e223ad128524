"""Rules for files from elsewhere: which other files they may name, and how much memory they may ask for.

A list of VTK's pieces and the like may name regular files in its own folder and those below, after resolving links: no
other file's bytes become densities, nor does a pipe that never ends. A damaged file of a few bytes may announce
terabytes: the system grants them, and ends the process when they are written to.
"""

import os
from contextlib import suppress
from math import prod
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from aerokernels.process.machine import free_memory

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
# Files of VTK that name their pieces, and those that list files with their times.
OF_PIECES = (".pvti", ".pvtr", ".pvts", ".pvtu", ".vtm", ".vtmb", ".vtpd", ".vtpc", ".vth", ".vthb")
LISTS = (".pvd", ".series", *OF_PIECES)


class FileFault(ValueError):
    """A file that cannot be used; the message names it, so that callers add nothing."""


class NoRoomError(FileFault):
    """The arrays that a file announces do not fit in memory."""


class OwnFilesError(FileFault):
    """A file names another one that it may not; the message gives both and the remedy."""


def fault_text(fault: BaseException, most: int | None = 200) -> str:
    """Return the class and the message of an error on one line; `most` characters of the message, None for all."""
    return " ".join(f"{type(fault).__name__}: {str(fault)[:most]}".split())


def check_room(size: float, what: str) -> None:
    """Raise a NoRoomError unless data of `size` bytes fit in half of the free memory; `what` begins the message."""
    room = 0.5 * free_memory()
    if size > room:
        raise NoRoomError(
            f"{what} announces {_text(size)} and there is memory for {_text(room)}: the file is damaged, or must be "
            "cut to the part that is needed"
        )


def check_file(path: Path, what: str, most_axes: float = float("inf")) -> None:
    """Check as `check_room` the arrays of an HDF5 file or a Zarr store together, without reading them.

    Arrays of more than `most_axes` axes do not count: 1 for those that xarray reads when it opens a file. A file that
    cannot be opened is left to its reader.
    """
    sizes: list[float] = []

    def take(_: str, entry: Any) -> None:
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


def own_file(holder: Path, name: str) -> Path:
    """Return the path of a file that another file, or one in the folder `holder`, names; it may be missing.

    Raises an OwnFilesError if it is not in the folder of `holder` or below, or is not a regular file.
    """
    within = holder if os.path.isdir(holder) else holder.parent
    # VTK expands ~ and takes a backslash for a slash.
    odd = "\0" in name or "\\" in name or name.startswith("~")
    folder = Path(os.path.realpath(within))
    place = folder if odd else Path(os.path.realpath(within / name))
    if folder not in place.parents:
        remedy = "files may not open others there: move them together"
        raise OwnFilesError(f"{holder}: it names {name[:200]!r}, which is outside of its own folder: {remedy}")
    if os.path.exists(place) and not os.path.isfile(place):
        what = "which is not a regular file: put the file itself there"
        raise OwnFilesError(f"{holder}: it names {name[:200]!r}, {what}")
    return within / name


def check_own_files(path: Path) -> None:
    """Check as `own_file` the pieces that a file of VTK names, and those that these name."""
    waiting, seen = [path], {path}
    while waiting:
        others = [other for other in pieces(waiting.pop()) if other not in seen]
        seen |= set(others)
        waiting += others


def pieces(path: Path) -> list[Path]:
    """Return the pieces that a file of VTK names, none for other files; raises an OwnFilesError also for a lost one."""
    if path.suffix.lower() not in OF_PIECES:
        return []
    try:
        entries = [entry.attrib for entry in ElementTree.parse(path).iter()]
    except (ElementTree.ParseError, LookupError, ValueError, OSError) as fault:
        raise OwnFilesError(f"{path}: it is not a list of data sets ({fault}): write it again") from None
    names = [entry[key] for entry in entries for key in ("Source", "file") if entry.get(key)]
    files = [own_file(path, name) for name in dict.fromkeys(names)]
    if lost := next((file for file in files if not os.path.exists(file)), None):
        raise OwnFilesError(f"{path}: it names {str(lost)[:200]!r}, which is not there: restore it")
    return files
