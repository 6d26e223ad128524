"""Which way round the corners of polygons are listed, put right; folded meshes, which no order of corners mends.

Two cells on either side of an edge that they share run along it in opposite directions, once both are listed the same
way round. A cell that was listed the other way and, turned round, runs along an edge like the cell next to it lies on
that cell's own side of the edge: the mesh is folded there, and its cells cover the same place twice.
"""

from dataclasses import replace

import numpy as np

from .polygon_cells import Polygons


def oriented(polygons: Polygons) -> tuple[Polygons, str]:
    """The same with every polygon the way round that most are, and a remark: empty where all were.

    Raises:
        ValueError: Cells that are folded over their neighbours: how many, and which is the first.
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
    """The same with the corners of some polygons in reverse."""
    first = np.repeat(polygons.start[:-1], polygons.width)
    last = np.repeat(polygons.start[1:], polygons.width) - 1
    place = np.arange(len(polygons.corners))
    source = np.where(np.repeat(which, polygons.width), first + last - place, place)
    return replace(polygons, corners=polygons.corners[source])


def signed_area(polygons: Polygons) -> np.ndarray:
    """Area of each polygon [m2], shape (cell_count,), negative where its corners are listed clockwise."""
    point = polygons.points[polygons.corners]
    point = point - np.repeat(point[polygons.start[:-1]], polygons.width, axis=0)
    after = point[polygons.following()]
    return np.asarray(0.5 * np.add.reduceat(point[:, 0] * after[:, 1] - point[:, 1] * after[:, 0], polygons.start[:-1]))


def _refuse_folded(polygons: Polygons, turned: np.ndarray) -> None:
    """Refuse turned cells that run along an edge like a cell that was not turned."""
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
