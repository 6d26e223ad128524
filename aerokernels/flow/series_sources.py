"""Open a series from a file with a time axis, from numbered files, or from arrays of a solver in this process."""

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
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


# The arguments of each kind of source, apart from its times. Files take the options of their reader as well.
TAKES = {
    FILES: ("density", "ambient_density", "geometry", "spacing", "mesh", "species", "body", "conditions", "read"),
    WITH_TIME: (
        "density", "ambient_density", "geometry", "length_unit", "cell_averages", "species", "body", "conditions",
    ),
    ARRAYS: ("ambient_density", "geometry", "origin", "spacing", "mesh", "cell_averages", "body", "conditions"),
    FIELDS: ("ambient_density", "body", "conditions"),
}  # fmt: skip


TIMES = ("time", "time_step", "start_time", "count")


# Arguments that turn densities into optical paths, which a series does not.
OPTICAL = ("wavelength", "relation", "constant", "interpolation")


OF_SAMPLES_ALONE = CellDensity, VertexDensity, GridDensity


# A difference of the far field is that of another flow if it is this many times the scatter of the densities there, and
# changes the optical path by more than the default tolerance [waves].
SCATTERS, WORTH = 3.0, 1e-3


SHARES = (0.16, 0.5, 0.84)  # quantiles: the median, and half of the distance of the others as the scatter


SAMPLES = 1 << 17  # of the upstream end, about


COUNTERS, DECIMALS = r"([0-9]+)", r"([0-9]+(?:\.[0-9]+)?)"


# Deviation of a step from the mean of all at which they are still even: times in names are rounded.
EVEN = 0.25


LEAST = 3  # files of which the steps can be compared


