"""The formats: choose the reader of a path by its kind, its first bytes and its suffix; list what a file contains.

A reader is a module of `readers` with a function `read(path, time, options)`, which returns a `Dataset` or raises
`ReadError`, and a function `files(path, options, time)` where a path stands for several files. Readers that depend on
libraries in C or C++ run in a child process (aerokernels/process/fragile.py), so that a crash cannot end this one.
"""

import hashlib
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import DAMAGED, HDF5_MAGIC, Block, Dataset, ReadError, chosen_time, grid_of
from aerokernels.flow.reading.readers.vtk_files import LISTED, LISTS
from aerokernels.inputs.checks import check_path
from aerokernels.process import fragile
from aerokernels.process.foreign_files import FileFault


@dataclass(frozen=True)
class Format:
    """A file format and the module that reads it."""

    name: str  # in messages
    suffixes: tuple[str, ...]  # of file names, in lower case
    module: str  # of `readers`
    fragile: bool = False  # whether a damaged file may end the process that reads it
    library: str = ""  # package that must be installed
    options: tuple[str, ...] = ()  # the options of `flow.read` that are for this format, beside those of all formats


FORMATS = (
    Format("OpenFOAM case", (".foam", ".openfoam"), "foam_case"),
    Format("VTK", (*LISTED, *LISTS), "vtk_files", True, "vtk"),
    Format("CGNS", (".cgns",), "cgns", True, "vtk"),
    Format("EnSight", (".case", ".encas"), "solver_files", True, "vtk"),
    Format("Fluent", (".cas", ".cas.h5"), "solver_files", True, "vtk"),
    Format("Exodus", (".e", ".exo", ".ex2", ".exii"), "exodus", True),
    Format("Plot3D", (".xyz", ".p3d", ".x", ".g", ".q", ".f", ".fun", ".p2d"), "plot3d", options=("solution",)),
    Format("Tecplot binary", (".plt",), "tecplot_binary"),
    Format("Tecplot ASCII", (".tec", ".tp"), "tecplot_text"),
    Format("SU2", (".su2",), "su2", options=("mesh", "solution")),
    Format("NumPy arrays", (".npz",), "named_arrays", options=("variables", "order")),
    Format("NetCDF", (".nc", ".nc4", ".netcdf"), "netcdf", True, options=("variables",)),
    Format("HDF5", (".h5", ".hdf5", ".hdf"), "hdf5", True, options=("variables", "order")),
    Format("table of points", (".csv", ".txt"), "point_table"),
)
FORMAT_OPTIONS = tuple(dict.fromkeys(name for entry in FORMATS for name in entry.options))
# Files that are not read, by the ends of their names: what they are, and what to do with them.
PARAVIEW = "open it in ParaView, and save its data as .vtu or .vtm"
FOREIGN = {
    (".dat.h5",): ("the data of a case of Fluent", "give the .cas.h5 beside it"),
    (".cas.gz", ".dat.gz"): ("a compressed case of Fluent", "unpack it"),
    (".xdmf", ".xmf"): ("a file of XDMF", PARAVIEW),
    (".nek5000",): ("a case of Nek5000", PARAVIEW),
    (".msh",): ("a mesh of Gmsh or Fluent", PARAVIEW),
    (".npy",): ("an array without coordinates", "save them with it: numpy.savez(path, x=..., y=..., rho=...)"),
    (".gz", ".zip", ".tar", ".tgz", ".bz2", ".xz", ".7z"): ("compressed", "unpack it"),
}


