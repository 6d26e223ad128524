"""Open a series from a file or object with a time axis: NetCDF, Zarr, xarray data sets and arrays."""

import warnings
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.files.netcdf_reading import open_netcdf
from aerokernels.flow.reading.arrays import ambient_attribute, known_names, stated_unit
from aerokernels.flow.reading.density import DENSITY_NAMES
from aerokernels.flow.reading.formats import files_behind, stamp
from aerokernels.flow.series import GridMesh, Series
from aerokernels.inputs.arguments import seconds
from aerokernels.inputs.checks import listed
from aerokernels.inputs.units import unit_of
from aerokernels.medium.labelled_grid import GEOMETRIES, even_nodes
from aerokernels.process.foreign_files import FileFault, check_file, check_room, fault_text

TIME_NAMES = ("time", "t", "Time")
# Fraction of a spacing by which nodes may deviate from an even grid: coordinates may be rounded to single precision.
UNEVEN = 1e-3


def opened(path: Path) -> tuple[Any, dict[str, Any]]:
    """Open a NetCDF file or a Zarr store: the xarray object, and the attributes of its `Series` that it determines."""
    if not path.exists():
        raise ValueError(f"{path}: no such file; give a NetCDF file, a Zarr store, or a pattern such as flow_*.vtu")
    if path.is_dir() and not any((path / name).exists() for name in ("zarr.json", ".zgroup", ".zmetadata")):
        raise ValueError(
            f"{path}: a folder, but no Zarr store; numbered files are opened by a pattern, 'dir/flow_*.vtu'"
        )
    written = stamp(files_behind(path))
    own = {"stamp": lambda number: written}
    return (_zarr if path.is_dir() else open_netcdf)(path, f"{path}: its list of coordinates", most_axes=1), own


def _zarr(path: Path, what: str, most_axes: float) -> Any:
    """Open a Zarr store with xarray; arguments as in `open_netcdf`."""
    try:
        import zarr  # noqa: F401
    except ImportError:
        raise ImportError(f"{path}: a Zarr store needs zarr: pip install 'aerokernels[dask]'") from None
    import xarray

    check_file(path, what, most_axes)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # about slow opening without consolidated metadata
            return xarray.open_dataset(path, engine="zarr", chunks=None)
    except Exception as fault:
        raise ValueError(f"{path}: cannot be read as Zarr: {fault}") from None


