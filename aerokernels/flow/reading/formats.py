"""Choose the reader of a path by its kind, its first bytes and its file name suffix.

A reader is a function of (path, time, options) that returns a `Dataset`, or raises `ReadError`. Readers that depend on
libraries in C or C++ run in a child process (aerokernels/process/fragile.py), so that a crash cannot end this one.
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.calling import in_child, read_here
from aerokernels.flow.reading.dataset import HDF5_MAGIC, Dataset, ReadError, chosen_time
from aerokernels.flow.reading.readers.vtk_collections import LISTED, SUFFIXES


@dataclass(frozen=True)
class Format:
    """A file format and the module that reads it.

    Attributes:
        name: Name of the format in messages.
        suffixes: File name suffixes, in lower case.
        module: Module of `readers` with a function `read(path, time, options)`.
        fragile: Whether a damaged file may end the process that reads it.
        library: Package that must be installed, or "".
    """

    name: str
    suffixes: tuple[str, ...]
    module: str
    fragile: bool = False
    library: str = ""


FORMATS = (
    Format("OpenFOAM case", (".foam", ".openfoam"), "foam_case"),
    Format(
        "VTK",
        (*LISTED, *SUFFIXES),
        "vtk_files",
        True,
        "vtk",
    ),
    Format("CGNS", (".cgns",), "cgns_file", True, "vtk"),
    Format("Plot3D", (".xyz", ".p3d", ".x", ".g", ".q", ".f", ".fun", ".p2d"), "plot3d"),
    Format("Tecplot binary", (".plt",), "tecplot_binary"),
    Format("Tecplot ASCII", (".tec", ".tp"), "tecplot_text"),
    Format("SU2", (".su2",), "su2"),
    Format("NumPy arrays", (".npz",), "named_arrays"),
    Format("NetCDF", (".nc", ".nc4", ".netcdf"), "labelled", True),
    Format("HDF5", (".h5", ".hdf5", ".hdf"), "named_arrays", True),
    Format("table of points", (".csv", ".txt"), "point_table"),
)
# The reader modules that accept each option.
OPTIONS = {"mesh": ("su2",), "solution": ("su2", "plot3d"), "variables": ("named_arrays", "labelled"),
           "order": ("named_arrays",)}  # fmt: skip
# Files that are not read, by the ends of their names: what they are, and what to do with them.
PARAVIEW = "open it in ParaView, and save its data as .vtu or .vtm"
FOREIGN = {
    (".cas", ".cas.gz", ".cas.h5", ".dat.h5"): ("a file of Fluent", PARAVIEW),
    (".case", ".encas"): ("a case of EnSight", PARAVIEW),
    (".e", ".exo", ".ex2", ".exii"): ("a file of Exodus", PARAVIEW),
    (".xdmf", ".xmf"): ("a file of XDMF", PARAVIEW),
    (".nek5000",): ("a case of Nek5000", PARAVIEW),
    (".msh",): ("a mesh of Gmsh or Fluent", PARAVIEW),
    (".npy",): ("an array without coordinates", "save them with it: numpy.savez(path, x=..., y=..., rho=...)"),
    (".gz", ".zip", ".tar", ".tgz", ".bz2", ".xz", ".7z"): ("compressed", "unpack it"),
}
LFS = b"version https://git-lfs.github.com/spec/"
_BY_NAME = {entry.name: entry for entry in FORMATS}
SU2_MAGIC = (535532).to_bytes(4, "little"), (535532).to_bytes(4, "big")


def format_of(path: Path, options: Mapping[str, Any]) -> Format:
    """Return the format of a path; `options` as in `load`.

    Raises:
        ReadError: No such path, an empty file, or an unknown format.
    """
    if not os.path.exists(path):  # which, unlike Path.exists, accepts a name of any length
        raise ReadError(path, "there is no such file or folder", "give the path of a flow file or case")
    from aerokernels.flow.reading.readers.foam_case import is_case, may_be_case

    if may_be_case(path):
        if is_case(path):
            return _BY_NAME["OpenFOAM case"]
        raise ReadError(path, "the folder is not an OpenFOAM case", "give a case, or one of the files in the folder")
    if not path.is_file():
        raise ReadError(path, "it is neither a file nor a folder", "give the path of a flow file or case")
    try:
        with path.open("rb") as stream:
            head = stream.read(4096)
    except OSError as fault:
        raise ReadError(path, f"it cannot be read ({fault.strerror})", "see to its permissions, or copy it") from None
    if not head:
        raise ReadError(path, "the file is empty", "write it again")
    if head.startswith(LFS):
        raise ReadError(path, "it is not the file itself, but a pointer of Git LFS", "fetch the file by `git lfs pull`")
    for ends, (what, remedy) in FOREIGN.items():
        if path.name.lower().endswith(ends) and options.get("solution") is None:
            raise ReadError(path, f"it is {what}, which is not read", remedy)
    suffix = path.suffix.lower()
    if head.startswith((b"#!TDV", b"#!TDE")):
        return _BY_NAME["Tecplot binary"]
    if head[:4] in SU2_MAGIC:
        return _BY_NAME["SU2"]
    if head.startswith(HDF5_MAGIC) and b"VTKHDF" in head:
        return _BY_NAME["VTK"]
    if options.get("mesh") is not None and suffix in (".csv", ".dat"):
        return _BY_NAME["SU2"]  # a restart whose mesh is in another folder
    if suffix in (".dat", ".plt", ".tec", ".tp"):
        if suffix == ".plt" and b"\0" in head:
            return _BY_NAME["Tecplot binary"]
        return _BY_NAME["Tecplot ASCII"]
    if suffix == ".csv" and _su2_mesh_beside(path, head):
        return _BY_NAME["SU2"]
    for entry in FORMATS:
        if suffix in entry.suffixes:
            return entry
    if head.startswith(HDF5_MAGIC):
        return _BY_NAME["CGNS" if b"CGNS" in head else "HDF5"]
    if "solution" in options:  # programs give Plot3D grids any suffix
        return _BY_NAME["Plot3D"]
    known = ", ".join(sorted({end for entry in FORMATS for end in entry.suffixes} | {".dat"}))
    raise ReadError(path, f"no format is known for the name's end {suffix!r}", f"known are OpenFOAM cases and {known}")


def _su2_mesh_beside(path: Path, head: bytes) -> bool:
    """Return whether a CSV file is an SU2 restart: its header names a PointID, and a mesh is in the same folder."""
    first = head.split(b"\n", 1)[0].lower()
    return b"pointid" in first.replace(b"_", b"") and any(path.parent.glob("*.su2"))


def load(path: Path, time, options: dict[str, Any]) -> Dataset:
    """Read the file or case at a path.

    Args:
        path: File or folder.
        time: "latest" (None), "first" or a time [s].
        options: Options of single formats: "mesh" (SU2), "solution" (Plot3D), "variables" and "order" (named arrays).

    Raises:
        ReadError: A path that no reader accepts, a library that is not installed, a damaged file.
    """
    time = checked_time(time)
    entry = format_of(path, options)
    for name in options:
        if options[name] is not None and entry.module not in OPTIONS[name]:
            own = " and ".join(other.name for other in FORMATS if other.module in OPTIONS[name])
            raise ValueError(f"{path} is read as {entry.name}, which takes no {name}: that belongs to {own}")
    _need(path, entry)
    found = (in_child if entry.fragile else read_here)(entry.module, path, time, options)
    if not found.times:  # readers of formats without times do not check the requested time
        chosen_time(path, (), time)
    return found


def times_in(path: Path, options: Mapping[str, Any]) -> Sequence[float] | None:
    """Return the times of a file of which `load` reads one at a time, with `load`'s options among `options`.

    None for NetCDF and HDF5, which are read in slices along their axis of time, and for unknown formats.

    Raises:
        ReadError: A file that cannot be read, or one without times.
    """
    own = {name: options[name] for name in OPTIONS if name in options}
    try:
        entry = format_of(path, own)
    except ReadError:
        return None
    if entry.name in ("NetCDF", "HDF5"):
        return None
    times = load(path, None, own).times
    if not times:
        raise ReadError(path, "it states no times", "open a series from a list or a pattern of files, with their times")
    return times


def checked_time(time) -> float | str | None:
    """Return a requested time in the form that readers take: "latest", "first", None or a number [s].

    Raises:
        TypeError: Neither a text nor a number.
        ValueError: A text that is none of these, or a number that is not finite.
    """
    if time is None or (isinstance(time, str) and time in ("latest", "first")):
        return time
    if isinstance(time, bool) or not isinstance(time, (str, int, float, np.integer, np.floating)):
        raise TypeError(f"time must be 'latest', 'first' or a time in seconds, got {type(time).__name__}")
    try:
        value = float(time)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"time must be 'latest', 'first' or a time in seconds, got {time!r}")
    return value


def _need(path: Path, entry: Format) -> None:
    if not entry.library:
        return
    from importlib.util import find_spec

    if find_spec(entry.library) is None:
        raise ReadError(path, f"{entry.name} files need the package {entry.library}", "pip install 'aerokernels[cfd]'")