def format_of(path: Path, options: Mapping[str, Any]) -> Format:
    """Return the format of a path; `options` as in `load`."""
    by_name = {entry.name: entry for entry in FORMATS}
    if not os.path.exists(path):  # which, unlike Path.exists, accepts a name of any length
        raise ReadError(path, "there is no such file or folder", "give the path of a flow file or case")
    from aerokernels.flow.reading.readers.foam_case import is_case, may_be_case

    if may_be_case(path):
        if is_case(path):
            return by_name["OpenFOAM case"]
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
    if head.startswith(b"version https://git-lfs.github.com/spec/"):
        raise ReadError(path, "it is not the file itself, but a pointer of Git LFS", "fetch the file by `git lfs pull`")
    for ends, (what, remedy) in FOREIGN.items():
        if path.name.lower().endswith(ends) and options.get("solution") is None:
            raise ReadError(path, f"it is {what}, which is not read", remedy)
    suffix = path.suffix.lower()
    if head.startswith((b"#!TDV", b"#!TDE")):
        return by_name["Tecplot binary"]
    if int.from_bytes(head[:4], "little") == 535532 or int.from_bytes(head[:4], "big") == 535532:
        return by_name["SU2"]
    if head.startswith(HDF5_MAGIC) and b"VTKHDF" in head:
        return by_name["VTK"]
    if options.get("mesh") is not None and suffix in (".csv", ".dat"):
        return by_name["SU2"]  # a restart whose mesh is in another folder
    if suffix in (".dat", ".plt", ".tec", ".tp"):
        if suffix == ".plt" and b"\0" in head:
            return by_name["Tecplot binary"]
        return by_name["Tecplot ASCII"]
    # A restart of SU2 names a PointID in its first line, and its mesh is in the same folder.
    named = b"pointid" in head.split(b"\n", 1)[0].lower().replace(b"_", b"")
    if suffix == ".csv" and named and any(path.parent.glob("*.su2")):
        return by_name["SU2"]
    for entry in FORMATS:
        if path.name.lower().endswith(entry.suffixes):
            return entry
    if head.startswith(HDF5_MAGIC):
        return by_name["CGNS" if b"CGNS" in head else "HDF5"]
    if "solution" in options:  # programs give Plot3D grids any suffix
        return by_name["Plot3D"]
    known = ", ".join(sorted({end for entry in FORMATS for end in entry.suffixes} | {".dat"}))
    raise ReadError(path, f"no format is known for the name's end {suffix!r}", f"known are OpenFOAM cases and {known}")


def load(path: Path, time, options: Mapping[str, Any]) -> Dataset:
    """Read the file or case at a path; `options` are those of single formats, and errors as in `read`."""
    if unknown := sorted(set(options) - set(FORMAT_OPTIONS)):
        raise TypeError(f"no format has an option {unknown[0]!r}: there are {', '.join(FORMAT_OPTIONS)}")
    time, options = checked_time(time), {name: value for name, value in options.items() if value is not None}
    entry = format_of(path, options)
    for name in options:
        if name not in entry.options:
            own = " and ".join(other.name for other in FORMATS if name in other.options)
            raise ValueError(f"{path} is read as {entry.name}, which takes no {name}: that belongs to {own}")
    if entry.library and find_spec(entry.library) is None:
        what = f"{entry.name} files need the package {entry.library}"
        raise ReadError(path, what, "pip install 'aerokernels[cfd]'")
    dataset = (in_child if entry.fragile else read_here)(entry.module, path, time, options)
    if not dataset.times:  # readers of formats without times do not check the requested time
        chosen_time(path, (), time)
    return dataset


def read_here(module: str, path: Path, time, options: Mapping[str, Any]) -> Dataset:
    """Call a reader in this process; errors that a damaged file causes become a ReadError."""
    try:
        return _reader(module).read(path, time, options)
    except ReadError:
        raise
    except FileFault as fault:
        raise ReadError.said(str(fault)) from None
    except MemoryError:
        raise ReadError(path, "it announces more data than fits in memory", DAMAGED) from None
    except Exception as fault:  # libraries raise any error for a damaged file, such as TokenError for a NumPy header
        what = f"it cannot be read ({type(fault).__name__}: {str(fault)[:200]})"
        raise ReadError(path, what, DAMAGED) from fault


def in_child(module: str, path: Path, time, options: Mapping[str, Any]) -> Dataset:
    """Call `read_here` in a child process; raise ReadError if the child process ends early."""
    try:
        dataset = fragile.in_child(path, f"{__name__}:{read_here.__name__}", module, path, time, options)
    except FileFault as fault:
        raise ReadError.said(str(fault)) from fault
    assert isinstance(dataset, Dataset)
    return dataset


def _reader(module: str) -> Any:
    return import_module(f"aerokernels.flow.reading.readers.{module}")


def times_in(path: Path, options: Mapping[str, Any]) -> Sequence[float] | None:
    """Return the times of a file of which `load` reads one at a time, with `load`'s options among `options`.

    None for NetCDF and HDF5, which are read in slices along their axis of time, and for unknown formats.
    """
    own = {name: options[name] for name in FORMAT_OPTIONS if options.get(name) is not None}
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
    """Return a requested time in the form that readers take: "latest", "first", None or a number [s]."""
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


def files_behind(path: Path, options: Mapping[str, Any] | None = None, time: float | None = None) -> list[Path]:
    """Return the files that reading a path opens, in an order that does not depend on the file system.

    A result that is kept for a path belongs to the contents of all of them. `options` are as in `load`; the time None
    returns the files of all times. Of a path that cannot be read, itself and the files in it are returned.
    """
    options = {name: value for name, value in (options or {}).items() if value is not None}
    try:
        files = getattr(_reader(format_of(path, options).module), "files", None)
        opened = [path] if files is None else files(path, options, time)
    except (OSError, ReadError, FileFault):
        opened = [path]
    within = [sorted(file for file in one.rglob("*") if file.is_file()) if one.is_dir() else [one] for one in opened]
    return list(dict.fromkeys(file for part in within for file in part))


