"""Give all polygons the same orientation, and reject folded meshes, which no order of corners can repair.

Two cells that share an edge run along it in opposite directions once both have the same orientation. If a cell that was
reversed runs along an edge in the same direction as its neighbour, both cells are on the same side of the edge: the
mesh is folded there, and its cells overlap.
"""

from dataclasses import replace

import numpy as np

from aerokernels.flow.reading.planes.polygon_cells import Polygons


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


def without_doubles(polygons: Polygons) -> tuple[Polygons, str]:
    """Return polygons of one orientation without those that occur twice with the same values, and a remark.

    Raises:
        ValueError: Other cells on the same side of an edge: how many overlap, and the first of them.
    """
    one, other = _on_one_side(polygons)
    if not len(one):
        return polygons, ""
    label = np.random.default_rng(6).integers(1, 2**63, len(polygons.points), dtype=np.uint64)
    cell_label = np.add.reduceat(label[polygons.corners], polygons.start[:-1])
    alike = cell_label[one] == cell_label[other]
    if polygons.where == "cell":
        alike &= (polygons.values[one] == polygons.values[other]).reshape(len(one), -1).all(axis=1)
    if not alike.all():
        wrong = np.unique(one[~alike])
        raise ValueError(f"{len(wrong)} of {len(polygons.width)} cells overlap others, {_first(polygons, wrong)}")
    keep = np.ones(len(polygons.width), bool)
    keep[one] = False
    return polygons.kept(keep), f"{int((~keep).sum())} cells that occur twice were left out"


def _on_one_side(polygons: Polygons) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of cells, the later one first, that run along an edge in the same direction."""
    begin, end = polygons.corners, polygons.corners[polygons.following()]
    cell = np.repeat(np.arange(len(polygons.width)), polygons.width)[begin != end]
    key = (begin.astype(np.int64) * len(polygons.points) + end)[begin != end]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    return cell[order][1:][same], cell[order][:-1][same]


def _first(polygons: Polygons, wrong: np.ndarray) -> str:
    corners = polygons.points[polygons.corners[polygons.start[wrong[0]] : polygons.start[wrong[0] + 1]]]
    return f"the first is cell {wrong[0]} with corners {corners.tolist()}"


def _refuse_folded(polygons: Polygons, turned: np.ndarray) -> None:
    """Raise ValueError if a reversed cell runs along an edge in the same direction as a cell that was not reversed."""
    one, other = _on_one_side(polygons)
    folded = turned[one] != turned[other]
    if folded.any():
        wrong = np.unique(np.where(turned[one], one, other)[folded])
        raise ValueError(
            f"{len(wrong)} of {len(turned)} cells are folded over their neighbours, {_first(polygons, wrong)}"
        )
