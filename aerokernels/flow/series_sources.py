"""Open a series from a file with a time axis, from numbered files, or from arrays of a solver in this process."""

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aerokernels.device_arrays import host_array
from aerokernels.flow.density_field import DensityField
from aerokernels.flow.gas import FreeStream
from aerokernels.flow.refractivity import refractivity_model
from aerokernels.flow.sampled_density import CellDensity, GridDensity, VertexDensity
from aerokernels.flow.series import GridMesh, InOrder, Series, mesh_of, times_of
from aerokernels.flow.series_files import opened, series_of_dataset
from aerokernels.inputs.checks import check_path, warn_caller
from aerokernels.inputs.wavelength import DEFAULT_WAVELENGTH
from aerokernels.medium import Body, QuadMesh

FILES, WITH_TIME = "files that are read one by one", "data with a time axis"
ARRAYS, FIELDS = "arrays", "density fields"
# The arguments of each kind of source, apart from its times; all others are rejected, since the snapshots would have
# the data's own value instead. Files take the options of their reader as well.
TAKES = {
    FILES: ("density", "ambient_density", "geometry", "spacing", "mesh", "species", "body", "conditions", "read"),
    WITH_TIME: (
        "density", "ambient_density", "geometry", "length_unit", "cell_averages", "species", "body", "conditions",
    ),
    ARRAYS: ("ambient_density", "geometry", "origin", "spacing", "mesh", "cell_averages", "body", "conditions"),
    FIELDS: ("ambient_density", "body", "conditions"),
}  # fmt: skip
# Numbers in the names of files: a number with a point may be two counters, as in 1.9, 1.10, 1.11, or a time.
COUNTERS, DECIMALS = r"([0-9]+)", r"([0-9]+(?:\.[0-9]+)?)"


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
        species: Fractions of the species of which a file's gas is a mixture, as in `flow.read`; they may vary in time.
            Density fields have their own, and bare arrays have none.
        options: For `read`: the frame, the unit of length, and so on. Files with a time axis take `length_unit`.

    Warns:
        UserWarning: The density at the upstream end of a later file differs from that of the first one by more than
            turbulence there explains, and by more than a thousandth of a wave along the box: the series holds several
            flow conditions, but has one ambient density.

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
    given = _Arguments({name: value for name, value in named.items() if value is not None}, options)
    if start_time != 0.0 and time_step is None:
        raise ValueError(f"start_time={start_time!r} goes with time_step: give it too")
    clock = _Clock(time, time_step, start_time)
    if isinstance(source, (str, bytes, os.PathLike)):
        series = _of_path(check_path(source, "source"), given, clock)
    elif type(source).__module__.partition(".")[0] == "xarray":
        series = clock.replace_in(_of_dataset(source, given, "xarray object", {}))
    else:
        series = _of_items(source, given, count, clock)
    if count is not None and count != len(series):
        raise ValueError(f"count={count}, but the source has {len(series)} snapshots: leave count out, or check it")
    return series


class _Clock(NamedTuple):
    """The times that a caller gives: one for each snapshot, or a step and the first."""

    time: Sequence[float] | None
    step: float | None
    start: float

    def of(self, count: int | None) -> np.ndarray:
        return times_of(self.time, self.step, self.start, count)

    def replace_in(self, series: Series) -> Series:
        """Return a series with these times in place of its own; its own if none are given."""
        return series if self.time is None and self.step is None else replace(series, time=self.of(len(series)))


@dataclass(frozen=True)
class _Arguments:
    """The arguments that a caller of `open_series` gives, apart from times: its own by name, and further options."""

    named: dict[str, Any]
    options: dict[str, Any]

    @property
    def values(self) -> dict[str, Any]:
        """All arguments that are given."""
        return self.named | {name: value for name, value in self.options.items() if value is not None}

    def check(self, source: str, kind: str) -> None:
        """Reject an argument that a kind of source has no use for: a TypeError for a name that there is not."""
        optical = [name for name in ("wavelength", "relation", "constant", "interpolation") if name in self.options]
        if optical and "read" not in self.values:
            raise TypeError(f"a series holds densities: give {optical[0]} to optical_series, or to index_field")
        takes = (*TAKES[kind], *(self.options if kind == FILES else ()))
        unused = [name for name in self.values if name not in takes]
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

    def reader(self, name: str) -> "_Reader":
        """Return what reads files, of a source of that name."""
        self.check(name, FILES)
        return _Reader(self.named.get("read"), self.for_files(), self.only("body", "conditions"))


