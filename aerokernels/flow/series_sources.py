"""Opening a series: from a file with a time axis, from numbered files, from arrays of a solver in this process."""

import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..device_arrays import host_array
from ..medium import Body, QuadMesh
from ..netcdf_reading import open_netcdf
from ..room import check_file, check_room
from ..units import quantity
from .density_field import DensityField
from .gas import FreeStream
from .series import GridMesh, InOrder, Series, mesh_of, times_of

# Names under which density goes, in the order in which they are looked for.
DENSITY_NAMES = ("density", "rho", "Density", "Rho", "RHO", "rhoMean")
TIME_NAMES = ("time", "t", "Time")
_AXES = {("x", "y", "z"): "volume", ("y", "z"): "planar", ("r", "z"): "axisymmetric"}
# The share of a spacing by which nodes may lie off an even grid: what single precision makes of coordinates.
UNEVEN = 1e-3


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
    """Open snapshots of a flow in time; each is read when it is asked for.

    Args:
        source: One of
            a NetCDF file or a Zarr store with a time axis, or an xarray object: coordinates time and x, y, z, or y, z,
            or r, z, on even grids in metres (a `units` attribute is heeded), and the density;
            a pattern such as "run/flow_*.vtu", or a list of paths: numbered files, read by `read`;
            a ParaView collection (.pvd) or an OpenFOAM case with time directories, which have their times, likewise;
            a list or an iterator of arrays (NumPy, or any with DLPack), or of density fields. An iterator's snapshots
            come once, in their order.
        time: Time of each snapshot [s]; for numbered files and arrays. A file with a time axis has its own.
        time_step: Time from one snapshot to the next [s], in place of `time`.
        start_time: Time of the first one [s], with `time_step`.
        count: How many snapshots an iterator gives, with `time_step`.
        density: Name of the density in a file; None looks for density, rho and the like.
        ambient_density: Density around the field [kg/m3]; None takes the file's attribute of that name.
        geometry: "volume", "planar" or "axisymmetric", for arrays.
        origin: Coordinates of their first node [m].
        spacing: Their node spacing [m]; of volumes that are read, the greatest one.
        mesh: The mesh of arrays that are no uniform grid's: averages over its cells, or values at its vertices.
        cell_averages: The samples are averages over cells centred on the nodes.
        body: Solid body in the flow.
        conditions: The free stream.
        read: Reads a numbered file, `read(path, **options)`, or a case at a time, `read(path, time=..., **options)`;
            None: `flow.read`.
        species: Fractions by which the gas of a file is a mixture, as in `flow.read`; they may vary in time. Density
            fields bring their own, and bare arrays have none.
        options: For `read`: the frame, the unit of length, and so on.

    Raises:
        TypeError: A source of none of these kinds.
        ValueError: No such file, no density or time in it, coordinates that are no even grid, times that do not
            increase, or what else is missing, with the remedy.
    """
    own: dict[str, Any] = {"body": body, "conditions": conditions}
    # What this function takes for arrays, `read` takes for files under the same names.
    shared = {"ambient_density": ambient_density, "geometry": geometry, "spacing": spacing}
    if species not in (None, False):
        shared["species"] = species
    for_files = {**{name: value for name, value in shared.items() if value is not None}, **options}
    if isinstance(source, (str, Path)):
        path = Path(source)
        if any(letter in str(source) for letter in "*?["):
            return _of_files(_matching(path), time, time_step, start_time, _reader(read, for_files, density))
        if path.suffix == ".pvd" and path.is_file():
            paths, instants = _collection(path)
            return _of_files(paths, instants, None, 0.0, _reader(read, for_files, density))
        if path.is_dir() and (path / "system").is_dir():
            return _of_case(path, _reader(read, for_files, density))
        if options:
            raise TypeError(f"{path} is no file of `read`: it does not take {', '.join(options)}")
        return _of_file(path, density, ambient_density, cell_averages, species, own)
    if type(source).__module__.partition(".")[0] == "xarray":
        return _of_dataset(source, density, ambient_density, cell_averages, species, own, "xarray object", {})
    listed = hasattr(source, "__len__") and hasattr(source, "__getitem__")
    if not listed and not isinstance(source, Iterable):
        raise TypeError(
            f"a series is opened from a path, a pattern, a list or an iterator of arrays, got {type(source).__name__}"
        )
    items: Any = source
    if listed and len(items) == 0:
        raise ValueError("the series is empty: give at least one snapshot")
    if listed and isinstance(items[0], (str, Path)):
        return _of_files([Path(item) for item in items], time, time_step, start_time, _reader(read, for_files, density))
    get = items.__getitem__ if listed else InOrder(items)
    times = times_of(time, time_step, start_time, len(items) if listed else count)
    first = items[0] if listed else get.first()
    if isinstance(first, DensityField):
        return _of_fields(get, times, first, "density fields", once=not listed)
    array = host_array(first)
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


