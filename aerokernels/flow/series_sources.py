"""Open a series from a file with a time axis, from numbered files, or from arrays of a solver in this process."""

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ..device_arrays import host_array
from ..inputs.checks import check_path
from ..medium import Body, QuadMesh
from .density_field import DensityField
from .gas import FreeStream
from .numbered_files import in_order, warn_of_gaps
from .series import GridMesh, InOrder, Series, mesh_of, times_of
from .series_files import series_of_dataset, series_of_file

FILES, WITH_TIME = "files that are read one by one", "a file or object with a time axis"
ARRAYS, FIELDS = "arrays", "density fields"
# The arguments of `open_series` that each kind of source takes, apart from times, species and options of `read`.
TAKES = {
    FILES: ("density", "ambient_density", "geometry", "spacing", "read"),
    WITH_TIME: ("density", "ambient_density", "cell_averages", "body", "conditions"),
    ARRAYS: (
        "count",
        "ambient_density",
        "geometry",
        "origin",
        "spacing",
        "mesh",
        "cell_averages",
        "body",
        "conditions",
    ),
    FIELDS: ("count",),
}


def open_series(
    source: Any,
    *,
    time: Sequence[float] | None = None,
    time_step: float | None = None,
    start_time: float = 0.0,
    count: int | None = None,
    density: str | None = None,
    ambient_density: float | None = None,
    geometry: str | None = None,
    origin: Sequence[float] | None = None,
    spacing: Sequence[float] | None = None,
    mesh: QuadMesh | None = None,
    cell_averages: bool = False,
    body: Body | None = None,
    conditions: FreeStream | None = None,
    read: Callable[..., DensityField] | None = None,
    species: Any = None,
    **options: Any,
) -> Series:
    """Open snapshots of a flow in time; each is read when it is requested.

    Args:
        source: One of
            a NetCDF file or a Zarr store with a time axis, or an xarray object: the density, with coordinates time and
            x, y, z, or y, z, or r, z, on even grids in metres or in the unit of their attribute `units`;
            a pattern such as "run/flow_*.vtu", whose files are ordered by the numbers in their names, or a list of
            paths: read by `read`;
            a ParaView collection (.pvd) or file series (.vtu.series), an OpenFOAM case with time directories, or a
            file of Tecplot, CGNS, NumPy (.npz) or CSV with several times, read by `read` at the times that they
            give;
            a list or an iterator of arrays (NumPy, or any with DLPack), or of density fields. The snapshots of an
            iterator can be read only once and in order.
        time: Time of each snapshot [s]. Numbered files and arrays need it, or `time_step`; it replaces the times of
            files and cases that have their own.
        time_step: Time from one snapshot to the next [s], instead of `time`.
        start_time: Time of the first snapshot [s], with `time_step`.
        count: How many snapshots an iterator yields, with `time_step`.
        density: Name of the density in a file; None looks for density, rho and the like.
        ambient_density: Density around the field [kg/m3]; None takes the file's attribute of that name, or for files
            that `flow.read` reads that of the first snapshot.
        geometry: "volume", "planar" or "axisymmetric", for arrays.
        origin: Coordinates of the first node of arrays [m].
        spacing: Node spacing of arrays [m]; for volumes read from files, the greatest spacing of their grid.
        mesh: The mesh of arrays that are not on a uniform grid: averages over its cells, or values at its vertices.
        cell_averages: The samples are averages over cells centred on the nodes; in an axisymmetric field over the
            (r, z) rectangle, without the weight r.
        body: Solid body in the flow.
        conditions: The free stream.
        read: Reads a numbered file, `read(path, **options)`, or one time of a case,
            `read(path, time=..., **options)`; None: `flow.read`.
        species: Fractions of the species of which a file's gas is a mixture, as in `flow.read`; they may vary in time.
            Density fields have their own, and bare arrays have none.
        options: For `read`: the frame, the unit of length, and so on.

    Raises:
        TypeError: A source of none of these kinds.
        ValueError: No such file, no density or time in it, coordinates that are not an even grid, times that do not
            increase, an argument that the source has no use for, or missing information (the message says what to
            give).
    """
    given = {
        "count": count, "density": density, "ambient_density": ambient_density, "geometry": geometry, "origin": origin,
        "spacing": spacing, "mesh": mesh, "cell_averages": cell_averages or None, "body": body,
        "conditions": conditions, "read": read,
    }  # fmt: skip
    if start_time != 0.0 and time_step is None:
        raise ValueError(f"start_time={start_time!r} goes with time_step: give it too")
    own: dict[str, Any] = {"body": body, "conditions": conditions}
    # `read` takes these arguments for files under the same names as this function for arrays.
    shared = {"ambient_density": ambient_density, "geometry": geometry, "spacing": spacing}
    if species not in (None, False):
        shared["species"] = species
    for_files = {**{name: value for name, value in shared.items() if value is not None}, **options}
    if isinstance(source, (str, bytes, os.PathLike)):
        path = check_path(source, "source")
        if any(letter in str(path) for letter in "*?[") and not path.exists():
            _check_use(FILES, given)
            return _of_files(_matching(path), time, time_step, start_time, _reader(read, for_files, density))
        lists = import_module(f"{__package__}.reading.readers.vtk_collections")
        if path.suffix.lower() in lists.SUFFIXES and path.is_file():
            _check_use(FILES, given)
            entries = lists.collection(path)
            paths, instants = [entry.file for entry in entries], [entry.time for entry in entries]
            reader = _reader(read, for_files, density)
            if len(set(instants)) < len(instants):  # several files make up one time: `read` the collection instead
                found = _at_times(path, np.unique(instants), reader, {"file": path.name})
            else:
                found = _of_files(paths, instants, None, 0.0, reader)
            return _with_times(found, time, time_step, start_time)
        case = import_module(f"{__package__}.reading.readers.foam_case")
        if path.exists() and case.may_be_case(path) and case.is_case(path):
            _check_use(FILES, given)
            return _with_times(_of_case(path, _reader(read, for_files, density)), time, time_step, start_time)
        times = import_module(f"{__package__}.reading.formats").times_in(path, for_files) if path.is_file() else None
        if times is not None:
            _check_use(FILES, given)
            found = _at_times(path, np.array(times), _reader(read, for_files, density), {"file": path.name})
            return _with_times(found, time, time_step, start_time)
        if options:
            raise TypeError(f"{path} has a time axis and is not read by `read`: it takes no {', '.join(options)}")
        _check_use(WITH_TIME, given)
        found = series_of_file(path, density, ambient_density, cell_averages, species, own)
        return _with_times(found, time, time_step, start_time)
    if type(source).__module__.partition(".")[0] == "xarray":
        _check_use(WITH_TIME, given)
        name = "xarray object"
        found = series_of_dataset(source, density, ambient_density, cell_averages, species, own, name, {})
        return _with_times(found, time, time_step, start_time)
    listed = hasattr(source, "__getitem__") and (hasattr(source, "__len__") or len(getattr(source, "shape", ())) > 0)
    if not listed and not isinstance(source, Iterable):
        raise TypeError(
            f"a series is opened from a path, a pattern, a list or an iterator of arrays, got {type(source).__name__}"
        )
    items: Any = source
    total = (len(items) if hasattr(items, "__len__") else int(items.shape[0])) if listed else count
    if listed and total == 0:
        raise ValueError("the series is empty: give at least one snapshot")
    if listed and isinstance(items[0], (str, os.PathLike)):
        _check_use(FILES, given)
        return _of_files([Path(item) for item in items], time, time_step, start_time, _reader(read, for_files, density))
    get = items.__getitem__ if listed else InOrder(items)
    times = times_of(time, time_step, start_time, total)
    first = items[0] if listed else get.first()
    if isinstance(first, DensityField):
        _check_use(FIELDS, given)
        return _of_fields(get, times, first, "density fields", once=not listed)
    array = host_array(first)
    _check_use(ARRAYS, given)
    if species not in (None, False):
        raise ValueError("species are of files: for arrays of a mixture give density fields, each with its composition")
    where: GridMesh | QuadMesh
    if mesh is not None:
        if not isinstance(mesh, QuadMesh):
            raise TypeError(f"mesh must be a QuadMesh, got {type(mesh).__name__}: see QuadMesh.structured")
        where = mesh
    else:
        if geometry is None or origin is None or spacing is None:
            raise ValueError("arrays need to know where they lie: give geometry, origin and spacing, or mesh")
        where = GridMesh(geometry, np.asarray(origin), np.asarray(spacing), array.shape, cell_averages)
    if ambient_density is None:
        raise ValueError("arrays need an ambient_density, that of the air around them, in kg/m3")
    return Series(get, times, where, float(ambient_density), **own, provenance="arrays", once=not listed)


