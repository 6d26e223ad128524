"""The files that are read when a path is: those of a case, the pieces that a file names, a mesh and its solution.

A result that is kept for a path belongs to the contents of all of them.
"""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from aerokernels.process.foreign_files import OwnFilesError, pieces

from .dataset import ReadError
from .formats import format_of
from .readers.vtk_collections import SUFFIXES, collection


def files_behind(path: Path, options: Mapping[str, Any] | None = None, time: float | None = None) -> list[Path]:
    """Return the files that reading a path opens, in an order that does not depend on the file system.

    Args:
        path: File or folder. Of a path that cannot be read, itself and the files in it are returned.
        options: Options of single formats, as in `formats.load`.
        time: The time that is read [s]; None returns the files of all times.
    """
    options = {name: value for name, value in (options or {}).items() if value is not None}
    try:
        found = _files(path, format_of(path, options).module, options, time)
    except (OSError, ReadError, OwnFilesError):
        found = [path]
    return list(dict.fromkeys(file for one in found for file in _within(one)))


def stamp(files: Iterable[Path]) -> str:
    """Return a hash of the names, the sizes and the times of change of files; it takes no look into them."""
    found = hashlib.sha256()
    for file in files:
        try:
            about = file.stat()
            written = f"{about.st_size} {about.st_mtime_ns}"
        except OSError:  # a file that is gone, which its reader says
            written = ""
        found.update(f"{file.name} {written}\n".encode(errors="surrogateescape"))
    return found.hexdigest()[:16]


def _within(path: Path) -> list[Path]:
    return sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]


def _files(path: Path, module: str, options: dict[str, Any], time: float | None) -> list[Path]:
    """Return the files and folders that a reader opens."""
    if module == "foam_case":
        from .readers.foam_case import case_folder, case_times

        # Not all of the folder, in which results may be kept too.
        folder = case_folder(path)
        times = [entry for entry in case_times(folder) if time is None or entry.value == time]
        parts = dict.fromkeys([folder, *(part for entry in times for part in entry.parts)])
        constant = [part / "constant" for part in parts if (part / "constant").is_dir()]
        fixed = [file for one in constant for file in sorted(one.iterdir()) if file.is_file()]
        meshes = [one / "polyMesh" for one in constant if (one / "polyMesh").is_dir()]
        return [*fixed, *meshes, *(part / entry.name for entry in times for part in entry.parts)]
    if module == "su2":
        from .readers.su2 import mesh_and_restart

        return [one for one in mesh_and_restart(path, options) if one is not None]
    if module == "plot3d":
        from .readers.plot3d import grid_and_solution

        return list(grid_and_solution(path, options.get("solution")))
    if path.suffix.lower() in SUFFIXES:
        listed = [entry.file for entry in collection(path) if time is None or entry.time == time]
        return [path, *(piece for file in listed for piece in _with_pieces(file))]
    return _with_pieces(path)


def _with_pieces(path: Path) -> list[Path]:
    """Return a file of VTK and the pieces that it names, which may name others."""
    found, waiting = {path: None}, [path]
    while waiting:
        named = [file for file in pieces(waiting.pop()) if file not in found]
        waiting += named
        found |= dict.fromkeys(named)
    return list(found)
