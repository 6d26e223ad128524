"""Convert polygons to the quadrilaterals of `QuadMesh`: quadrilaterals as they are, others cut conformingly.

Where a mesh has triangles or polygons, every cell is cut from its middle to the midpoints of its edges: a polygon of n
corners becomes n quadrilaterals, and neighbours share the midpoint of their common edge. Each part keeps the average of
its cell. Linear functions of point data are kept exactly.
"""

from collections.abc import Sequence

import numpy as np

from aerokernels.flow.reading.planes.polygon_cells import (
    Polygons,
    logical_rectangle,
    oriented,
    signed_area,
    turned,
    without_doubles,
)
from aerokernels.medium import QuadMesh

STRAIGHT = 1e-7  # sine of the turn at a corner; a smaller turn is a hanging node of a neighbour


def merged(parts: list[Polygons], closing: Sequence[bool] = ()) -> Polygons:
    """Merge the polygons of several blocks into one mesh: coincident points of different blocks become one.

    Args:
        parts: The polygons of each block.
        closing: Which blocks may close on themselves, as a grid around an aerofoil does along its wake: their own
            coincident points become one too, where values belong to cells. By default no block may.

    Raises:
        ValueError: Values of the cells in one block and of the points in another.
    """
    if len({part.where for part in parts}) > 1:
        raise ValueError("some blocks have their values in cells and others at points: give all the same way")
    if len(parts) == 1:
        return parts[0]
    points = np.concatenate([part.points for part in parts])
    first_point = np.cumsum([0, *(len(part.points) for part in parts)])
    first_corner = np.cumsum([0, *(len(part.corners) for part in parts)])
    block = np.repeat(np.arange(len(parts)), np.diff(first_point))
    step = 1e-9 * max(float(np.ptp(points, axis=0).max()), 1e-300)
    place = np.round((points - points.min(axis=0)) / step).astype(np.int64)
    # Coincident points of a block that does not close stay separate: it is damaged, and the mesh will reject it.
    _, repeat = np.unique(np.column_stack([block, place]), axis=0, return_inverse=True)
    order = np.argsort(repeat.ravel(), kind="stable")
    sorted_repeat = repeat.ravel()[order]
    begins = np.append(True, sorted_repeat[1:] != sorted_repeat[:-1])
    rank = np.empty(len(points), dtype=np.int64)
    rank[order] = np.arange(len(points)) - np.maximum.accumulate(np.where(begins, np.arange(len(points)), 0))
    if parts[0].where == "cell":
        rank[np.isin(block, np.flatnonzero(closing))] = 0
    _, first, same = np.unique(np.column_stack([place, rank]), axis=0, return_index=True, return_inverse=True)
    corners = np.concatenate([part.corners + shift for part, shift in zip(parts, first_point, strict=False)])
    start = np.concatenate([[0], *(part.start[1:] + shift for part, shift in zip(parts, first_corner, strict=False))])
    values = np.concatenate([part.values for part in parts])
    values = values[first] if parts[0].where == "point" else values
    return Polygons(points[first], start, same.ravel()[corners], values, parts[0].where).used()


def quad_mesh(polygons: Polygons, geometry: str) -> tuple[QuadMesh, np.ndarray, str]:
    """Return the mesh, its values, and a remark on what was changed, empty for nothing.

    Raises:
        ValueError: Folded cells, and what `QuadMesh` rejects: degenerate or double cells, duplicate points.
    """
    polygons, turned_cells = oriented(polygons)
    polygons, doubles = without_doubles(polygons)
    remark = "; ".join(filter(None, (turned_cells, doubles)))
    turns = _turns(polygons)
    if (polygons.width == 4).all() and ((turns > STRAIGHT).all() or (turns < -STRAIGHT).all()):
        cells = polygons.corners.reshape(-1, 4)
        rectangle = logical_rectangle(cells, len(polygons.points))
        if rectangle is None:
            return QuadMesh(polygons.points, cells, geometry), polygons.values, remark
        grid, order = rectangle
        y, z = polygons.points[grid].transpose(2, 0, 1)
        values = polygons.values[order if polygons.where == "cell" else grid]
        return QuadMesh.structured(y, z, geometry), values.reshape(-1, *polygons.values.shape[1:]), remark
    triangles, owner = _fans(turned(polygons, signed_area(polygons) < 0.0))
    whole = _cut_from_the_middle(triangles)
    cut = "cells that are not quadrilaterals were cut into as many as they have corners"
    parents = np.repeat(owner, triangles.width)
    mesh = QuadMesh(whole.points, whole.corners.reshape(-1, 4), geometry, parents=parents)
    return mesh, whole.values, f"{remark}; {cut}" if remark else cut