def _check_use(kind: str, given: dict[str, Any]) -> None:
    """Reject arguments that a kind of source has no use for: it would have the data's own instead."""
    unused = [name for name, value in given.items() if value is not None and name not in TAKES[kind]]
    if unused:
        raise ValueError(f"a series of {kind} takes no {unused[0]}, only {', '.join(TAKES[kind])}: leave it out")


def _with_times(series: Series, time: Sequence[float] | None, step: float | None, start: float) -> Series:
    """Return a series with the times that a caller gives, in place of its own; its own if none are given."""
    if time is None and step is None:
        return series
    return replace(series, time=times_of(time, step, start, len(series)))


def _matching(pattern: Path) -> list[Path]:
    """Return the files of a pattern, ordered by the numbers in their names: see numbered_files.py."""
    parts = pattern.parts
    first = next(k for k, part in enumerate(parts) if any(letter in part for letter in "*?["))
    root = Path(*parts[:first]) if first else Path()
    found = list(root.glob(str(Path(*parts[first:]))))
    if not found:
        raise ValueError(f"{pattern}: no file matches; check the folder and the pattern")

    return in_order(found)


def _of_files(
    paths: list[Path],
    time: Sequence[float] | None,
    step: float | None,
    start: float,
    reader: Callable[..., DensityField],
) -> Series:
    missing = [path for path in paths if not path.exists()]
    if missing:
        raise ValueError(f"{missing[0]}: no such file ({len(missing)} of {len(paths)} are missing)")
    times = times_of(time, step, start, len(paths))
    if time is None:
        warn_of_gaps(paths)
    more = {"identity": {"files": [path.name for path in paths]}, "stamp": lambda number: _stamp(paths[number], reader)}
    described = f"{len(paths)} files from {paths[0].name} to {paths[-1].name}"
    return _of_fields(lambda number: reader(paths[number]), times, _first(reader, paths[0]), described, **more)