def _matching(pattern: Path) -> list[Path]:
    """The files of a pattern by the numbers in their names."""
    parts = pattern.parts
    first = next(k for k, part in enumerate(parts) if any(letter in part for letter in "*?["))
    root = Path(*parts[:first]) if first else Path()
    found = list(root.glob(str(Path(*parts[first:]))))
    if not found:
        raise ValueError(f"{pattern}: no file matches; check the folder and the pattern")
    return sorted(found, key=lambda path: [int(text) if text.isdigit() else text for text in _pieces(path.name)])


def _pieces(name: str) -> list[str]:
    return re.split(r"(\d+)", name)


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
    identity = {"files": [[path.name, path.stat().st_size] for path in paths]}
    described = f"{len(paths)} files from {paths[0].name} to {paths[-1].name}"
    return _of_fields(lambda number: reader(paths[number]), times, reader(paths[0]), described, identity=identity)


def _of_fields(get: Callable[[int], Any], times: np.ndarray, first: Any, described: str, **more: Any) -> Series:
    """A series of density fields: what the first one has counts for those that agree with it."""
    if not isinstance(first, DensityField):
        raise TypeError(f"{described}: read must return a DensityField, got {type(first).__name__}")
    conditions = getattr(first, "conditions", None)
    return Series(get, times, mesh_of(first), first.ambient_density, first.body, conditions, described, **more)


def _reader(read: Callable[..., DensityField] | None, options: dict[str, Any], density: str | None) -> Callable:
    """What reads a file, its options put in; volumes on one mesh are drawn into their grid once."""
    given: dict[str, Any] = options if density is None else {**options, "density": density}
    if read is None:
        return import_module(f"{__package__}.reading.reader").Reader(**given)
    return partial(read, **given)


def _collection(path: Path) -> tuple[list[Path], list[float]]:
    """The files of a ParaView collection, and their times."""
    try:
        entries = ElementTree.parse(path).getroot().iter("DataSet")
        found = sorted((float(one.attrib["timestep"]), one.attrib["file"]) for one in entries)
    except (ElementTree.ParseError, KeyError, ValueError) as fault:
        raise ValueError(f"{path}: no ParaView collection of files with their times: {fault}") from None
    if not found:
        raise ValueError(f"{path}: a collection without files")
    return [path.parent / file for _, file in found], [time for time, _ in found]


def _of_case(path: Path, reader: Callable[..., DensityField]) -> Series:
    """An OpenFOAM case by its time directories; those of a case in parts are its first part's."""
    root = path / "processor0" if (path / "processor0").is_dir() else path
    times = []
    for folder in root.iterdir():
        try:
            times += [float(folder.name)] if folder.is_dir() and any(folder.iterdir()) else []
        except ValueError:
            continue
    if not times:
        raise ValueError(f"{path}: an OpenFOAM case without time directories; run it, or reconstruct it")
    times.sort()
    identity = {"case": path.name, "times": times}
    return _of_fields(
        lambda number: reader(path, time=times[number]),
        np.array(times),
        reader(path, time=times[0]),
        f"{path}, {len(times)} times",
        identity=identity,
    )


def _of_file(path: Path, density: str | None, ambient: float | None, averages: bool, species: Any, own: dict) -> Series:
    if not path.exists():
        raise ValueError(f"{path}: no such file; give a NetCDF file, a Zarr store, or a pattern such as flow_*.vtu")
    if path.is_dir() and not any((path / name).exists() for name in ("zarr.json", ".zgroup", ".zmetadata")):
        raise ValueError(
            f"{path}: a folder, but no Zarr store; numbered files are opened by a pattern, 'dir/flow_*.vtu'"
        )
    dataset = (_zarr if path.is_dir() else open_netcdf)(path, f"{path}: its list of coordinates", most_axes=1)
    identity = {"file": path.name, "size": path.stat().st_size if path.is_file() else None}
    return _of_dataset(dataset, density, ambient, averages, species, own, str(path), identity)


def _zarr(path: Path, what: str, most_axes: float) -> Any:
    """A Zarr store as xarray has it; arguments as of `open_netcdf`."""
    try:
        import zarr  # noqa: F401
    except ImportError:
        raise ImportError(f"{path}: a Zarr store needs zarr: pip install 'aerokernels[dask]'") from None
    import xarray

    check_file(path, what, most_axes)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # that a store without consolidated metadata opens slowly
            return xarray.open_dataset(path, engine="zarr", chunks=None)
    except Exception as fault:
        raise ValueError(f"{path}: cannot be read as Zarr: {fault}") from None