def stamp(files: Iterable[Path]) -> str:
    """Return a hash of the names, the sizes and the times of change of files; it takes no look into them."""
    stamps = hashlib.sha256()
    for file in files:
        try:
            about = file.stat()
            written = f"{about.st_size} {about.st_mtime_ns}"
        except OSError:  # a file that is gone, which its reader says
            written = ""
        stamps.update(f"{file.name} {written}\n".encode(errors="surrogateescape"))
    return stamps.hexdigest()[:16]


@dataclass(frozen=True)
class ArrayRange:
    """An array of a file and its range."""

    name: str
    where: str  # "cells" or "points"
    components: int  # 1 for scalars, 3 for vectors
    low: float  # least finite value; NaN if there is none
    high: float
    bad: int  # number of values that are not finite


@dataclass(frozen=True)
class Contents:
    """The contents of a file.

    Attributes:
        path: The file or case.
        format: Name of the format.
        geometry: "planar", "axisymmetric", "volume", or None where only the points decide.
        zones: Description of each zone: its name, shape or cells, and points.
        low: Lowest corner in the file's unit and axes.
        high: Highest corner.
        arrays: The arrays.
        times: The times for which there are fields; empty for a file without times.
        time: The time that was read, or None.
        patches: Boundary patches: name and kind.
        notes: Further remarks for the user.
    """

    path: str
    format: str
    geometry: str | None
    zones: tuple[str, ...]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    arrays: tuple[ArrayRange, ...]
    times: tuple[float, ...]
    time: float | None
    patches: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def contents(path, *, time: float | str | None = None, **options: Any) -> Contents:
    """List the contents of a flow file or case.

    Args:
        path: As in `flow.read`.
        time: As in `flow.read`.
        options: `mesh`, `solution`, `variables`, as in `flow.read`.

    Raises:
        ValueError: A file that cannot be read (`ReadError`: file, place and remedy).
    """
    path = check_path(path, "path")
    dataset = load(path, time, options)
    parts = [
        np.concatenate(grid.edges()) if (grid := grid_of(block.points)) else block.points for block in dataset.blocks
    ]
    points = np.concatenate(parts) if parts else np.empty((0, 3))
    if not len(points):
        raise ReadError(path, "it has no points", "give a file with a mesh and its arrays")
    return Contents(
        str(path),
        dataset.format,
        dataset.geometry,
        tuple(_zone(block, number) for number, block in enumerate(dataset.blocks)),
        tuple(float(v) for v in np.nanmin(points, axis=0)),  # type: ignore[arg-type]
        tuple(float(v) for v in np.nanmax(points, axis=0)),  # type: ignore[arg-type]
        tuple(_ranges(dataset)),
        tuple(dataset.times),
        dataset.time,
        tuple((patch.name, patch.kind) for patch in dataset.patches),
        tuple(dataset.notes),
    )


def _zone(block: Block, number: int) -> str:
    name = block.name or f"zone {number + 1}"
    if block.shape is not None:
        return f"{name}: {' x '.join(map(str, block.shape))} points, structured"
    if block.cells is None:
        return f"{name}: {len(block.points)} points without cells"
    called = {1: "points", 3: "lines", 5: "triangles", 7: "polygons", 9: "quadrilaterals", 10: "tetrahedra",
              12: "hexahedra", 13: "prisms", 14: "pyramids", 42: "polyhedra"}  # fmt: skip
    kinds, counts = np.unique(block.cells.types, return_counts=True)
    described = ", ".join(
        f"{n} {called.get(int(kind), f'cells of type {kind}')}" for kind, n in zip(kinds, counts, strict=True)
    )
    return f"{name}: {described}, {len(block.points)} points"


def _ranges(dataset: Dataset):
    for where in ("cell", "point"):
        held = [block.arrays(where) for block in dataset.blocks]
        for name in dict.fromkeys(name for arrays in held for name in arrays):
            parts = [np.asarray(arrays[name]) for arrays in held if name in arrays]
            parts = [part for part in parts if np.issubdtype(part.dtype, np.number)]
            if not parts:
                continue
            flat = np.concatenate([part.ravel() for part in parts]).astype(np.float64)
            finite = flat[np.isfinite(flat)]
            low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
            width = parts[0].shape[1] if parts[0].ndim > 1 else 1
            yield ArrayRange(name, f"{where}s", width, low, high, len(flat) - len(finite))