def _of_path(path: Path, given: _Arguments, clock: _Clock) -> Series:
    if any(letter in str(path) for letter in "*?[") and not path.exists():
        reader = given.reader(str(path))
        return _of_files(_matching(path), clock, reader)
    lists = import_module("aerokernels.flow.reading.readers.vtk_files")
    case = import_module("aerokernels.flow.reading.readers.foam_case")
    times: Any
    times, kind = None, "file"
    if path.suffix.lower() in lists.LISTS and path.is_file():
        entries = lists.collection(path)
        times = [entry.time for entry in entries]
        if len(set(times)) == len(times):
            own = _of_files([entry.file for entry in entries], _Clock(times, None, 0.0), given.reader(str(path)))
            return clock.replace_in(own)
        times = np.unique(times)  # several files make up one time: `read` the collection instead
    elif path.exists() and case.may_be_case(path) and case.is_case(path):
        times, kind = [one.value for one in case.case_times(case.case_folder(path))], "case"
    elif path.is_file():
        times = import_module("aerokernels.flow.reading.formats").times_in(path, given.for_files())
    if times is not None:
        return clock.replace_in(_at_times(path, np.array(times), given.reader(str(path)), {kind: path.name}))
    data, attributes = opened(path)
    return clock.replace_in(replace(_of_dataset(data, given, str(path), {"file": path.name}), **attributes))


def _of_dataset(data: Any, given: _Arguments, name: str, identity: dict[str, Any]) -> Series:
    given.check(name, WITH_TIME)
    series = series_of_dataset(data, given.values, name, identity)
    given.check_geometry(name, series.mesh)
    return series


def _of_items(items: Any, given: _Arguments, count: int | None, clock: _Clock) -> Series:
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
        return _of_files([Path(item) for item in items], clock, given.reader("the list of paths"))
    times, own = clock.of(total), given.only(*TAKES[FIELDS])
    once = None if listed else InOrder(_with_own(item, own) for item in items)
    get: Callable[[int], Any] = once or (lambda number: _with_own(items[number], own))
    first, where = once.first() if once else get(0), "the list" if listed else "the iterator"
    if isinstance(first, DensityField):
        given.check(where, FIELDS)
        return _of_fields(get, times, first, "density fields", once=not listed)
    array, values = host_array(first), given.named
    given.check(where, ARRAYS)
    mesh = values.get("mesh")
    if mesh is not None:
        if not isinstance(mesh, QuadMesh):
            raise TypeError(f"mesh must be a QuadMesh, got {type(mesh).__name__}: see QuadMesh.structured")
        given.check_geometry(where, mesh)
        if of_grid := [name for name in ("origin", "spacing", "cell_averages") if name in values]:
            raise ValueError(f"arrays are on a mesh or on a grid: give mesh, or {of_grid[0]} and what belongs to it")
    elif not {"geometry", "origin", "spacing"} <= values.keys():
        raise ValueError("arrays need to know where they lie: give geometry, origin and spacing, or mesh")
    else:
        origin, spacing = np.asarray(values["origin"]), np.asarray(values["spacing"])
        mesh = GridMesh(values["geometry"], origin, spacing, array.shape, "cell_averages" in values)
    if "ambient_density" not in values:
        raise ValueError("arrays need an ambient_density, that of the air around them, in kg/m3")
    own = given.only("body", "conditions")
    return Series(get, times, mesh, float(values["ambient_density"]), **own, provenance="arrays", once=not listed)


def _of_files(paths: list[Path], clock: _Clock, reader: "_Reader") -> Series:
    missing = [path for path in paths if not path.exists()]
    if missing:
        raise ValueError(f"{missing[0]}: no such file ({len(missing)} of {len(paths)} are missing)")
    times = clock.of(len(paths))
    if clock.time is None:
        _warn_of_gaps(paths)
    described = f"{len(paths)} files from {paths[0].name} to {paths[-1].name}"
    return _of_fields(
        lambda number: reader(paths[number]), times, reader(paths[0]), described,
        identity={"files": [path.name for path in paths]}, stamp=lambda number: reader.stamp(paths[number]),
    )  # fmt: skip


