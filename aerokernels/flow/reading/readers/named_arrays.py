"""Read named arrays from NPZ and HDF5 files, with coordinates along axes or for every sample.

Coordinates are arrays called x, y, z or r, z (`variables` names others): one number for each index along an axis, or
one for each sample. A field of r and z is axisymmetric. HDF5 files are read in the child process of fragile.py.

Without coordinate arrays, the two ends of each axis define uniform cells, and the arrays are taken as averages over
them. The ends are in `variables`, or in attributes of an HDF5 file called xmin and xmax, x_min and x_max, and so on.
"""

import math
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.inputs.checks import listed
from aerokernels.process.foreign_files import NoRoomError, check_room

from ..array_names import plain_name
from ..array_units import length_of, unit_of_array
from ..dataset import DAMAGED, HDF5_MAGIC, Block, Dataset, GridPoints, ReadError, chosen_time
from .coordinates import COLUMNS, PLACE, axes_of
from .hdf5_arrays import hdf5_arrays

PIECE = 1 << 24  # [bytes] read at once


def read(path: Path, time: Any = None, options: dict | None = None) -> Dataset:
    """Read a file of named arrays.

    Raises:
        ReadError: A damaged file, or one without coordinates.
    """
    variables, order = dict((options or {}).get("variables") or {}), (options or {}).get("order")
    with path.open("rb") as stream:
        head = stream.read(8)
    if path.suffix.lower() == ".npz":
        return arrays_as_dataset(path, _npz(path), {}, {}, variables, "NumPy arrays", time, order)
    if head == HDF5_MAGIC:
        held = hdf5_arrays(path)
        return arrays_as_dataset(
            path, held.arrays, held.units, held.ends, variables, "HDF5", time, order, held.labelled
        )
    raise ReadError(path, "it does not begin like an HDF5 file", DAMAGED)


def arrays_as_dataset(
    path: Path,
    arrays: dict[str, np.ndarray],
    units: dict[str, str],
    ends: dict[str, tuple[float, float]],
    variables: dict[str, Any],
    kind: str,
    time: Any,
    order: str | None = None,
    labelled: Collection[str] = (),
) -> Dataset:
    """Return the dataset of named arrays, their units and the ends of axes; `variables`, `order` are the caller's.

    The axes of `labelled` arrays are in a known order.
    """
    given = {axis: value for axis, value in variables.items() if not isinstance(value, str)}
    if given:  # ends of axes that a caller gives replace the file's coordinates
        arrays = {n: own for n, own in arrays.items() if not any(plain_name(n, True) in COLUMNS[a] for a in COLUMNS)}
    if order is not None and (not isinstance(order, str) or not order or set(order) - set("rxyz")):
        raise ReadError(path, f"order is {order!r}", "name the axes of the arrays: 'xy', 'yx', 'xyz', 'zyx', 'zr', ...")
    arrays, note = _with_even_cells(path, arrays, variables, given or ends, order)
    named = {a: v for a, v in variables.items() if a not in given}
    found = dataset_of(path, arrays, units, named, kind, time, labelled, order)
    return replace(found, notes=[*found.notes, note] if note else found.notes, grouped=True)


def _npz(path: Path) -> dict[str, np.ndarray]:
    import zipfile
    import zlib

    arrays: dict[str, np.ndarray] = {}
    objects = False
    try:
        # Not numpy.load, which looks through all names for each array.
        with zipfile.ZipFile(path) as archive:
            parts = archive.infolist()
            check_room(float(sum(part.file_size for part in parts)), f"{path}: it")
            for part in parts:
                with archive.open(part) as stream:
                    own = _array(part.filename, stream, part.file_size)
                if own is not None and own.dtype.hasobject:
                    objects = True
                elif own is not None:
                    arrays[part.filename.removesuffix(".npy")] = own
    except NoRoomError:
        raise
    except (
        zipfile.BadZipFile,
        zlib.error,
        ValueError,
        KeyError,
        OSError,
        EOFError,
        NotImplementedError,
        SyntaxError,
    ) as fault:
        raise ReadError(path, f"it is not a complete NPZ file ({fault})", DAMAGED) from None
    if not arrays and objects:
        raise ReadError(
            path,
            "it contains only Python objects, which are never unpickled, because that would run code in them",
            "save plain arrays: numpy.savez(path, x=..., y=..., density=...)",
        )
    return arrays