def series_of_dataset(data: Any, given: Mapping[str, Any], name: str, identity: Mapping[str, Any]) -> Series:
    """Return the series of an xarray object, of which one time at a time is read.

    `given` has the arguments of `open_series` that are for data with a time axis; `name` is for messages, and
    `identity` tells the series from others, in plain JSON types.
    """
    density = given.get("density")
    own: dict[str, Any] = {key: given.get(key) for key in ("body", "conditions")}
    unit = given.get("length_unit")
    if unit is not None:
        unit = import_module("aerokernels.flow.reading.read").unit_of_length(unit)
    if density is not None and not isinstance(density, str):
        raise ValueError(f"{name}: data with a time axis hold the density itself: give density=NAME, got {density!r}")
    if hasattr(data, "data_vars"):
        names = {str(own): own for own in data.data_vars}
        result = density if density is not None else next(map(names.get, known_names(names, DENSITY_NAMES)), None)
        if result is None or result not in data.data_vars:
            wanted = density or "density, rho or the like"
            raise ValueError(f"{name}: no variable {wanted}; it holds {listed(data.data_vars)}: give density=NAME")
        array, attributes = data[result], {**data.attrs, **data[result].attrs}
    else:
        array, attributes = data, dict(data.attrs)
    clock = next((one for one in TIME_NAMES if one in array.dims), None)
    if clock is None:
        raise ValueError(f"{name}: {array.name} has axes {', '.join(map(str, array.dims))} and no time")
    axes = next((one for one in GEOMETRIES if sorted((clock, *one)) == sorted(map(str, array.dims))), None)
    if axes is None:
        raise ValueError(
            f"{name}: {array.name} has axes {', '.join(map(str, array.dims))}: rename them to time and "
            "x, y, z, or y, z, or r, z"
        )
    nodes = {axis: _along(name, array.coords[axis]) for axis in axes if axis in array.coords}
    turned = {axis: slice(None, None, -1) for axis, own in nodes.items() if len(own) > 1 and own[0] > own[-1]}
    if turned:
        data, array = data.isel(turned), array.isel(turned)
    array = array.transpose(clock, *axes)
    nodes = {axis: _in_si(name, axis, array, "length", unit) for axis in axes}
    first, step = np.transpose([even_nodes(own, f"{name}: axis {axis}", UNEVEN) for axis, own in nodes.items()])
    where = GridMesh(GEOMETRIES[axes], first, step, array.shape[1:], bool(given.get("cell_averages")))
    times = _in_si(name, clock, array, "time")
    stated = array.coords[clock].dtype.kind in "mM" or stated_unit(
        {**array.coords[clock].encoding, **array.coords[clock].attrs}
    )
    described = name + ("" if stated else f"; no unit is stated, taken: {clock} in s")
    factor = _factor(name, stated_unit(attributes), "density", f"{array.name}")
    around = given.get("ambient_density")
    if around is None:
        first = np.asarray(array.isel({clock: 0}).values) if factor != 1.0 else np.empty(0)
        around = ambient_attribute(name, attributes.get("ambient_density"), factor, first)
    if around is None:
        raise ValueError(f"{name}: give ambient_density, that of the air around the field, in kg/m3")
    if np.ndim(around) or not np.can_cast(np.asarray(around).dtype, np.float64):
        raise ValueError(f"{name}: ambient_density must be one number, in kg/m3, got {str(around)[:40]!r}")

    # At least a whole chunk of the file is read.
    chunks = array.encoding.get("chunks") or array.encoding.get("chunksizes") or (0,)
    counts = (np.prod(array.shape[1:], dtype=float), np.prod(chunks, dtype=float))
    size = float(max(counts)) * array.dtype.itemsize

    def get(number: int) -> np.ndarray:
        check_room(size, f"{name}: a snapshot")
        values = _numbers(name, array.isel({clock: number}), "iuf")
        return values if factor == 1.0 else values * factor

    identity = {**identity, "variable": array.name}
    return Series(get, times, where, float(around), **own, provenance=described, identity=identity)


def _along(name: str, coordinate: Any) -> np.ndarray:
    """Return the values of a coordinate along its own axis."""
    if coordinate.ndim != 1:
        axes = ", ".join(map(str, coordinate.dims)) or "no axis"
        raise ValueError(f"{name}: coordinate {coordinate.name} is over {axes}: give it along its own axis alone")
    return _numbers(name, coordinate)


def _numbers(name: str, array: Any, kinds: str = "iufmM") -> np.ndarray:
    """Return the values of an array, numbers or times. xarray decodes them by attributes, which may be anything."""
    try:
        values = np.asarray(array.values)
    except FileFault:
        raise
    except Exception as fault:  # the libraries raise any kind of error for damaged data
        remedy = "see its attributes, or write it again"
        raise ValueError(f"{name}: {array.name} cannot be read ({fault_text(fault)}): {remedy}") from fault
    if values.dtype.kind not in kinds:
        raise ValueError(f"{name}: {array.name} holds no real numbers but {values.dtype}: write it again as numbers")
    return values


def _in_si(name: str, axis: str, array: Any, dimension: str, unit: float | None = None) -> np.ndarray:
    if axis not in array.coords:  # xarray would number the nodes from 0
        raise ValueError(f"{name}: axis {axis} has no coordinate: add one")
    coordinate = array.coords[axis]
    values = _along(name, coordinate)
    if values.dtype.kind in "mM":
        return seconds(values)
    if unit is None:
        unit = _factor(name, stated_unit(coordinate.attrs), dimension, axis)
    return values.astype(np.float64) * unit


def _factor(name: str, unit: str, dimension: str, what: str) -> float:
    try:
        result = unit_of(unit, dimension)
    except ValueError as fault:
        raise ValueError(f"{name}: the unit of {what}: {fault}; write it in SI") from None
    return result.factor
