"""Give all polygons the same orientation, and reject folded meshes, which no order of corners can repair.

Two cells that share an edge run along it in opposite directions once both have the same orientation. If a cell that was
reversed runs along an edge in the same direction as its neighbour, both cells are on the same side of the edge: the
mesh is folded there, and its cells overlap.
"""

from dataclasses import replace

import numpy as np

from .polygon_cells import Polygons


def oriented(polygons: Polygons) -> tuple[Polygons, str]:
    """Return the polygons, all with the orientation of the majority, and a remark: empty if none was reversed.

    Raises:
        ValueError: Cells that are folded over their neighbours: how many, and the first of them.
    """
    clockwise = signed_area(polygons) < 0.0
    fewer = clockwise if clockwise.mean() <= 0.5 else ~clockwise
    if not fewer.any():
        return polygons, ""
    found = turned(polygons, fewer)
    _refuse_folded(found, fewer)
    return (
        found,
        f"{int(fewer.sum())} of {len(fewer)} cells were listed the other way round than the rest: they were turned",
    )


def turned(polygons: Polygons, which: np.ndarray) -> Polygons:
    """Return the polygons with the corners of some of them in reverse order."""
    first = np.repeat(polygons.start[:-1], polygons.width)
    last = np.repeat(polygons.start[1:], polygons.width) - 1
    place = np.arange(len(polygons.corners))
    source = np.where(np.repeat(which, polygons.width), first + last - place, place)
    return replace(polygons, corners=polygons.corners[source])


def signed_area(polygons: Polygons) -> np.ndarray:
    """Return the area of each polygon [m2], shape (cell_count,), negative where its corners are listed clockwise."""
    point = polygons.points[polygons.corners]
    point = point - np.repeat(point[polygons.start[:-1]], polygons.width, axis=0)
    after = point[polygons.following()]
    return np.asarray(0.5 * np.add.reduceat(point[:, 0] * after[:, 1] - point[:, 1] * after[:, 0], polygons.start[:-1]))


def _refuse_folded(polygons: Polygons, turned: np.ndarray) -> None:
    """Raise ValueError if a reversed cell runs along an edge in the same direction as a cell that was not reversed."""
    begin, end = polygons.corners, polygons.corners[polygons.following()]
    cell = np.repeat(np.arange(len(turned)), polygons.width)
    key = begin.astype(np.int64) * len(polygons.points) + end
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    one, other = cell[order][1:][same], cell[order][:-1][same]
    folded = turned[one] != turned[other]
    if not folded.any():
        return
    wrong = np.unique(np.where(turned[one], one, other)[folded])
    corners = polygons.points[polygons.corners[polygons.start[wrong[0]] : polygons.start[wrong[0] + 1]]]
    raise ValueError(
        f"{len(wrong)} of {len(turned)} cells are folded over their neighbours, the first is cell {wrong[0]} with "
        f"corners {corners.tolist()}"
    )
