"""Rules for files from elsewhere: which other files they may name, and how much memory they may ask for.

A file may name any file of its reader, whose bytes would become densities, or a pipe that never ends. It may name
regular files in its own folder, after resolving links; a list of VTK's pieces also those in folders below. HDF5 follows
links and virtual data sets to HDF5 files beside the file; raw data outside of it (external storage) have no format that
tells what they are, and are refused. Files that a caller names are the caller's.

A damaged or hostile file of a few bytes may announce terabytes. The system grants such an allocation and ends the
process when the memory is written to, so the size is compared with the free memory first.
"""

import os
import stat
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
SHOWN = 200  # characters of a name in a message


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
    """Check that data of `size` bytes fit in half of the free memory; `what` begins the message.

    Raises:
        NoRoomError: They do not.
    """
    room = 0.5 * free_memory()
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


def own_file(holder: Path, name: str, *, beside: bool = False) -> Path:
    """Return the path of a file that another file names; it may be missing.

    Args:
        holder: The file that names it, or the folder that holds it.
        name: Its name, absolute or relative to the folder of `holder`.
        beside: Whether folders below that of `holder` are refused too.

    Raises:
        OwnFilesError: It is not in the folder of `holder`, or it is not a regular file.
    """
    within = holder if os.path.isdir(holder) else holder.parent
    # VTK expands ~ and takes a backslash for a slash.
    odd = "\0" in name or "\\" in name or name.startswith("~")
    folder = Path(os.path.realpath(within))
    place = folder if odd else Path(os.path.realpath(within / name))
    if not (place.parent == folder if beside else folder in place.parents):
        where = "not beside it" if beside else "outside of its own folder"
        remedy = "files may not open others there: move them together"
        raise OwnFilesError(f"{holder}: it names {name[:SHOWN]!r}, which is {where}: {remedy}")
    if os.path.exists(place) and not os.path.isfile(place):
        what = "which is not a regular file: put the file itself there"
        raise OwnFilesError(f"{holder}: it names {name[:SHOWN]!r}, {what}")
    return within / name


def check_own_files(path: Path) -> None:
    """Check the files that a file names, and those that these name.

    Raises:
        OwnFilesError: As `own_file`; or a list of files, or an HDF5 file, that cannot be looked through.
    """
    waiting, seen = [path], {path}
    while waiting:
        file = waiting.pop()
        others = [other for other in (*pieces(file), *_linked(file)) if other not in seen]
        seen |= set(others)
        waiting += others


def check_folder(path: Path) -> None:
    """Check that links in a folder lead to regular files in it.

    Raises:
        OwnFilesError: As `own_file`.
    """
    for folder, below, files in os.walk(path):
        for one in (os.path.join(folder, name) for name in (*below, *files)):
            mode = os.lstat(one).st_mode
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                own_file(path, os.path.relpath(one, path))


def pieces(path: Path) -> list[Path]:
    """Return the pieces that a file of VTK names; none for other files. Errors as in `check_own_files`."""
    if path.suffix.lower() not in OF_PIECES:
        return []
    try:
        entries = [entry.attrib for entry in ElementTree.parse(path).iter()]
    except (ElementTree.ParseError, LookupError, ValueError, OSError) as fault:
        raise OwnFilesError(f"{path}: it is not a list of data sets ({fault}): write it again") from None
    names = [entry[key] for entry in entries for key in ("Source", "file") if entry.get(key)]
    return _present(path, [own_file(path, name) for name in dict.fromkeys(names)], "there")


def _linked(path: Path) -> list[Path]:
    """Return the files that an HDF5 file names; none for other files."""
    try:
        with path.open("rb") as stream:
            if stream.read(len(HDF5_MAGIC)) != HDF5_MAGIC:
                return []
    except OSError:  # which its reader says
        return []
    import h5py

    names: dict[str, None] = {}

    def look(_: str, entry: Any) -> None:
        if isinstance(entry, h5py.Group):
            links = (entry.get(key, getlink=True) for key in entry)
            names.update(dict.fromkeys(link.filename for link in links if isinstance(link, h5py.ExternalLink)))
        elif isinstance(entry, h5py.Dataset):
            layout = entry.id.get_create_plist()
            if layout.get_external_count():
                name = str(entry.name)[:SHOWN]
                raise OwnFilesError(
                    f"{path}: the data of {name!r} are outside of it, in other files: write them into it"
                )
            if layout.get_layout() == h5py.h5d.VIRTUAL:
                names.update(dict.fromkeys(layout.get_virtual_filename(k) for k in range(layout.get_virtual_count())))

    try:
        file = h5py.File(path, "r")
    except Exception:  # h5py raises any error for a damaged file, and its reader says so
        return []
    with file:
        try:
            look("/", file)
            file.visititems(look)
        except OwnFilesError:
            raise
        except Exception as fault:
            raise OwnFilesError(f"{path}: HDF5 cannot look through it ({str(fault)[:SHOWN]}): write it again") from None
    return _present(path, [own_file(path, name, beside=True) for name in names if name != "."], "beside it")


def _present(path: Path, others: list[Path], where: str) -> list[Path]:
    """Return the files that a file names, after checking that all are there."""
    if lost := next((file for file in others if not os.path.exists(file)), None):
        raise OwnFilesError(f"{path}: it names {str(lost)[:SHOWN]!r}, which is not {where}: restore it")
    return others
