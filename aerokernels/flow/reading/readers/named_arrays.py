"""Read NPZ, whose objects are never unpickled, and make datasets of the named arrays of it, HDF5 and NetCDF.

Coordinates are arrays called x, y, z or r, z (`variables` names others): one number for each index along an axis, or
one for each sample. Without them, the two ends of each axis, in `variables` or in attributes of an HDF5 file, define
uniform cells, and the arrays are taken as averages over them. A field of r and z is axisymmetric.
"""

import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.arrays import COLUMNS, PLACE, coordinates_of, length_of, plain_name, unit_of_array
from aerokernels.flow.reading.dataset import DAMAGED, Block, Dataset, GridPoints, ReadError, chosen_time
from aerokernels.inputs.checks import listed
from aerokernels.process.foreign_files import check_room

NOTHING: Mapping[str, Any] = {}


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a file of named arrays."""
    arrays: dict[str, np.ndarray] = {}
    objects = False
    with np.load(path, allow_pickle=False) as file:
        check_room(float(sum(part.file_size for part in file.zip.infolist())), f"{path}: it")
        for name in file.files:
            try:
                values = file[name]
            except ValueError as fault:
                if "allow_pickle" not in str(fault):
                    raise
                objects = True
                continue
            if isinstance(values, np.ndarray) and values.dtype.kind in "iufb":  # other parts are bytes
                arrays[name] = values
    if not arrays and objects:
        raise ReadError(
            path,
            "it contains only Python objects, which are never unpickled, because that would run code in them",
            "save plain arrays: numpy.savez(path, x=..., y=..., density=...)",
        )
    return arrays_as_dataset(path, arrays, "NumPy arrays", time, options)


def arrays_as_dataset(
    path: Path,
    arrays: dict[str, np.ndarray],
    kind: str,
    time: Any,
    options: Mapping[str, Any],
    *,
    units: Mapping[str, str] = NOTHING,
    ends: Mapping[str, tuple[float, float]] = NOTHING,
    labelled: Collection[str] = (),
    grouped: bool = True,
) -> Dataset:
    """Return the dataset of named arrays; `options` are the caller's `variables` and `order`.

    `units` of arrays and `ends` of axes are what the file states. The axes of `labelled` arrays are in a known order,
    those of others in the caller's `order`; else they are identified by their lengths, where these tell it.
    """
    variables, order = dict(options.get("variables") or {}), options.get("order")
    wanted = {axis: value for axis, value in variables.items() if not isinstance(value, str)}
    if wanted:  # ends of axes that a caller gives replace the file's coordinates
        arrays = {n: own for n, own in arrays.items() if not any(plain_name(n, True) in COLUMNS[a] for a in COLUMNS)}
    if order is not None and (not isinstance(order, str) or not order or set(order) - set("rxyz")):
        raise ReadError(path, f"order is {order!r}", "name the axes of the arrays: 'xy', 'yx', 'xyz', 'zyx', 'zr', ...")
    arrays, note = _with_even_cells(path, arrays, variables, wanted or ends, order)
    variables = {axis: name for axis, name in variables.items() if axis not in wanted}
    if unknown := set(variables) - set(COLUMNS):
        raise ReadError(path, f"variables: {sorted(unknown)[0]!r} is not a coordinate", "name x, y, z or r, z")
    if missing := [name for name in variables.values() if name not in arrays]:
        raise ReadError(path, f"there is no array {missing[0]!r}", f"take one of {listed(arrays, 'no arrays')}")
    chosen, symmetry = coordinates_of(arrays, True, variables)
    axes = tuple(chosen)
    if len(axes) < 2:
        lacking = f"only {axes[0]} is known, of two coordinates at least" if axes else "no coordinates are known"
        raise ReadError(
            path, f"{lacking} (there are: {listed(arrays, 'no arrays')})",
            "call them x, y, z or r, z, or name them: variables={'x': 'NAME', ...}; a flow along one axis alone needs "
            "its samples repeated at two places of a second one",
        )  # fmt: skip
    times, arrays, taken = _at_time(path, arrays, chosen, units, time)
    coordinates = [np.asarray(arrays[chosen[axis]], dtype=np.float64) for axis in axes]
    length, factors = length_of(path, {chosen[axis]: units.get(chosen[axis], "") for axis in axes})
    coordinates = [own * factor for own, factor in zip(coordinates, factors, strict=True)]
    along = all(own.ndim == 1 for own in coordinates)  # else each sample states its place
    arrays = {n: a for n, a in arrays.items() if n not in chosen.values()}
    if order is not None and along:
        if sorted(order) != sorted(axes):
            raise ReadError(path, f"order is {order!r}, and its axes are {', '.join(axes)}", "name each of them once")
        places = [order.index(axis) for axis in axes]
        turned = {n: a.transpose(places) for n, a in arrays.items() if a.ndim == len(axes) and n not in labelled}
        arrays = {**arrays, **turned}
    block, notes = _block(path, axes, coordinates, arrays, order is None or not along)
    unsure = ""
    is_known = order is not None or not along or all(n in labelled for n, a in arrays.items() if a.ndim > 1)
    lengths = [*map(len, coordinates)]
    # Of the other orders programs write numpy.meshgrid's, whose first two axes are exchanged, and the reversed one.
    if not is_known and block.shape and lengths in ([lengths[1], lengths[0], *lengths[2:]], lengths[::-1]):
        own, other = "".join(axes), "".join((axes[1], axes[0], *axes[2:]))
        unsure = (
            f"arrays taken as [{', '.join(axes)}], which equal lengths do not tell: say so by order = {own!r}, or "
            f"order = {other!r} for those of numpy.meshgrid"
        )
        notes = [*notes, unsure]
    geometry = None if symmetry is None else "axisymmetric"
    return Dataset([block], kind, geometry, times=times, time=taken, axis=symmetry, units=units, length=length,
                   notes=[*notes, note] if note else notes, unsure=unsure, grouped=grouped)  # fmt: skip


def _with_even_cells(path, arrays, variables, ends, order) -> tuple[dict[str, np.ndarray], str]:
    """Return the arrays with the edges of uniform cells if they have no coordinates, and a note."""
    if not ends or any(plain_name(name, True) in names for name in arrays for names in COLUMNS.values()):
        return arrays, ""
    if any(isinstance(value, str) for value in variables.values()):
        return arrays, ""
    pairs: dict[str, np.ndarray] = {}
    for axis, pair in ends.items():
        numbers = np.asarray(pair)
        whole = axis in COLUMNS and numbers.shape == (2,) and numbers.dtype.kind in "iuf" and np.isfinite(numbers).all()
        if not whole or not numbers[0] < numbers[1]:
            raise ReadError(path, f"the ends of {axis} are {pair!r}", "give two numbers that increase: x = [0.0, 1.0]")
        pairs[axis] = numbers.astype(np.float64)
    shapes = [own.shape for own in arrays.values() if own.ndim >= 2 and min(own.shape) > 1]
    count = max((len(shape) for shape in shapes), default=0)
    axes = [axis for axis in (order or "rxyz") if axis in pairs]
    shape = max(shapes, key=shapes.count, default=())
    if len(axes) > count == 2:  # ignore the ends of the third axis of a plane file
        axes = axes[:2]
    if len(axes) != len(shape):
        return arrays, ""
    edges = {axis: np.linspace(pairs[axis][0], pairs[axis][1], n + 1) for axis, n in zip(axes, shape, strict=True)}
    said = ", ".join(f"{axis} from {pairs[axis][0]:g} to {pairs[axis][1]:g}" for axis in axes)
    return {**edges, **arrays}, f"taken as averages over {' x '.join(map(str, shape))} even cells, {said}"


def _block(path, axes, coordinates, arrays, either: bool) -> tuple[Block, list[str]]:
    """Return the samples as a structured block, with the last axis of the arrays the slowest of the block, and notes.

    Arrays whose axes are in the opposite order are turned, if they may be in `either`. Samples at scattered points are
    joined like the points of a table.
    """
    counts = tuple(len(own) for own in coordinates)
    cells = tuple(n - 1 for n in counts)
    along = all(own.ndim == 1 for own in coordinates)
    if along and len(set(counts)) == 1:  # of samples where there is an array of one for each, and none on a grid
        shapes = {own.shape for own in arrays.values()}
        along = counts in shapes or cells in shapes or counts[:1] not in shapes
    if along:
        if 0 in counts or not any({own.shape, own.shape[::-1]} & {counts, cells} for own in arrays.values()):
            raise _no_samples(path, counts, arrays)  # before meshgrid: a few numbers may announce billions of points
        if len(counts) == 3:
            points = GridPoints.of(coordinates)
        full = np.meshgrid(*coordinates, indexing="ij") if len(counts) < 3 else []
    else:
        shapes = {own.shape for own in coordinates}
        if len(shapes) > 1:
            raise ReadError(
                path,
                f"coordinates have shapes {sorted(shapes)}",
                "give one for each index along an axis, or for each sample",
            )
        counts = shapes.pop()
        if len(counts) == 1:
            from aerokernels.flow.reading.readers.point_table import joined

            points = np.zeros((counts[0], 3))
            for axis, own in zip(axes, coordinates, strict=True):
                points[:, PLACE[axis]] = own
            return joined(path, points, {n: np.asarray(a, float) for n, a in arrays.items() if a.shape == counts})
        cells = tuple(n - 1 for n in counts)
        full = coordinates
    if full:
        points = np.zeros((int(np.prod(counts)), 3))
        for axis, own in zip(axes, full, strict=True):
            points[:, PLACE[axis]] = own.ravel(order="F")
    point_data, cell_data = {}, {}
    for name, own in arrays.items():
        turned = own
        if either and own.shape not in (counts, cells) and own.shape[::-1] in (counts, cells):
            turned = own.T  # as C programs and NetCDF write (z, y, x)
        # Half precision stays visible, and is rejected where it is used.
        if turned.dtype not in (np.float16, np.float32):
            turned = np.asarray(turned, dtype=np.float64)
        if turned.shape == counts:
            point_data[name] = turned.ravel(order="F")
        elif turned.shape == cells and min(cells) > 0:
            cell_data[name] = turned.ravel(order="F")
    shape = (*counts, 1)[:3] if len(counts) < 3 else counts
    if not point_data and not cell_data:
        raise _no_samples(path, counts, arrays)
    return Block(points, None, (int(shape[0]), int(shape[1]), int(shape[2])), point_data, cell_data), []


def _no_samples(path, counts: tuple[int, ...], arrays) -> ReadError:
    held = ", ".join(f"{name} {own.shape}" for name, own in list(arrays.items())[:8]) or "none"
    what = f"no array has a sample for each of the {counts} places (there are: {held})"
    return ReadError(path, what, "give arrays over x, y, z, or r, z, and name their coordinates: variables={'x': ...}")


def _at_time(path, arrays, chosen, units, asked):
    """Return the arrays at one time, if there is an axis of time: it comes first."""
    name = next((name for name in arrays if plain_name(name, True) in ("time", "t") and arrays[name].ndim == 1), None)
    rank = max((arrays[own].ndim for own in chosen.values()), default=1)
    rank = len(chosen) if rank == 1 else rank
    times = []
    if name is not None and any(a.ndim == rank + 1 and a.shape[0] == len(arrays[name]) for a in arrays.values()):
        since = units.get(name, "").split(" since ")[0]  # "seconds since 2020-01-01"
        unit = unit_of_array(path, name, since, "time").factor
        times = [float(value) * unit for value in arrays[name]]
    if bad := [k for k, value in enumerate(times) if not math.isfinite(value)]:
        raise ReadError(
            path, f"{len(bad)} of its {len(times)} times are no numbers, the first is number {bad[0]}", DAMAGED
        )
    ascending = sorted(set(times))
    chosen_one = chosen_time(path, ascending, asked)
    if chosen_one is None:
        return [], arrays, None
    if times.count(chosen_one) > 1:
        what = f"it has {times.count(chosen_one)} fields at the time {chosen_one:g}, as after a restart"
        raise ReadError(path, what, "keep one of them, or take another time")
    index = times.index(chosen_one)
    cut = {
        n: a[index] if a.ndim == rank + 1 and a.shape[0] == len(times) else a for n, a in arrays.items() if n != name
    }
    return ascending, cut, chosen_one