def _of_fields(get: Callable[[int], Any], times: np.ndarray, first: Any, described: str, **more: Any) -> Series:
    """Return a series of density fields, with the mesh, body and free stream of the first one."""
    if not isinstance(first, DensityField):
        raise TypeError(f"{described}: read must return a DensityField, got {type(first).__name__}")
    conditions = getattr(first, "conditions", None)
    return Series(get, times, mesh_of(first), first.ambient_density, first.body, conditions, described, **more)


def _reader(read: Callable[..., DensityField] | None, options: dict[str, Any], density: str | None) -> Callable:
    """Return a function that reads a file with the options given; None: a `Reader`, which reuses a common mesh."""
    given: dict[str, Any] = options if density is None else {**options, "density": density}
    if read is None:
        return import_module(f"{__package__}.reading.reader").Reader(**given)
    return partial(read, **given)


def _first(reader: Callable[..., DensityField], path: Path, **more: Any) -> DensityField:
    """Return the first field of a series, whose ambient density is that of the others as well.

    That of each file would be the median of its own turbulence: lines of unequal length through the grid would get a
    tilt of its fluctuations.
    """
    first = reader(path, **more)
    kept = getattr(reader, "options", None)  # of a `Reader`; other functions choose themselves
    if kept is not None and isinstance(first, DensityField):
        kept.setdefault("ambient_density", first.ambient_density)
    return first


def _of_case(path: Path, reader: Callable[..., DensityField]) -> Series:
    """Return the series of an OpenFOAM case, at the time directories from which `flow.read` chooses one."""
    case = import_module(f"{__package__}.reading.readers.foam_case")
    times = [time.value for time in case.case_times(case.case_folder(path))]
    return _at_times(path, np.array(times), reader, {"case": path.name})


def _at_times(path: Path, times: np.ndarray, reader: Callable[..., DensityField], identity: dict) -> Series:
    """Return the series of a file or case with several times, each read by `reader(path, time=...)`."""
    return _of_fields(
        lambda number: reader(path, time=float(times[number])),
        times,
        _first(reader, path, time=float(times[0])),
        f"{path}, {len(times)} times",
        identity={**identity, "times": times.tolist()},
        stamp=lambda number: _stamp(path, reader, float(times[number])),
    )


def _stamp(path: Path, reader: Callable[..., DensityField], time: float | None = None) -> str:
    """Return a text that changes when one of the files is written again that are read for a path at a time."""
    behind = import_module(f"{__package__}.reading.files_behind")
    found: str = behind.stamp(behind.files_behind(path, getattr(reader, "options", None), time))
    return found
