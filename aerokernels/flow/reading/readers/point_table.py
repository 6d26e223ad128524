"""Read CSV: a table of points, by its columns x, y, z (or r, z) and arrays.

Points on a grid are put back on it. Other points are joined by Delaunay triangles (in a plane) or tetrahedra (in
space), which also fill concave parts and bodies; slivers of nearly no volume are left out. A column of times that are
not all equal divides the table into the points of each time.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.array_names import plain_name
from aerokernels.flow.reading.array_units import length_of, unit_of_array
from aerokernels.flow.reading.dataset import (
    TETRAHEDRON,
    TRIANGLE,
    Block,
    Cells,
    Dataset,
    ReadError,
    check_points,
    chosen_time,
)
from aerokernels.flow.reading.readers.coordinates import COLUMNS, PLACE, axes_of
from aerokernels.flow.reading.readers.text_tables import read_table

TIMES = ("time", "timevalue", "flowtime", "physicaltime", "solutiontime", "simulationtime")
LEAST_POINTS = 4  # at a time: a column of other times is an array like any other
SAME = 1e-9  # of the extent: coordinates along an axis that are closer count as equal


def read(path: Path, time: Any = None, options: dict | None = None) -> Dataset:
    """Read a table of points.

    Raises:
        ReadError: A table without coordinates, or points that cannot be joined.
    """
    table = read_table(path)
    plain = {plain_name(name): name for name in reversed(table)}
    plain |= {re.sub(r"[^a-z0-9]", "", name.lower()): name for name in reversed(table)}
    known = {
        axis: next(plain[name] for name in names if name in plain)
        for axis, names in COLUMNS.items()
        if any(name in plain for name in names)
    }
    axes, symmetry = axes_of(known)
    columns = {PLACE[axis]: known[axis] for axis in axes}
    if len(columns) < 2:
        raise ReadError(
            path, f"no columns are known for coordinates (there are: {', '.join(table)})", "call them x, y, z or r, z"
        )
    length, factors = length_of(path, dict.fromkeys(columns.values(), ""))
    points = np.zeros((len(next(iter(table.values()))), 3))
    for (place, name), factor in zip(columns.items(), factors, strict=True):
        points[:, place] = table[name] * factor
    check_points(path, points)
    arrays = {name: values for name, values in table.items() if name not in columns.values()}
    times, chosen, kept = _at_time(path, points, arrays, time)
    block, note = joined(path, points[kept], {name: own[kept] for name, own in arrays.items()})
    geometry = None if symmetry is None else "axisymmetric"
    return Dataset(
        [block], "table of points", geometry, times=times, time=chosen, axis=symmetry, length=length, notes=note
    )


def _at_time(
    path: Path, points: np.ndarray, arrays: dict[str, np.ndarray], asked: Any
) -> tuple[list[float], float | None, slice | np.ndarray]:
    """Return the times of a table [s], the requested one of them, and its rows; its column of times leaves `arrays`."""
    every = slice(None)
    name = next((name for name in arrays if plain_name(name) in TIMES), None)
    if name is None and "t" in arrays and (np.ptp(arrays["t"]) == 0.0 or _coincide(points)):  # else a temperature
        name = "t"
    if name is None:
        return [], None, every
    if bad := int((~np.isfinite(arrays[name])).sum()):
        raise ReadError(path, f"{bad} of its {len(points)} times ({name}) are no numbers", "give each point its time")
    values, number, counts = np.unique(arrays[name], return_inverse=True, return_counts=True)
    if counts.min() < LEAST_POINTS:
        return [], None, every
    del arrays[name]
    times = (unit_of_array(path, name, "", "time").factor * values).tolist()
    chosen = chosen_time(path, times, asked)
    assert chosen is not None
    return times, chosen, every if len(times) == 1 else number.ravel() == times.index(chosen)


def _coincide(points: np.ndarray) -> bool:
    return len(np.unique(points, axis=0)) < len(points)


def joined(path, points: np.ndarray, arrays: dict[str, np.ndarray]) -> tuple[Block, list[str]]:
    """Return points as a grid where they form one, else as the cells of a Delaunay triangulation."""
    extent = np.ptp(points, axis=0)
    if (extent > 0.0).sum() < 2:
        raise ReadError(path, "its points are on a line", "give points of a plane or a volume")
    step = np.where(extent > 0.0, SAME * np.maximum(extent, 1e-300), 1.0)
    places = [
        np.unique(np.round((points[:, k] - points[:, k].min()) / step[k]).astype(np.int64), return_inverse=True)
        for k in range(3)
    ]
    shape = (len(places[0][0]), len(places[1][0]), len(places[2][0]))
    if np.prod(shape, dtype=float) == len(points):
        number = np.ravel_multi_index([index.ravel() for _, index in places[::-1]], shape[::-1])
        if len(np.unique(number)) == len(points):
            order = np.argsort(number)
            return Block(points[order], None, shape, {name: own[order] for name, own in arrays.items()}), []
    return _triangulated(path, points, arrays, extent > 0.0)


def _triangulated(path, points, arrays, wide) -> tuple[Block, list[str]]:
    from scipy.spatial import Delaunay, QhullError

    if len(np.unique(points, axis=0)) < len(points):
        raise ReadError(
            path,
            f"{len(points) - len(np.unique(points, axis=0))} points lie in the same place as another",
            "leave them out, or give those of several times a column 'time'",
        )
    flat = points[:, wide]
    try:
        corners = Delaunay((flat - flat.min(axis=0)) / np.ptp(flat, axis=0)).simplices.astype(np.int64)
    except (QhullError, ValueError):
        raise ReadError(path, "its points cannot be joined to cells", "give points of a plane or a volume") from None
    edge = flat[corners[:, 1:]] - flat[corners[:, :1]]
    measure = np.linalg.det(edge)
    corners = np.where((measure < 0.0)[:, None], corners[:, [1, 0, *range(2, corners.shape[1])]], corners)
    size = np.abs(measure)
    keep = size > 1e-9 * np.median(size)
    kind = TRIANGLE if flat.shape[1] == 2 else TETRAHEDRON
    note = "the points form no grid: they are joined by Delaunay cells, which also fill concave parts and bodies"
    return Block(points, Cells.of_one_type(kind, corners[keep]), point_data=arrays), [note]