class SeriesReader:
    """Reads files, or one file at several times, as density fields; the first one read is the first snapshot.

    All files get the ambient density of the first one, unless the caller gives it or a function that reads them. That
    of each file would be the median of its own turbulence: on lines of unequal length through the grid its fluctuations
    would tilt the wavefront. A file of other flow conditions has a far field that differs by more than turbulence, and
    gets a warning.

    Attributes:
        options: The options of `flow.read`; None where the caller's function reads.
    """

    def __init__(self, read: Callable[..., DensityField] | None, options: dict[str, Any], own: Mapping[str, Any]):
        """Store the function, its options, and attributes that replace those of the fields."""
        self.options: dict[str, Any] | None = None
        self._read: Any
        if read is None:
            self._read = import_module("aerokernels.flow.reading.read").Reader(**options)
            self.options = self._read.options
        else:
            self._read = partial(read, **options)
        self._own, self._first = own, np.empty(0)
        self._is_watched = read is None and "ambient_density" not in options

    def __call__(self, path: Path, **more: Any) -> DensityField:
        """Read a file, or a time of it. Errors as in `flow.read`."""
        found = self._read(path, **more)
        if self._is_watched:
            self._watch(path, found)
        changed: DensityField = with_own(found, self._own)
        return changed

    def _watch(self, path: Path, found: DensityField) -> None:
        """Hold the ambient density of the first file, and warn of the first other one with another far field."""
        assert self.options is not None
        front = import_module("aerokernels.flow.reading.read").far_field(found, self._read.resampling)
        low, middle, high = np.quantile(front[:: max(1, front.size // SAMPLES)], SHARES)
        here = np.array([middle, 0.5 * (high - low)])
        if not self._first.size:
            self.options["ambient_density"], self._first = found.ambient_density, here
            return
        difference, scatter = abs(here[0] - self._first[0]), max(here[1], self._first[1])
        length = float(found.box[1][-1] - found.box[0][-1])
        constant = float(refractivity_model("gladstone-dale").constant(DEFAULT_WAVELENGTH))
        waves = constant * difference * length / DEFAULT_WAVELENGTH
        if difference > SCATTERS * scatter and waves > WORTH:
            self._is_watched = False  # one warning for a series
            warn_caller(
                f"{path}: the density at its upstream end is {here[0]:.6g} kg/m3, in the first snapshot "
                f"{self._first[0]:.6g} kg/m3, but all snapshots are taken to be in air of {found.ambient_density:.6g} "
                f"kg/m3: {waves:.2g} waves along the box at {1e9 * DEFAULT_WAVELENGTH:.0f} nm. Open snapshots of "
                "different flow conditions as separate series, or give density fields, which keep their own "
                "ambient_density; if the conditions are the same, give ambient_density"
            )


class Given(NamedTuple):
    """The arguments that a caller of `open_series` gives.

    Attributes:
        named: Its named arguments; None where one is not given.
        options: Further ones.
    """

    named: dict[str, Any]
    options: dict[str, Any]

    @property
    def values(self) -> dict[str, Any]:
        """All arguments that are given."""
        return {name: value for name, value in {**self.named, **self.options}.items() if value is not None}

    def check(self, source: str, kind: str) -> None:
        """Reject an argument that a kind of source has no use for.

        Args:
            source: The source, for the message.
            kind: What it was recognised as.

        Raises:
            TypeError: A name that `open_series` does not have.
            ValueError: An argument of other sources.
        """
        values = self.values
        optical = [name for name in OPTICAL if name in self.options]
        if optical and "read" not in values:
            raise TypeError(f"a series holds densities: give {optical[0]} to optical_series, or to index_field")
        unused = [name for name in values if name not in TAKES[kind] and (kind != FILES or name not in self.options)]
        if kind == FILES and isinstance(values.get("mesh"), QuadMesh):
            unused.append("QuadMesh as mesh")
        if unused:
            remedy = " (give density fields, each with its composition)" if unused[0] == "species" else ""
            raise (TypeError if unused[0] in self.options else ValueError)(
                f"{source} is taken for {kind}, which take no {unused[0]}{remedy}, but {', '.join(TIMES)}, "
                f"{', '.join(TAKES[kind])}{' and options of their reader' if kind == FILES else ''}: leave it out"
            )

    def check_geometry(self, source: str, mesh: GridMesh | QuadMesh | None) -> None:
        """Reject a geometry other than that which the source has.

        Raises:
            ValueError: They differ.
        """
        geometry = self.named["geometry"]
        if geometry is not None and mesh is not None and geometry != mesh.geometry:
            raise ValueError(f"{source} is {mesh.geometry}, not {geometry}: leave geometry out")

    def for_files(self) -> dict[str, Any]:
        """Return the options with which a file is read: `read` has these arguments under the same names."""
        names = ("density", "ambient_density", "geometry", "spacing", "mesh", "species")
        return {name: self.named[name] for name in names if self.named[name] is not None} | self.options

    def of_fields(self) -> dict[str, Any]:
        """Return the attributes that density fields get in place of their own."""
        return {name: self.named[name] for name in TAKES[FIELDS] if self.named[name] is not None}


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
    given = Given(
        {
            "density": density, "ambient_density": ambient_density, "geometry": geometry, "origin": origin,
            "spacing": spacing, "mesh": mesh, "cell_averages": cell_averages or None, "body": body,
            "conditions": conditions, "read": read, "species": None if species is False else species,
        },
        options,
    )  # fmt: skip
    if start_time != 0.0 and time_step is None:
        raise ValueError(f"start_time={start_time!r} goes with time_step: give it too")
    clock = time, time_step, start_time
    if isinstance(source, (str, bytes, os.PathLike)):
        found = _of_path(check_path(source, "source"), given, *clock)
    elif type(source).__module__.partition(".")[0] == "xarray":
        found = _with_times(_of_dataset(source, given, "xarray object", {}), *clock)
    else:
        found = _of_items(source, given, count, *clock)
    if count is not None and count != len(found):
        raise ValueError(f"count={count}, but the source has {len(found)} snapshots: leave count out, or check it")
    return found


def _of_path(path: Path, given: Given, time: Sequence[float] | None, step: float | None, start: float) -> Series:
    if any(letter in str(path) for letter in "*?[") and not path.exists():
        reader = _reader(str(path), given)
        return _of_files(_matching(path), time, step, start, reader)
    lists = import_module("aerokernels.flow.reading.readers.vtk_collections")
    if path.suffix.lower() in lists.SUFFIXES and path.is_file():
        reader = _reader(str(path), given)
        entries = lists.collection(path)
        paths, instants = [entry.file for entry in entries], [entry.time for entry in entries]
        if len(set(instants)) < len(instants):  # several files make up one time: `read` the collection instead
            found = _at_times(path, np.unique(instants), reader, {"file": path.name})
        else:
            found = _of_files(paths, instants, None, 0.0, reader)
        return _with_times(found, time, step, start)
    case = import_module("aerokernels.flow.reading.readers.foam_case")
    if path.exists() and case.may_be_case(path) and case.is_case(path):
        # The time directories from which `flow.read` chooses one.
        instants = [one.value for one in case.case_times(case.case_folder(path))]
        found = _at_times(path, np.array(instants), _reader(str(path), given), {"case": path.name})
        return _with_times(found, time, step, start)
    times = None
    if path.is_file():
        times = import_module("aerokernels.flow.reading.formats").times_in(path, given.for_files())
    if times is not None:
        found = _at_times(path, np.array(times), _reader(str(path), given), {"file": path.name})
    else:
        data, own = opened(path)
        found = replace(_of_dataset(data, given, str(path), {"file": path.name}), **own)
    return _with_times(found, time, step, start)


def _of_dataset(data: Any, given: Given, name: str, identity: dict[str, Any]) -> Series:
    given.check(name, WITH_TIME)
    found = series_of_dataset(data, given.values, name, identity)
    given.check_geometry(name, found.mesh)
    return found


def _of_items(
    items: Any, given: Given, count: int | None, time: Sequence[float] | None, step: float | None, start: float
) -> Series:
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
        return _of_files([Path(item) for item in items], time, step, start, _reader("the list of paths", given))
    times = times_of(time, step, start, total)
    own = given.of_fields()
    once = None if listed else InOrder(with_own(item, own) for item in items)
    get: Callable[[int], Any] = once or (lambda number: with_own(items[number], own))
    first = once.first() if once else get(0)
    where = "the list" if listed else "the iterator"
    if isinstance(first, DensityField):
        given.check(where, FIELDS)
        return _of_fields(get, times, first, "density fields", once=not listed)
    array = host_array(first)
    given.check(where, ARRAYS)
    mesh, values = given.values.get("mesh"), given.values
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
    around = float(values["ambient_density"])
    own = {name: values.get(name) for name in ("body", "conditions")}
    return Series(get, times, mesh, around, **own, provenance="arrays", once=not listed)


def _reader(name: str, given: Given) -> SeriesReader:
    given.check(name, FILES)
    own = {name: value for name, value in given.of_fields().items() if name != "ambient_density"}
    return SeriesReader(given.values.get("read"), given.for_files(), own)


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
    reader: SeriesReader,
) -> Series:
    missing = [path for path in paths if not path.exists()]
    if missing:
        raise ValueError(f"{missing[0]}: no such file ({len(missing)} of {len(paths)} are missing)")
    times = times_of(time, step, start, len(paths))
    if time is None:
        warn_of_gaps(paths)
    more = {"identity": {"files": [path.name for path in paths]}, "stamp": lambda number: _stamp(paths[number], reader)}
    described = f"{len(paths)} files from {paths[0].name} to {paths[-1].name}"
    return _of_fields(lambda number: reader(paths[number]), times, reader(paths[0]), described, **more)


def _of_fields(get: Callable[[int], Any], times: np.ndarray, first: Any, described: str, **more: Any) -> Series:
    """Return a series of density fields, with the mesh, body and free stream of the first one."""
    if not isinstance(first, DensityField):
        raise TypeError(f"{described}: read must return a DensityField, got {type(first).__name__}")
    conditions = getattr(first, "conditions", None)
    return Series(get, times, mesh_of(first), first.ambient_density, first.body, conditions, described, **more)


def _at_times(path: Path, times: np.ndarray, reader: SeriesReader, identity: dict) -> Series:
    """Return the series of a file or case with several times, each read by `reader(path, time=...)`."""
    return _of_fields(
        lambda number: reader(path, time=float(times[number])),
        times,
        reader(path, time=float(times[0])),
        f"{path}, {len(times)} times",
        identity={**identity, "times": times.tolist()},
        stamp=lambda number: _stamp(path, reader, float(times[number])),
    )


def _stamp(path: Path, reader: SeriesReader, time: float | None = None) -> str:
    """Return a text that changes when one of the files is written again that are read for a path at a time."""
    behind = import_module("aerokernels.flow.reading.formats")
    found: str = behind.stamp(behind.files_behind(path, reader.options, time))
    return found


def with_own(found: Any, own: Mapping[str, Any]) -> Any:
    """Return a density field with attributes in place of its own, by name; anything else as it is.

    Raises:
        ValueError: The field is a formula.
    """
    if not own or not isinstance(found, DensityField):
        return found
    if type(found) not in OF_SAMPLES_ALONE:
        what = f"a {type(found).__name__} is a formula, which has its own {', '.join(own)}"
        raise ValueError(f"{what}: leave it out, and make the fields with the values that they are to have")
    return replace(found, **own)  # type: ignore[type-var]


def in_order(paths: Sequence[Path]) -> list[Path]:
    """Return files ordered by the numbers in their names."""
    for reading in (COUNTERS, DECIMALS):
        ordered = sorted(paths, key=partial(_pieces, reading=reading))
        steps = _steps(ordered, reading)
        if len(steps) >= LEAST - 1 and _are_even(steps):
            return ordered
    return sorted(paths, key=partial(_pieces, reading=COUNTERS))


def warn_of_gaps(paths: Sequence[Path]) -> None:
    """Warn of files whose names have one number that differs, and not by even steps."""
    found = [_steps(paths, reading) for reading in (COUNTERS, DECIMALS)]
    if all(len(steps) >= LEAST - 1 and not _are_even(steps) for steps in found):
        usual = sorted(found[0])[len(found[0]) // 2]
        odd = next((k for k, step in enumerate(found[0]) if step != usual), 0)
        warn_caller(
            f"the files are not numbered evenly: {paths[odd + 1].name} comes after {paths[odd].name}. A snapshot may "
            "be missing, or there twice; time_step gives all of them even times: give time=, one for each"
        )


def _pieces(path: Path, reading: str) -> list[str | int | Fraction]:
    """Return the texts and the numbers of a name, in turn."""
    return [_number(one) if k % 2 else one for k, one in enumerate(re.split(reading, path.name))]


def _number(text: str) -> int | Fraction:
    return Fraction(text) if "." in text else int(text)


def _steps(paths: Sequence[Path], reading: str) -> list[float]:
    """Return the differences of the one number that differs from name to name; empty if several do, or none."""
    names = [_pieces(path, reading)[1::2] for path in paths]
    if len({len(name) for name in names}) != 1:
        return []
    columns: list[Any] = [column for column in zip(*names, strict=True) if len(set(column)) > 1]
    if len(columns) != 1:
        return []
    return [float(after - before) for before, after in pairwise(columns[0])]


def _are_even(steps: Sequence[float]) -> bool:
    mean = sum(steps) / len(steps)
    return mean > 0 and all(abs(step - mean) <= EVEN * mean for step in steps)
