"""The one rule for files that another file names: regular files in its own folder, after resolving links.

A file from elsewhere may name any file of its reader: its bytes would become densities, and a pipe would never end.
Pieces that a list of VTK names may be in folders below its own. HDF5 follows links and virtual data sets to HDF5 files
beside the file; raw data outside of it (external storage) have no format that tells what they are, and are refused.
Files that a caller names are the caller's.
"""

import os
import stat
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from .fault_text import FileFault

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
# Files of VTK that name their pieces, and those that list files with their times.
OF_PIECES = (".pvti", ".pvtr", ".pvts", ".pvtu", ".vtm", ".vtmb", ".vtpd", ".vtpc", ".vth", ".vthb")
LISTS = (".pvd", ".series", *OF_PIECES)
SHOWN = 200  # characters of a name in a message


class OwnFilesError(FileFault):
    """A file names another one that it may not; the message gives both and the remedy."""


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
    file = within / name
    # VTK expands ~ and takes a backslash for a slash.
    odd = "\0" in name or "\\" in name or name.startswith("~")
    folder = Path(os.path.realpath(within))
    place = folder if odd else Path(os.path.realpath(file))
    if not (place.parent == folder if beside else folder in place.parents):
        where = "not beside it" if beside else "outside of its own folder"
        raise OwnFilesError(
            f"{holder}: it names {name[:SHOWN]!r}, which is {where}: files may not open others there: move them "
            "together"
        )
    if os.path.exists(place) and not os.path.isfile(place):
        raise OwnFilesError(
            f"{holder}: it names {name[:SHOWN]!r}, which is not a regular file: put the file itself there"
        )
    return file


def check_own_files(path: Path) -> None:
    """Check the files that a file names, and those that these name.

    Raises:
        OwnFilesError: As `own_file`; or a list of files, or an HDF5 file, that cannot be looked through.
    """
    waiting, seen = [path], {path}
    while waiting:
        file = waiting.pop()
        own = [other for other in (*pieces(file), *_linked(file)) if other not in seen]
        seen |= set(own)
        waiting += own


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
    found = [own_file(path, name) for name in dict.fromkeys(names)]
    if (lost := next((file for file in found if not os.path.exists(file)), None)) is not None:
        raise OwnFilesError(f"{path}: it names {str(lost)[:SHOWN]!r}, which is not there: restore it")
    return found


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
            made = entry.id.get_create_plist()
            if made.get_external_count():
                name = str(entry.name)[:SHOWN]
                raise OwnFilesError(
                    f"{path}: the data of {name!r} are outside of it, in other files: write them into it"
                )
            if made.get_layout() == h5py.h5d.VIRTUAL:
                names.update(dict.fromkeys(made.get_virtual_filename(k) for k in range(made.get_virtual_count())))

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
    found = [own_file(path, name, beside=True) for name in names if name != "."]
    if (lost := next((file for file in found if not os.path.exists(file)), None)) is not None:
        raise OwnFilesError(f"{path}: it names {lost.name[:SHOWN]!r}, which is not beside it: restore it")
    return found