def _array(name: str, stream, size: int) -> np.ndarray | None:
    """Return an array of numbers of an NPZ file; None for other parts, an empty array for one of Python objects.

    Objects are never unpickled. An array whose header announces more numbers than its part of the file holds is
    rejected before it is allocated.
    """
    if not stream.peek(6).startswith(np.lib.format.MAGIC_PREFIX):
        return None
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"{name} is of version {version} of NumPy's format")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, kind = read(stream)
    if kind.hasobject:
        return np.empty(0, object)
    if math.prod(shape) * kind.itemsize > size:
        raise ValueError(f"{name} announces {math.prod(shape):.4g} numbers in {size} bytes")
    if kind.kind not in "iufb":
        return None
    room = np.empty(math.prod(shape) * kind.itemsize, np.uint8)
    for first in range(0, len(room), PIECE):
        piece = room[first : first + PIECE]
        if stream.readinto(piece) != len(piece):
            raise EOFError(f"{name} ends early")
    values = room.view(kind)
    return values.reshape(shape[::-1]).T if fortran else values.reshape(shape)


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


def dataset_of(
    path, arrays, units, variables, kind: str, time, labelled: Collection[str], order: str | None = None
) -> Dataset:
    """Return a dataset of named arrays; `variables` names coordinates by axis.

    The axes of `labelled` arrays are in a known order, those of others in the `order` that a caller gives; else they
    are identified by their lengths, where these tell it.
    """
    plain: dict[str, str] = {}
    for name in sorted(arrays, key=lambda name: name.count("/")):  # an array at the root counts before those in groups
        plain.setdefault(plain_name(name, True), name)
    chosen = {}
    for axis, names in COLUMNS.items():
        if axis in variables:
            if variables[axis] not in arrays:
                raise ReadError(
                    path, f"there is no array {variables[axis]!r}", f"take one of {listed(arrays, 'no arrays')}"
                )
            chosen[axis] = variables[axis]
        elif found := next((plain[name] for name in names if name in plain), None):
            chosen[axis] = found
    if unknown := set(variables) - set(COLUMNS):
        raise ReadError(path, f"variables: {sorted(unknown)[0]!r} is not a coordinate", "name x, y, z or r, z")
    axes, symmetry = axes_of(chosen)
    if len(axes) < 2:
        lacking = f"only {min(chosen)} is known, of two coordinates at least" if chosen else "no coordinates are known"
        raise ReadError(
            path, f"{lacking} (there are: {listed(arrays, 'no arrays')})",
            "call them x, y, z or r, z, or name them: variables={'x': 'NAME', ...}; a flow along one axis alone needs "
            "its samples repeated at two places of a second one",
        )  # fmt: skip
    chosen = {axis: chosen[axis] for axis in axes}
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
    told = order is not None or not along or all(n in labelled for n, a in arrays.items() if a.ndim > 1)
    lengths = [*map(len, coordinates)]
    # Of the other orders programs write numpy.meshgrid's, whose first two axes are exchanged, and the reversed one.
    if not told and block.shape and lengths in ([lengths[1], lengths[0], *lengths[2:]], lengths[::-1]):
        own, other = "".join(axes), "".join((axes[1], axes[0], *axes[2:]))
        unsure = (
            f"arrays taken as [{', '.join(axes)}], which equal lengths do not tell: say so by order = {own!r}, or "
            f"order = {other!r} for those of numpy.meshgrid"
        )
        notes = [*notes, unsure]
    geometry = None if symmetry is None else "axisymmetric"
    return Dataset([block], kind, geometry, times=times, time=taken, axis=symmetry, units=units, length=length,
                   notes=notes, unsure=unsure)  # fmt: skip


def _block(path, axes, coordinates, arrays, either: bool) -> tuple[Block, list[str]]:
    """Return the samples as a structured block, with the last axis of the arrays the slowest of the block, and notes.

    Arrays whose axes are in the opposite order are turned, if they may be in `either`. Samples at scattered points are
    joined like the points of a table.
    """
    if all(own.ndim == 1 for own in coordinates) and not _is_cloud(coordinates, arrays):
        counts = tuple(len(own) for own in coordinates)
        cells = tuple(n - 1 for n in counts)
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
            from .point_table import joined

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
        if turned.dtype not in (
            np.float16,
            np.float32,
        ):  # half precision stays visible, and is rejected where it is used
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


def _is_cloud(coordinates, arrays) -> bool:
    """Return whether coordinates of equal length belong to samples, not to axes."""
    counts = tuple(len(own) for own in coordinates)
    if len(set(counts)) > 1:
        return False
    grids = (counts, tuple(n - 1 for n in counts))
    return not any(own.shape in grids for own in arrays.values()) and any(
        own.shape == counts[:1] for own in arrays.values()
    )


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