def _of_dataset(
    data: Any, density: str | None, ambient: float | None, averages: bool, species: Any, own: dict, name: str, identity
) -> Series:
    """A series of an xarray object, of which one time is read at once."""
    if hasattr(data, "data_vars"):
        names = [density] if density is not None else [one for one in DENSITY_NAMES if one in data.data_vars]
        if not names or names[0] not in data.data_vars:
            wanted = density or "density, rho or the like"
            held = ", ".join(map(str, data.data_vars)) or "nothing"
            raise ValueError(f"{name}: no variable {wanted}; it holds {held}: give density=NAME")
        array, attributes = data[names[0]], {**data.attrs, **data[names[0]].attrs}
    else:
        array, attributes = data, dict(data.attrs)
    clock = next((one for one in TIME_NAMES if one in array.dims), None)
    if clock is None:
        raise ValueError(f"{name}: {array.name} has axes {', '.join(map(str, array.dims))} and no time")
    axes = next((one for one in _AXES if {clock, *one} == set(array.dims)), None)
    if axes is None:
        raise ValueError(
            f"{name}: {array.name} has axes {', '.join(map(str, array.dims))}: rename them to time and "
            "x, y, z, or y, z, or r, z"
        )
    array = array.transpose(clock, *axes)
    ends = [_even(name, axis, array) for axis in axes]
    where = GridMesh(
        _AXES[axes],
        np.array([first for first, _ in ends]),
        np.array([step for _, step in ends]),
        array.shape[1:],
        averages,
    )
    times = _in_si(name, clock, array, "time")
    factor = _factor(name, attributes.get("units"), "density", f"{array.name}")
    around = attributes.get("ambient_density") if ambient is None else ambient
    if around is None:
        raise ValueError(f"{name}: give ambient_density, that of the air around the field, in kg/m3")

    def get(number: int) -> np.ndarray:
        check_room(_snapshot_size(array), f"{name}: a snapshot")
        values = np.asarray(array.isel({clock: number}).values)
        return values if factor == 1.0 else values * factor

    identity = {**identity, "variable": array.name}
    if species not in (None, False):
        mixture = import_module(f"{__package__}.series_species").Mixture(name, data, array.dims, species)
        identity["species"] = mixture.identity
        return Series(
            lambda number: mixture.field(get(number), where, float(around), own, number),
            times, where, float(around), **own, provenance=f"{name}; {mixture.said}", identity=identity,
        )  # fmt: skip
    return Series(get, times, where, float(around), **own, provenance=name, identity=identity)


def _snapshot_size(array: Any) -> float:
    """What reading a time of an array takes [bytes]: a whole chunk of the file where that is more."""
    chunks = array.encoding.get("chunks") or array.encoding.get("chunksizes") or (0,)
    counts = (np.prod(array.shape[1:], dtype=float), np.prod(chunks, dtype=float))
    return float(max(counts)) * array.dtype.itemsize


def _in_si(name: str, axis: str, array: Any, dimension: str) -> np.ndarray:
    if axis not in array.coords:  # of which xarray would make numbers from 0 on
        raise ValueError(f"{name}: axis {axis} has no coordinate: add one")
    coordinate = array.coords[axis]
    values = np.asarray(coordinate.values)
    if np.issubdtype(values.dtype, np.datetime64) or np.issubdtype(values.dtype, np.timedelta64):
        since = values - values[0] if np.issubdtype(values.dtype, np.datetime64) else values
        return since / np.timedelta64(1, "s")
    return values.astype(np.float64) * _factor(name, coordinate.attrs.get("units"), dimension, axis)


def _factor(name: str, unit: Any, dimension: str, what: str) -> float:
    if unit is None or str(unit).strip() in ("", "1"):
        return 1.0
    text = str(unit).strip().replace(" m-3", "/m3").replace("kg m^-3", "kg/m3").replace("kg m**-3", "kg/m3")
    text = {"seconds": "s", "second": "s", "meter": "m", "metre": "m", "meters": "m", "metres": "m"}.get(text, text)
    try:
        return quantity(f"1 {text}", dimension)
    except ValueError as fault:
        raise ValueError(f"{name}: the unit of {what}: {fault}") from None


def _even(name: str, axis: str, array: Any) -> tuple[float, float]:
    """First node and spacing of an axis [m]."""
    places = _in_si(name, axis, array, "length")
    if len(places) < 2:
        raise ValueError(f"{name}: axis {axis} needs at least two nodes")
    step = (places[-1] - places[0]) / (len(places) - 1)
    off = np.abs(places - (places[0] + step * np.arange(len(places)))).max()
    if not step > 0.0 or off > UNEVEN * step:
        raise ValueError(f"{name}: the nodes of {axis} do not increase evenly: interpolate them on an even grid first")
    return float(places[0]), float(step)