def _turns(polygons: Polygons) -> np.ndarray:
    """Return the sine of the turn at each corner."""
    following = polygons.following()
    point = polygons.points[polygons.corners]
    step = point[following] - point
    length = np.linalg.norm(step, axis=1)
    after, longer = step[following], length[following]
    turn = np.empty(len(point))
    with np.errstate(all="ignore"):
        turn[following] = (step[:, 0] * after[:, 1] - step[:, 1] * after[:, 0]) / (length * longer)
    return np.nan_to_num(turn)


def _means(polygons: Polygons, values: np.ndarray) -> np.ndarray:
    """Return the mean of point values over the corners of each polygon."""
    width = polygons.width if values.ndim == 1 else polygons.width[:, None]
    return np.asarray(np.add.reduceat(values[polygons.corners], polygons.start[:-1], axis=0) / width)


def _fans(polygons: Polygons) -> tuple[Polygons, np.ndarray]:
    """Divide polygons with a straight or reflex corner into triangles around their middles.

    Returns the polygons and the number of the original polygon of each. If a middle does not see the whole polygon, the
    triangles are formed from one of its corners.

    Raises:
        ValueError: Polygons that are folded over themselves.
    """
    poor = (np.minimum.reduceat(_turns(polygons), polygons.start[:-1]) <= STRAIGHT) & (polygons.width > 3)
    if not poor.any():
        return polygons, np.arange(len(poor))
    apex = np.full(len(poor), -1)
    apex[poor] = len(polygons.points) + np.arange(int(poor.sum()))
    points = np.concatenate([polygons.points, _means(polygons, polygons.points)[poor]])
    cell = np.repeat(np.arange(len(poor)), polygons.width)
    fan = np.flatnonzero(poor[cell])
    owner, one, other = cell[fan], polygons.corners[fan], polygons.corners[polygons.following()[fan]]
    for number in np.unique(owner[_twice_area(points[apex[owner]], points[one], points[other]) <= 0.0]):
        apex[number] = _seeing_corner(polygons, number)
    keep = (one != apex[owner]) & (other != apex[owner])
    triangles = np.stack([apex[owner], one, other], axis=1)[keep]
    rest = ~poor
    corners = np.concatenate([polygons.corners[rest[cell]], triangles.ravel()])
    width = np.concatenate([polygons.width[rest], np.full(len(triangles), 3)])
    if polygons.where == "cell":
        values = np.concatenate([polygons.values[rest], polygons.values[owner[keep]]])
    else:
        values = np.concatenate([polygons.values, _means(polygons, polygons.values)[poor]])
    parts = Polygons(points, np.concatenate([[0], np.cumsum(width)]), corners, values, polygons.where).used()
    return parts, np.concatenate([np.flatnonzero(rest), owner[keep]])


def _seeing_corner(polygons: Polygons, number: int) -> int:
    """Return the point of a polygon's corner from which the whole polygon is visible.

    Raises:
        ValueError: There is none: the polygon crosses itself, or is too strongly bent.
    """
    corners = polygons.corners[polygons.start[number] : polygons.start[number + 1]]
    place = polygons.points[corners]
    after = np.roll(place, -1, axis=0)
    if (place == after).all(axis=1).any():
        raise ValueError(f"cell {number} has coincident corners {place.tolist()}: merge duplicate nodes")
    for k, corner in enumerate(corners):
        twice = _twice_area(place[k], place, after)
        if (np.delete(twice, [k, k - 1]) > 0.0).all():
            return int(corner)
    raise ValueError(f"cell {number} is folded over itself: its corners are {place.tolist()}")


def _twice_area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return twice the area of triangles [m2], negative where they are listed clockwise."""
    return np.asarray((b - a)[..., 0] * (c - a)[..., 1] - (b - a)[..., 1] * (c - a)[..., 0])


def _cut_from_the_middle(polygons: Polygons) -> Polygons:
    """Cut every polygon of n corners into n quadrilaterals: corner, edge midpoint, middle, previous edge midpoint."""
    following, count = polygons.following(), len(polygons.points)
    ends = np.sort(np.stack([polygons.corners, polygons.corners[following]], axis=1), axis=1)
    edge, at = np.unique(ends, axis=0, return_inverse=True)
    at = at.ravel() + count
    cell = np.repeat(np.arange(len(polygons.width)), polygons.width)
    middle = count + len(edge) + cell
    before = np.empty(len(following), dtype=np.int64)
    before[following] = np.arange(len(following))
    quads = np.stack([polygons.corners, at, middle, at[before]], axis=1)
    points = np.concatenate([polygons.points, polygons.points[edge].mean(axis=1), _means(polygons, polygons.points)])
    if polygons.where == "cell":
        values = polygons.values[cell]
    else:
        own = polygons.values
        values = np.concatenate([own, own[edge].mean(axis=1), _means(polygons, own)])
    return Polygons(points, 4 * np.arange(len(quads) + 1), quads.ravel(), values, polygons.where)
