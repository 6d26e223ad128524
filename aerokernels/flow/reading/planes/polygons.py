"""Polygons in a plane with values, the first form of the cells of every two-dimensional file, and the mesh they make.

Where a mesh has triangles or polygons, every cell is cut from its middle to the midpoints of its edges: a polygon of n
corners becomes n quadrilaterals. Each part keeps the average of its cell, and linear functions of point data are kept.
Two cells of one orientation run along their common edge in opposite directions; otherwise the mesh is folded there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerokernels.flow.reading.dataset import starts_of
from aerokernels.medium import QuadMesh
from aerokernels.medium.mesh_cells import cells_across

STRAIGHT = 1e-7  # sine of the turn at a corner; a smaller turn is a hanging node of a neighbour


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons in a plane with a value for each cell or each point."""

    points: np.ndarray  # coordinates [m], shape (point_count, 2)
    start: np.ndarray  # first corner of each polygon, shape (cell_count + 1,)
    corners: np.ndarray  # points around each polygon, concatenated
    values: np.ndarray  # shape (cell_count,) or (point_count,), or with a second axis: several values for each
    where: str  # "cell" or "point"

    @property
    def cell(self) -> np.ndarray:
        """Number of the polygon of each corner."""
        return np.repeat(np.arange(len(self.width)), self.width)

    @property
    def width(self) -> np.ndarray:
        """Number of corners of each polygon."""
        return np.diff(self.start)

    def used(self) -> "Polygons":
        """Return the polygons without points that belong to no polygon."""
        kept, corners = np.unique(self.corners, return_inverse=True)
        values = self.values[kept] if self.where == "point" else self.values
        return replace(self, points=self.points[kept], corners=corners.ravel(), values=values)

    def kept(self, keep: np.ndarray) -> "Polygons":
        """Return some of the polygons."""
        corners = self.corners[np.repeat(keep, self.width)]
        values = self.values[keep] if self.where == "cell" else self.values
        return replace(self, start=starts_of(self.width[keep]), corners=corners, values=values).used()

    def without_repeats(self) -> "Polygons":
        """Return the polygons without corners that coincide with the previous one, as at the pole of a grid."""
        following = self.following()
        keep = (self.points[self.corners] != self.points[self.corners[following]]).any(axis=1)
        width = np.add.reduceat(keep, self.start[:-1])
        return replace(self, start=starts_of(width), corners=self.corners[keep]).kept(width > 2)

    def means(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of point values over the corners of each polygon."""
        width = self.width if values.ndim == 1 else self.width[:, None]
        return np.asarray(np.add.reduceat(values[self.corners], self.start[:-1], axis=0) / width)

    def shown(self, cell: int) -> str:
        """Describe a polygon for an error."""
        corners = self.points[self.corners[self.start[cell] : self.start[cell + 1]]]
        return f"the first is cell {cell} with corners {corners.tolist()}"

    def following(self) -> np.ndarray:
        """Return the index of the next corner of the same polygon, for each corner, shape (corner_count,)."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.start[1:] - 1] = self.start[:-1]
        return following


def joined(points: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the first of the points in each place, rounded to `near`, and the number of the place of each point."""
    place = np.round(points / near).astype(np.int64)
    _, first, number = np.unique(place, axis=0, return_index=True, return_inverse=True)
    return first, number.ravel()


def merged(parts: list[Polygons], closing: Sequence[bool] = ()) -> Polygons:
    """Merge the polygons of several blocks into one mesh: coincident points of different blocks become one.

    `closing` blocks may close on themselves, as a grid around an aerofoil does along its wake: their own coincident
    points become one too, where values belong to cells.
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
    rank = np.empty(len(points), dtype=np.int64)
    rank[order] = np.arange(len(points)) - np.searchsorted(sorted_repeat, sorted_repeat)
    if parts[0].where == "cell":
        rank[np.isin(block, np.flatnonzero(closing))] = 0
    _, first, same = np.unique(np.column_stack([place, rank]), axis=0, return_index=True, return_inverse=True)
    corners = np.concatenate([part.corners + shift for part, shift in zip(parts, first_point, strict=False)])
    start = np.concatenate([[0], *(part.start[1:] + shift for part, shift in zip(parts, first_corner, strict=False))])
    values = np.concatenate([part.values for part in parts])
    values = values[first] if parts[0].where == "point" else values
    return Polygons(points[first], start, same.ravel()[corners], values, parts[0].where).used()


def quad_mesh(polygons: Polygons, geometry: str) -> tuple[QuadMesh, np.ndarray, str]:
    """Return the mesh, its values, and a remark on what was changed, empty for nothing."""
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


def _fans(polygons: Polygons) -> tuple[Polygons, np.ndarray]:
    """Divide polygons with a straight or reflex corner into triangles, and return the original polygon of each part.

    They meet in the polygon's middle, or in one of its corners if the middle does not see the whole of it.
    """
    poor = (np.minimum.reduceat(_turns(polygons), polygons.start[:-1]) <= STRAIGHT) & (polygons.width > 3)
    if not poor.any():
        return polygons, np.arange(len(poor))
    apex = np.full(len(poor), -1)
    apex[poor] = len(polygons.points) + np.arange(int(poor.sum()))
    points = np.concatenate([polygons.points, polygons.means(polygons.points)[poor]])
    cell = polygons.cell
    fan = np.flatnonzero(poor[cell])
    owner, one, other = cell[fan], polygons.corners[fan], polygons.corners[polygons.following()[fan]]
    for number in np.unique(owner[_twice_area(points[apex[owner]], points[one], points[other]) <= 0.0]):
        apex[number] = _seeing_corner(polygons, number)
    keep = (one != apex[owner]) & (other != apex[owner])
    triangles = np.stack([apex[owner], one, other], axis=1)[keep]
    others = ~poor
    corners = np.concatenate([polygons.corners[others[cell]], triangles.ravel()])
    width = np.concatenate([polygons.width[others], np.full(len(triangles), 3)])
    if polygons.where == "cell":
        values = np.concatenate([polygons.values[others], polygons.values[owner[keep]]])
    else:
        values = np.concatenate([polygons.values, polygons.means(polygons.values)[poor]])
    parts = Polygons(points, starts_of(width), corners, values, polygons.where).used()
    return parts, np.concatenate([np.flatnonzero(others), owner[keep]])


def _seeing_corner(polygons: Polygons, number: int) -> int:
    """Return the point of a polygon's corner from which the whole polygon is visible, or refuse the polygon."""
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
    cell = polygons.cell
    middle = count + len(edge) + cell
    before = np.empty(len(following), dtype=np.int64)
    before[following] = np.arange(len(following))
    quads = np.stack([polygons.corners, at, middle, at[before]], axis=1)
    points = np.concatenate([polygons.points, polygons.points[edge].mean(axis=1), polygons.means(polygons.points)])
    if polygons.where == "cell":
        values = polygons.values[cell]
    else:
        own = polygons.values
        values = np.concatenate([own, own[edge].mean(axis=1), polygons.means(own)])
    return Polygons(points, 4 * np.arange(len(quads) + 1), quads.ravel(), values, polygons.where)


def oriented(polygons: Polygons) -> tuple[Polygons, str]:
    """Return the polygons, all with the orientation of the majority, and a remark; refuse cells folded over others."""
    clockwise = signed_area(polygons) < 0.0
    fewer = clockwise if clockwise.mean() <= 0.5 else ~clockwise
    if not fewer.any():
        return polygons, ""
    result = turned(polygons, fewer)
    one, other = _on_one_side(result)
    folded = fewer[one] != fewer[other]  # a reversed cell runs along an edge like one that was not reversed
    if folded.any():
        wrong = np.unique(np.where(fewer[one], one, other)[folded])
        raise ValueError(
            f"{len(wrong)} of {len(fewer)} cells are folded over their neighbours, {result.shown(wrong[0])}"
        )
    said = f"{fewer.sum()} of {len(fewer)} cells were listed the other way round than the rest: they were turned"
    return result, said


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
    """Return polygons of one orientation without those that occur twice, and a remark; refuse overlapping cells."""
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
        raise ValueError(f"{len(wrong)} of {len(polygons.width)} cells overlap others, {polygons.shown(wrong[0])}")
    keep = np.ones(len(polygons.width), bool)
    keep[one] = False
    return polygons.kept(keep), f"{int((~keep).sum())} cells that occur twice were left out"


def _on_one_side(polygons: Polygons) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of cells, the later one first, that run along an edge in the same direction."""
    begin, end = polygons.corners, polygons.corners[polygons.following()]
    cell = polygons.cell[begin != end]
    key = (begin.astype(np.int64) * len(polygons.points) + end)[begin != end]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    return cell[order][1:][same], cell[order][:-1][same]


def logical_rectangle(cells: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return vertices, shape (ni, nj), and cells, shape (ni - 1, nj - 1), of a structured mesh, or None.

    `cells` are the vertices around each cell, all in the same orientation, shape (cell_count, 4).
    """
    count = len(cells)
    degree = np.bincount(cells.ravel(), minlength=vertex_count)
    alone = np.flatnonzero(degree == 1)
    if degree.max() > 4 or len(alone) != 4:
        return None  # a logical rectangle has four corners
    behind = cells_across(cells, vertex_count)

    def corner(k: int) -> np.ndarray:
        return np.asarray(cells[cell, (start + k) % 4])

    holder, place = np.argwhere(cells == alone[0])[0]
    row, turn = [int(holder)], [int(place)]
    while len(row) <= count:
        # Cross the edge from corner 1 to corner 2; its ends become corners 0 and 3 of the next cell.
        following = int(behind[row[-1], (turn[-1] + 1) % 4])
        if following < 0:
            break
        shared = cells[row[-1], (turn[-1] + 1) % 4]
        row.append(following)
        turn.append(int(np.argmax(cells[following] == shared)))
    columns = len(row)
    if count % columns:
        return None
    cell, start = np.array(row), np.array(turn)
    rows, vertices = [cell], [corner(0), corner(3)]
    last = [int(corner(1)[-1]), int(corner(2)[-1])]
    for _ in range(count // columns - 1):
        shared = corner(3)
        cell = behind[cell, (start + 2) % 4]
        if (cell < 0).any():
            return None
        start = np.argmax(cells[cell] == shared[:, None], axis=1)
        if (corner(0) != shared).any():
            return None
        rows.append(cell)
        vertices.append(corner(3))
        last.append(int(corner(2)[-1]))
    order = np.stack(rows)
    grid = np.concatenate([np.stack(vertices), np.array(last)[:, None]], axis=1)
    expected = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1)
    whole = len(np.unique(order)) == count and grid.size == len(np.unique(grid)) == int((degree > 0).sum())
    if not whole or (np.sort(expected, axis=-1) != np.sort(cells[order], axis=-1)).any():
        return None
    return grid, order