def _at_times(path: Path, times: np.ndarray, reader: "_Reader", identity: dict) -> Series:
    """Return the series of a file or case with several times, each read by `reader(path, time=...)`."""
    return _of_fields(
        lambda number: reader(path, time=float(times[number])), times, reader(path, time=float(times[0])),
        f"{path}, {len(times)} times", identity={**identity, "times": times.tolist()},
        stamp=lambda number: reader.stamp(path, float(times[number])),
    )  # fmt: skip


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


class _Reader:
    """Reads files, or one file at several times, as density fields; the first one read is the first snapshot.

    All files get the ambient density of the first one, unless the caller gives it or a function that reads them. That
    of each file would be the median of its own turbulence: on lines of unequal length through the grid its fluctuations
    would tilt the wavefront. A file of other flow conditions has a far field that differs by more than turbulence, and
    gets a warning.
    """

    def __init__(self, read: Callable[..., DensityField] | None, options: dict[str, Any], own: Mapping[str, Any]):
        """Store the function, None for `flow.read`, its options, and attributes that replace those of the fields."""
        self.options: dict[str, Any] | None = None  # those of `flow.read`
        self._read: Any = partial(read, **options) if read is not None else None
        if read is None:
            self._read = import_module("aerokernels.flow.reading.read").Reader(**options)
            self.options = self._read.options
        self._own, self._first = own, np.empty(0)
        self._is_watched = read is None and "ambient_density" not in options

    def __call__(self, path: Path, **more: Any) -> DensityField:
        """Read a file, or a time of it. Errors as in `flow.read`."""
        field = self._read(path, **more)
        if self._is_watched:
            self._watch(path, field)
        changed: DensityField = _with_own(field, self._own)
        return changed

    def stamp(self, path: Path, time: float | None = None) -> str:
        """Return a text that changes when one of the files is written again that are read for a path at a time."""
        behind = import_module("aerokernels.flow.reading.formats")
        return str(behind.stamp(behind.files_behind(path, self.options, time)))

    def _watch(self, path: Path, field: DensityField) -> None:
        """Hold the ambient density of the first file, and warn of the first other one with another far field.

        Its difference is that of another flow if it is three times the scatter of the densities there and changes the
        optical path by more than the default tolerance.
        """
        assert self.options is not None
        front = import_module("aerokernels.flow.reading.read").far_field(field, self._read.resampling)
        low, middle, high = np.quantile(front[:: max(1, front.size // 2**17)], (0.16, 0.5, 0.84))
        here = np.array([middle, 0.5 * (high - low)])
        if not self._first.size:
            self.options["ambient_density"], self._first = field.ambient_density, here
            return
        difference, scatter = abs(here[0] - self._first[0]), max(here[1], self._first[1])
        length = float(field.box[1][-1] - field.box[0][-1])
        constant = float(refractivity_model("gladstone-dale").constant(DEFAULT_WAVELENGTH))
        waves = constant * difference * length / DEFAULT_WAVELENGTH
        if difference > 3.0 * scatter and waves > 1e-3:
            self._is_watched = False  # one warning for a series
            warn_caller(
                f"{path}: the density at its upstream end is {here[0]:.6g} kg/m3, in the first snapshot "
                f"{self._first[0]:.6g} kg/m3, but all snapshots are taken to be in air of {field.ambient_density:.6g} "
                f"kg/m3: {waves:.2g} waves along the box at {1e9 * DEFAULT_WAVELENGTH:.0f} nm. Open snapshots of "
                "different flow conditions as separate series, or give density fields, which keep their own "
                "ambient_density; if the conditions are the same, give ambient_density"
            )


def _matching(pattern: Path) -> list[Path]:
    """Return the files of a pattern, in order."""
    parts = pattern.parts
    first = next(k for k, part in enumerate(parts) if any(letter in part for letter in "*?["))
    files = list((Path(*parts[:first]) if first else Path()).glob(str(Path(*parts[first:]))))
    if not files:
        raise ValueError(f"{pattern}: no file matches; check the folder and the pattern")
    return in_order(files)


def in_order(paths: Sequence[Path]) -> list[Path]:
    """Return files ordered by the numbers in their names.

    Files of a run are written at even steps, so the reading in which the numbers grow evenly is the right one; without
    one they are counters.
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
