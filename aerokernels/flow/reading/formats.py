"""Which reader reads a path: by what lies there, its first bytes and the end of its name.

A reader is a function of (path, time, options) that returns a `Dataset`, or raises `ReadError`. Those that stand on
libraries in C or C++ run in a child process (aerokernels/process/fragile.py), which may crash without harm.
"""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...process.fragile import LibraryEndedError
from ...process.fragile import in_child as call_in_child
from .calling import read_here
from .dataset import Dataset, ReadError, chosen_time
from .vtk_collections import LISTED, SUFFIXES


@dataclass(frozen=True)
class Format:
    """A format: its name in words, the ends of its files' names, the module that reads it, and whether in a child.

    Attributes:
        name: In words.
        suffixes: Ends of file names, in lower case.
        module: Module of this package; it has a function `read(path, time, options)`.
        fragile: Whether a damaged file may end the process that reads it.
        library: What has to be installed, or "".
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
# Which formats take what single ones need.
OPTIONS = {"mesh": ("su2",), "solution": ("su2", "plot3d"), "variables": ("named_arrays", "labelled")}
_BY_NAME = {entry.name: entry for entry in FORMATS}
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
SU2_MAGIC = (535532).to_bytes(4, "little"), (535532).to_bytes(4, "big")


def format_of(path: Path, options: Mapping[str, Any]) -> Format:
    """The format of what lies at a path; `options` as in `load`.

    Raises:
        ReadError: Nothing there, an empty file, or nothing that is known.
    """
    if not os.path.exists(path):  # of a name of any length
        raise ReadError(path, "there is no such file or folder", "give the path of a flow file or case")
    from .foam_case import is_case, may_be_case

    if may_be_case(path):
        if is_case(path):
            return _BY_NAME["OpenFOAM case"]
        raise ReadError(path, "the folder is no OpenFOAM case", "give a case, or one of the files in the folder")
    if not path.is_file():
        raise ReadError(path, "it is neither a file nor a folder", "give the path of a flow file or case")
    try:
        with path.open("rb") as stream:
            head = stream.read(4096)
    except OSError as fault:
        raise ReadError(path, f"it cannot be read ({fault.strerror})", "see to its permissions, or copy it") from None
    if not head:
        raise ReadError(path, "the file is empty", "write it again")
    suffix = path.suffix.lower()
    if head.startswith((b"#!TDV", b"#!TDE")):
        return _BY_NAME["Tecplot binary"]
    if head[:4] in SU2_MAGIC:
        return _BY_NAME["SU2"]
    if options.get("mesh") is not None and suffix in (".csv", ".dat"):
        return _BY_NAME["SU2"]  # a restart whose mesh lies elsewhere
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
    if "solution" in options:  # the grids of Plot3D end as their programs like
        return _BY_NAME["Plot3D"]
    known = ", ".join(sorted({end for entry in FORMATS for end in entry.suffixes} | {".dat"}))
    raise ReadError(path, f"no format is known for the name's end {suffix!r}", f"known are OpenFOAM cases and {known}")


def _su2_mesh_beside(path: Path, head: bytes) -> bool:
    """Whether a CSV file is a restart of SU2: its first column says so, and a mesh lies beside it."""
    first = head.split(b"\n", 1)[0].lower()
    return b"pointid" in first.replace(b"_", b"") and any(path.parent.glob("*.su2"))


def load(path: Path, time, options: dict[str, Any]) -> Dataset:
    """Read what lies at a path.

    Args:
        path: File or folder.
        time: "latest" (None), "first" or a time [s].
        options: What single formats take beside it: "mesh" (SU2), "solution" (Plot3D), "variables" (named arrays).

    Raises:
        ReadError: A path that nothing reads, a library that is not installed, a damaged file.
    """
    time = checked_time(time)
    entry = format_of(path, options)
    for name in options:
        if options[name] is not None and entry.module not in OPTIONS[name]:
            own = " and ".join(other.name for other in FORMATS if other.module in OPTIONS[name])
            raise ValueError(f"{path} is read as {entry.name}, which takes no {name}: that belongs to {own}")
    _need(path, entry)
    found = (in_child if entry.fragile else read_here)(entry.module, path, time, options)
    if not found.times:  # many a format has none, and its reader does not ask
        chosen_time(path, (), time)
    return found


def checked_time(time) -> float | str | None:
    """A time of a file as readers take it: "latest", "first", None or a number [s].

    Raises:
        TypeError: Something else.
        ValueError: A text that is none of these, or a number that is not finite.
    """
    if time is None or time in ("latest", "first"):
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


def in_child(module: str, path: Path, time, options: dict[str, Any]) -> Dataset:
    """As `read_here`, in a child process; its end becomes a ReadError."""
    try:
        found = call_in_child(path, f"{read_here.__module__}:{read_here.__name__}", module, path, time, options)
    except LibraryEndedError as fault:
        raise ReadError.said(str(fault)) from fault
    assert isinstance(found, Dataset)
    return found


def _need(path: Path, entry: Format) -> None:
    if not entry.library:
        return
    from importlib.util import find_spec

    if find_spec(entry.library) is None:
        raise ReadError(path, f"{entry.name} files need the package {entry.library}", "pip install 'aerokernels[cfd]'")
