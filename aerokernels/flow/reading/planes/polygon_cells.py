"""Polygons in a plane with values: the first form of the cells of every two-dimensional file."""

from dataclasses import dataclass, replace

import numpy as np

from aerokernels.medium.mesh_cells import cells_across


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons in a plane with a value for each cell or each point.

    Attributes:
        points: Coordinates [m], shape (point_count, 2).
        start: First corner of each polygon, shape (cell_count + 1,).
        corners: Points around each polygon, concatenated.
        values: Shape (cell_count,) or (point_count,), or with a second axis: several values for each.
        where: "cell" or "point".
    """

    points: np.ndarray
    start: np.ndarray
    corners: np.ndarray
    values: np.ndarray
    where: str

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
        start = np.concatenate([[0], np.cumsum(self.width[keep])])
        values = self.values[keep] if self.where == "cell" else self.values
        return replace(self, start=start, corners=corners, values=values).used()

    def without_repeats(self) -> "Polygons":
        """Return the polygons without corners that coincide with the previous one, as at the pole of a grid."""
        following = self.following()
        keep = (self.points[self.corners] != self.points[self.corners[following]]).any(axis=1)
        width = np.add.reduceat(keep, self.start[:-1])
        start = np.concatenate([[0], np.cumsum(width)])
        return replace(self, start=start, corners=self.corners[keep]).kept(width > 2)

    def following(self) -> np.ndarray:
        """Return the index of the next corner of the same polygon, for each corner, shape (corner_count,)."""
        following = np.arange(1, len(self.corners) + 1)
        following[self.start[1:] - 1] = self.start[:-1]
        return following


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
    rows, vertices = [cell], [_corner(cells, cell, start, 0), _corner(cells, cell, start, 3)]
    last = [int(_corner(cells, cell, start, 1)[-1]), int(_corner(cells, cell, start, 2)[-1])]
    for _ in range(count // columns - 1):
        shared = _corner(cells, cell, start, 3)
        cell = behind[cell, (start + 2) % 4]
        if (cell < 0).any():
            return None
        start = np.argmax(cells[cell] == shared[:, None], axis=1)
        if (_corner(cells, cell, start, 0) != shared).any():
            return None
        rows.append(cell)
        vertices.append(_corner(cells, cell, start, 3))
        last.append(int(_corner(cells, cell, start, 2)[-1]))
    order = np.stack(rows)
    grid = np.concatenate([np.stack(vertices), np.array(last)[:, None]], axis=1)
    expected = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1)
    whole = len(np.unique(order)) == count and grid.size == len(np.unique(grid)) == int((degree > 0).sum())
    if not whole or (np.sort(expected, axis=-1) != np.sort(cells[order], axis=-1)).any():
        return None
    return grid, order


def _corner(cells: np.ndarray, cell: np.ndarray, start: np.ndarray, k: int) -> np.ndarray:
    return np.asarray(cells[cell, (start + k) % 4])
