"""Open a series from a file with a time axis, from numbered files, or from arrays of a solver in this process."""

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from glob import glob
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.device_arrays import host_array
from aerokernels.display.plain_text import cut
from aerokernels.flow.density_field import DensityField
from aerokernels.flow.gas import FreeStream
from aerokernels.flow.sampled_density import CellDensity, GridDensity, VertexDensity
from aerokernels.flow.series import GridMesh, InOrder, Series, mesh_of
from aerokernels.flow.series_files import opened, series_of_dataset
from aerokernels.inputs.arguments import seconds
from aerokernels.inputs.checks import check_path, check_positive, warn_caller
from aerokernels.medium import Body, QuadMesh

READING = "aerokernels.flow.reading"  # imported when it is needed
FILES, WITH_TIME = "files that are read one by one", "data with a time axis"
ARRAYS, FIELDS = "arrays", "density fields"
# The arguments of each kind of source, apart from its times; all others are rejected, since the snapshots would have
# the data's own value instead. Files take the options of their reader as well.
TAKES = {
    FILES: ("density", "ambient_density", "geometry", "spacing", "mesh", "species", "body", "conditions", "read"),
    WITH_TIME: (
        "density", "ambient_density", "geometry", "length_unit", "cell_averages", "body", "conditions",
    ),
    ARRAYS: ("ambient_density", "geometry", "origin", "spacing", "mesh", "cell_averages", "body", "conditions"),
    FIELDS: ("ambient_density", "body", "conditions"),
}  # fmt: skip
# Numbers in the names of files: a number with a point may be two counters, as in 1.9, 1.10, 1.11, or a time.
COUNTERS, DECIMALS = r"([0-9]+)", r"([0-9]+(?:\.[0-9]+)?)"


def open_series(
    source: Any,
    *,
    time: Sequence[float] | np.ndarray | None = None,
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
        count: How many snapshots there are. An iterator with `time_step` needs it; any other source is checked.
        density: Name of the density in a file; None looks for density, rho and the like.
        ambient_density: Density around all snapshots [kg/m3]. None takes the file's attribute of that name; for files
            that `flow.read` reads that of the first one, so that turbulence at the upstream end of each does not tilt
            wavefronts from one snapshot to the next. Density fields, and those of a `read` function, then keep theirs.
        geometry: "volume", "planar" or "axisymmetric": arrays need it; files with a time axis are checked.
        origin: Coordinates of the first node of arrays [m].
        spacing: Node spacing of arrays [m]; for volumes read from files, the greatest spacing of their grid.
        mesh: The mesh of arrays that are not on a uniform grid: averages over its cells, or values at its vertices. For
            restart files of SU2 the path of their mesh.
        cell_averages: The samples are averages over cells centred on the nodes; in an axisymmetric field over the
            (r, z) rectangle, without the weight r.
        body: Solid body in the flow; None takes that of the files or density fields, if they have one.
        conditions: The free stream; likewise.
        read: Reads a numbered file, `read(path, **options)`, or one time of a case,
            `read(path, time=..., **options)`; None: `flow.read`.
        species: Fractions of the species of which the gas of files is a mixture, as in `flow.read`; they may vary in
            time. Density fields have their own; arrays and data with a time axis have none.
        options: For `read`: the frame, the unit of length, and so on. Files with a time axis take `length_unit`.

    Raises:
        TypeError: A source of none of these kinds, or an option that it does not have.
        ValueError: No such file, no density or time in it, coordinates that are not an even grid, times that do not
            increase, an argument that the source has no use for, or missing information (the message says what to
            give).
    """
    named = {
        "density": density, "ambient_density": ambient_density, "geometry": geometry, "origin": origin,
        "spacing": spacing, "mesh": mesh, "cell_averages": cell_averages or None, "body": body,
        "conditions": conditions, "read": read, "species": None if species is False else species,
    }  # fmt: skip
    if start_time != 0.0 and time_step is None:
        raise ValueError(f"start_time={start_time!r} goes with time_step: give it too")
    times = partial(times_of, time, time_step, start_time)
    arguments = {name: value for name, value in named.items() if value is not None}
    call = _Call(arguments, options, times, time is None)
    if isinstance(source, (str, bytes, os.PathLike)):
        series = _of_path(check_path(source, "source"), call)
    elif type(source).__module__.partition(".")[0] == "xarray":
        series = _of_dataset(source, call, "xarray object", {})
    else:
        series = _of_items(source, call, count)
    if time is not None or time_step is not None:
        series = replace(series, time=times(len(series)))
    if count is not None and count != len(series):
        raise ValueError(f"count={count}, but the source has {len(series)} snapshots: leave count out, or check it")
    return series


@dataclass(frozen=True)
class _Call:
    """What a caller of `open_series` gives: arguments by name, further options, and the times of a count."""

    named: dict[str, Any]
    options: dict[str, Any]
    times: Callable[[int | None], np.ndarray]
    are_even: bool

    def check(self, source: str, kind: str) -> None:
        """Reject an argument that a kind of source has no use for: a TypeError for a name that there is not."""
        optical = [name for name in ("wavelength", "relation", "constant", "interpolation") if name in self.options]
        if optical and "read" not in self.named:
            raise TypeError(f"a series holds densities: give {optical[0]} to optical_series, or to index_field")
        takes = (*TAKES[kind], *(self.options if kind == FILES else ()))
        values = self.named | {name: value for name, value in self.options.items() if value is not None}
        unused = [name for name in values if name not in takes]
        if kind == FILES and isinstance(self.named.get("mesh"), QuadMesh):
            unused.append("QuadMesh as mesh")
        if unused:
            remedy = " (give density fields, each with its composition)" if unused[0] == "species" else ""
            others = ", ".join(TAKES[kind]) + (" and options of their reader" if kind == FILES else "")
            raise (TypeError if unused[0] in self.options else ValueError)(
                f"{source} is taken for {kind}, which take no {unused[0]}{remedy}, but time, time_step, start_time, "
                f"count, {others}: leave it out"
            )

    def check_geometry(self, source: str, mesh: GridMesh | QuadMesh | None) -> None:
        """Reject a geometry other than that which the source has."""
        geometry = self.named.get("geometry")
        if geometry is not None and mesh is not None and geometry != mesh.geometry:
            raise ValueError(f"{source} is {mesh.geometry}, not {geometry}: leave geometry out")

    def only(self, *names: str) -> dict[str, Any]:
        """Return some of the caller's named arguments."""
        return {name: self.named[name] for name in names if name in self.named}

    def for_files(self) -> dict[str, Any]:
        """Return the options with which a file is read: `read` has these arguments under the same names."""
        return self.only("density", "ambient_density", "geometry", "spacing", "mesh", "species") | self.options


def times_of(
    time: Sequence[float] | np.ndarray | None, step: float | None, start: float, count: int | None
) -> np.ndarray:
    """Return the times of a series [s], from a list of times or from a step."""
    if time is not None and step is not None:
        raise ValueError("give either time, one for each snapshot, or time_step")
    if time is not None:
        try:
            times = np.array(seconds(np.asarray(time))).reshape(-1)
        except (TypeError, ValueError):
            got = cut(repr(time))
            raise ValueError(f"time must be numbers of seconds, or dates, one for each snapshot, got {got}") from None
        if count is not None and len(times) != count:
            raise ValueError(f"{len(times)} times for {count} snapshots: give one for each")
        return times
    if step is None:
        raise ValueError("a series needs times: give time, one for each snapshot in seconds, or time_step")
    check_positive(step, "time_step", "s")
    if count is None:
        raise ValueError("an iterator does not say how many snapshots it has: give time, one for each, or count")
    return start + step * np.arange(count)


def _of_path(path: Path, call: _Call) -> Series:
    if any(letter in str(path) for letter in "*?[") and not path.exists():
        call.check(str(path), FILES)
        files = [Path(one) for one in glob(str(path), recursive=True)]
        if not files:
            raise ValueError(f"{path}: no file matches; check the folder and the pattern")
        return _of_numbered(in_order(files), call, str(path))
    lists = import_module(f"{READING}.readers.vtk_files")
    case = import_module(f"{READING}.readers.foam_case")
    times: Any
    times, kind = None, "file"
    if path.suffix.lower() in lists.LISTS and path.is_file():
        entries = lists.collection(path)
        times = [entry.time for entry in entries]
        if len(set(times)) == len(times):
            return _of_files([entry.file for entry in entries], np.array(times), call, str(path))
        times = np.unique(times)  # several files make up one time: `read` the collection instead
    elif path.exists() and case.may_be_case(path) and case.is_case(path):
        times, kind = [one.value for one in case.case_times(case.case_folder(path))], "case"
    elif path.is_file():
        times = import_module(f"{READING}.formats").times_in(path, call.for_files())
    if times is not None:
        places = [(path, float(time)) for time in times]
        identity = {kind: path.name, "times": [time for _, time in places]}
        return _one_by_one(places, np.array(times), call, str(path), f"{path}, {len(places)} times", identity)
    data, attributes = opened(path)
    return replace(_of_dataset(data, call, str(path), {"file": path.name}), **attributes)


def _of_dataset(data: Any, call: _Call, name: str, identity: dict[str, Any]) -> Series:
    call.check(name, WITH_TIME)
    series = series_of_dataset(data, call.named | call.options, name, identity)
    call.check_geometry(name, series.mesh)
    return series


def _of_items(items: Any, call: _Call, count: int | None) -> Series:
    """Return the series of a list or an iterator of arrays, density fields or paths."""
    listed = hasattr(items, "__getitem__") and (hasattr(items, "__len__") or len(getattr(items, "shape", ())) > 0)
    if not listed and not isinstance(items, Iterable):
        raise TypeError(
            f"a series is opened from a path, a pattern, a list or an iterator of arrays, got {type(items).__name__}"
        )
    total = (len(items) if hasattr(items, "__len__") else int(items.shape[0])) if listed else count
    if listed and total == 0:
        raise ValueError("the series is empty: give at least one snapshot")
    if listed and isinstance(items[0], (str, os.PathLike)):
        return _of_numbered([Path(item) for item in items], call, "the list of paths")
    times, own = call.times(total), call.only(*TAKES[FIELDS])
    once = None if listed else InOrder(_with_own(item, own) for item in items)
    get: Callable[[int], Any] = once or (lambda number: _with_own(items[number], own))
    first, where = once.first() if once else get(0), "the list" if listed else "the iterator"
    if isinstance(first, DensityField):
        call.check(where, FIELDS)
        return _of_fields(get, times, first, "density fields", once=not listed)
    array, values = host_array(first), call.named
    call.check(where, ARRAYS)
    mesh = values.get("mesh")
    if mesh is not None:
        if not isinstance(mesh, QuadMesh):
            raise TypeError(f"mesh must be a QuadMesh, got {type(mesh).__name__}: see QuadMesh.structured")
        call.check_geometry(where, mesh)
        if of_grid := [name for name in ("origin", "spacing", "cell_averages") if name in values]:
            raise ValueError(f"arrays are on a mesh or on a grid: give mesh, or {of_grid[0]} and what belongs to it")
    elif not {"geometry", "origin", "spacing"} <= values.keys():
        raise ValueError("arrays need to know where they lie: give geometry, origin and spacing, or mesh")
    else:
        origin, spacing = np.asarray(values["origin"]), np.asarray(values["spacing"])
        mesh = GridMesh(values["geometry"], origin, spacing, array.shape, "cell_averages" in values)
    if "ambient_density" not in values:
        raise ValueError("arrays need an ambient_density, that of the air around them, in kg/m3")
    own = call.only("body", "conditions")
    return Series(get, times, mesh, float(values["ambient_density"]), **own, provenance="arrays", once=not listed)


def _of_numbered(paths: list[Path], call: _Call, name: str) -> Series:
    """Return the series of files without times of their own."""
    call.check(name, FILES)
    times = call.times(len(paths))
    series = _of_files(paths, times, call, name)
    if call.are_even:
        _warn_of_gaps(paths)
    return series


def _of_files(paths: list[Path], times: np.ndarray, call: _Call, name: str) -> Series:
    missing = [path for path in paths if not path.exists()]
    if missing:
        raise ValueError(f"{missing[0]}: no such file ({len(missing)} of {len(paths)} are missing)")
    described = f"{len(paths)} files from {paths[0].name} to {paths[-1].name}"
    identity = {"files": [path.name for path in paths]}
    return _one_by_one([(path,) for path in paths], times, call, name, described, identity)


def _one_by_one(
    places: Sequence[tuple[Any, ...]], times: np.ndarray, call: _Call, name: str, described: str, identity: dict
) -> Series:
    """Return the series of files, or of times of one file: `places` has the path of each snapshot, and its time."""
    call.check(name, FILES)
    arguments, own, behind = call.for_files(), call.only("body", "conditions"), import_module(f"{READING}.formats")
    read: Any = call.named.get("read")
    if is_ours := read is None:
        read = import_module(f"{READING}.read").Reader(**arguments)
        arguments = read.options

    def get(number: int) -> DensityField:
        path, *time = places[number]
        more = {"time": time[0]} if time else {}
        field = read(path, **more) if is_ours else read(path, **arguments, **more)
        if is_ours:
            # The median of each file's own turbulence would tilt its wavefront: all get that of the first one.
            arguments.setdefault("ambient_density", field.ambient_density)
        changed: DensityField = _with_own(field, own)
        return changed

    def stamp(number: int) -> str:
        path, *time = places[number]
        return str(behind.stamp(behind.files_behind(path, arguments if is_ours else None, *time)))

    return _of_fields(get, times, get(0), described, identity=identity, stamp=stamp)


def _of_fields(get: Callable[[int], Any], times: np.ndarray, first: Any, described: str, **more: Any) -> Series:
    """Return a series of density fields, with the mesh, body and free stream of the first one."""
    if not isinstance(first, DensityField):
        raise TypeError(f"{described}: read must return a DensityField, got {type(first).__name__}")
    conditions = getattr(first, "conditions", None)
    return Series(get, times, mesh_of(first), first.ambient_density, first.body, conditions, described, **more)


def _with_own(item: Any, own: Mapping[str, Any]) -> Any:
    """Return a density field with attributes in place of its own, by name; anything else as it is."""
    if not own or not isinstance(item, DensityField):
        return item
    if type(item) not in (CellDensity, VertexDensity, GridDensity):
        what = f"a {type(item).__name__} is a formula, which has its own {', '.join(own)}"
        raise ValueError(f"{what}: leave it out, and make the fields with the values that they are to have")
    return replace(item, **own)  # type: ignore[type-var]


def in_order(paths: Sequence[Path]) -> list[Path]:
    """Return files ordered by the numbers in their names.

    Files of a run are written at even steps, so the reading in which the numbers grow evenly is the right one.
    """
    for reading in (COUNTERS, DECIMALS):
        ordered = sorted(paths, key=partial(_pieces, reading=reading))
        steps = _steps(ordered, reading)
        if len(steps) > 1 and _are_even(steps):
            return ordered
    return sorted(paths, key=partial(_pieces, reading=COUNTERS))


def _warn_of_gaps(paths: Sequence[Path]) -> None:
    """Warn of files whose names have one number that differs, and not by even steps."""
    both = [_steps(paths, reading) for reading in (COUNTERS, DECIMALS)]
    if all(len(steps) > 1 and not _are_even(steps) for steps in both):
        usual = sorted(both[0])[len(both[0]) // 2]
        odd = next((k for k, step in enumerate(both[0]) if step != usual), 0)
        warn_caller(
            f"the files are not numbered evenly: {paths[odd + 1].name} comes after {paths[odd].name}. A snapshot may "
            "be missing, or there twice; time_step gives all of them even times: give time=, one for each"
        )


def _pieces(path: Path, reading: str) -> list[str | Fraction]:
    """Return the texts and the numbers of a name, in turn."""
    return [Fraction(one) if k % 2 else one for k, one in enumerate(re.split(reading, path.name))]


def _steps(paths: Sequence[Path], reading: str) -> list[float]:
    """Return the differences of the one number that differs from name to name; empty if several do, or none."""
    names = [_pieces(path, reading)[1::2] for path in paths]
    if len({len(name) for name in names}) != 1:
        return []
    columns: list[Any] = [column for column in zip(*names, strict=True) if len(set(column)) > 1]
    return [float(after - before) for before, after in pairwise(columns[0])] if len(columns) == 1 else []


def _are_even(steps: Sequence[float]) -> bool:
    mean = sum(steps) / len(steps)
    return mean > 0 and all(abs(step - mean) <= 0.25 * mean for step in steps)  # times in names are rounded
