"""Linear reconstruction of the density in solid cells, from averages over cells or from values at points.

In every cell the density is its value at a middle plus a slope, kept within what the cell and its corners have. The
average over a cell stays what the file says; linear functions of point data are kept exactly. What of this the mesh
alone decides is worked out once; each set of densities then costs a pass over the cells.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .dataset import Block
from .raster import CellFacts
from .solids import Chunk, corner_chunks, corner_counts


@dataclass(frozen=True, eq=False)
class Linear:
    """A linear function in each cell.

    Attributes:
        value: Its average over the cell, shape (n,).
        function: Value at the origin, slope, least and greatest value allowed, shape (n, 6).
        origin: The point that places are counted from [m].
    """

    value: np.ndarray
    function: np.ndarray
    origin: tuple[float, float, float]

    def at(self, cell: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Values at points (n, 3) that lie in cells (n,)."""
        own = self.function[cell]
        rise = np.einsum("nk,nk->n", points - np.array(self.origin), own[:, 1:4])
        return np.clip(own[:, 0] + rise, own[:, 4], own[:, 5])

    @classmethod
    def joined(cls, parts: list["Linear"]) -> "Linear":
        """The cells of several blocks, one after the other."""
        if len(parts) == 1:
            return parts[0]
        value, function = ([getattr(part, name) for part in parts] for name in ("value", "function"))
        return cls(np.concatenate(value), np.concatenate(function), parts[0].origin)


@dataclass(frozen=True, eq=False)
class Rows:
    """For each row the numbers that it lists: `column[start[row]:start[row + 1]]`.

    Attributes:
        start: int64, shape (row_count + 1,).
        column: int32.
    """

    start: np.ndarray
    column: np.ndarray

    @classmethod
    def sorted(cls, row: np.ndarray, column: np.ndarray, count: int) -> tuple["Rows", np.ndarray]:
        """Pairs put in the order of their rows, and that order."""
        order = np.argsort(row, kind="stable")
        start = np.zeros(count + 1, np.int64)
        np.cumsum(np.bincount(row, minlength=count), out=start[1:])
        return cls(start, column[order].astype(np.int32)), order

    def taken(self, row: np.ndarray) -> tuple["Rows", np.ndarray]:
        """Some of the rows in another order, and where their entries stood."""
        begin, width = self.start[row], np.diff(self.start)[row]
        start = np.zeros(len(row) + 1, np.int64)
        np.cumsum(width, out=start[1:])
        entry = np.arange(start[-1]) + np.repeat(begin - start[:-1], width)
        return Rows(start, self.column[entry]), entry

    def means(self, values: np.ndarray) -> np.ndarray:
        """The mean of the values that each row lists, 0 where it lists none."""
        from .mesh_kernels import launch, mean_of_listed

        result = np.empty(len(self.start) - 1)
        launch(mean_of_listed, len(result), self.start, self.column, np.ascontiguousarray(values), result)
        return result


class Reconstruction:
    """What the mesh of a block decides of the linear functions in its cells."""

    def __init__(self, block: Block, points: np.ndarray, where: str, facts: CellFacts):
        """Work it out.

        Args:
            block: The block.
            points: Its points in the optical frame [m], shape (point_count, 3).
            where: Whether densities are of a "cell" or a "point".
            facts: Of its cells.
        """
        self.where, self.middle = where, facts.middle
        self.count = block.cell_count if where == "cell" else len(points)
        self.by_faces = block.cells is not None and block.cells.faces is not None
        self.corners = _corners(block)
        self._of_points: Rows | None = None
        if self.by_faces:
            self.rows, self.weight = _between_neighbours(block, points, facts)
            if where == "point":
                self.corners = _face_points(block)
        else:
            self.rows = self.corners
            self.weight, centre = _fitted(block, points, self.corners)
            if where == "point":
                self.middle = centre
            else:
                self._of_points = _cells_at_points(block, self.corners, len(points))

    def forget_slopes(self) -> None:
        """Let go of what makes slopes: `values` does without."""
        self.rows = Rows(np.zeros(1, np.int64), np.empty(0, np.int32))
        self.weight, self.middle = np.empty((0, 3)), np.empty((0, 3))
        if self.where == "cell":
            self.corners = self.rows

    def values(self, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The average of each cell, and what `rows` lists the numbers of, for densities of the cells or the points."""
        given = np.ascontiguousarray(density, dtype=np.float64)
        value = self.corners.means(given) if self.where == "point" else given
        return value, value if self.by_faces else given if self._of_points is None else self._of_points.means(given)


@dataclass(frozen=True, eq=False)
class SomeCells:
    """Cells of a block whose linear functions are asked for at places of their own."""

    cell: np.ndarray
    rows: Rows
    weight: np.ndarray
    middle: np.ndarray

    @classmethod
    def of(cls, part: Reconstruction, cell: np.ndarray) -> "SomeCells":
        """Those of a block by their numbers."""
        rows, entry = part.rows.taken(cell)
        return cls(cell, rows, part.weight[entry], part.middle[cell])

    def linear(self, value: np.ndarray, near: np.ndarray, origin) -> Linear:
        """Their linear functions from what `Reconstruction.values` gives; places are counted from `origin` [m]."""
        from .mesh_kernels import launch, linear_functions

        own, function, origin = value[self.cell], np.empty((len(self.cell), 6)), tuple(float(x) for x in origin)
        launch(
            linear_functions, len(own), self.rows.start, self.rows.column, self.weight, near, own, self.middle, origin,
            function,
        )  # fmt: skip
        return Linear(own, function, origin)


def _corners(block: Block) -> Rows:
    """The corners of each solid cell; none of a polyhedron."""
    start = np.zeros(block.cell_count + 1, np.int64)
    np.cumsum(corner_counts(block), out=start[1:])
    column = np.empty(start[-1], np.int32)
    for chunk in corner_chunks(block):
        column[start[chunk.cell] + np.arange(len(chunk.corners))[:, None]] = chunk.corners
    return Rows(start, column)


def _face_points(block: Block) -> Rows:
    """The points of all faces of each cell; one that several faces share as often as they do."""
    assert block.cells is not None and block.cells.faces is not None
    faces = block.cells.faces
    width = np.diff(faces.start)
    inner = len(faces.neighbour)
    last = int(faces.start[inner])
    row = np.concatenate([np.repeat(faces.owner, width), np.repeat(faces.neighbour, width[:inner])])
    return Rows.sorted(row, np.concatenate([faces.points, faces.points[:last]]), block.cell_count)[0]


def _cells_at_points(block: Block, corners: Rows, point_count: int) -> Rows:
    """The cells at each point, those without flow left out."""
    cell = np.repeat(np.arange(len(corners.start) - 1, dtype=np.int32), np.diff(corners.start))
    point = corners.column
    if block.blank is not None and len(block.blank) == block.cell_count:
        keep = ~block.blank[cell]
        cell, point = cell[keep], point[keep]
    return Rows.sorted(point, cell, point_count)[0]


def _fitted(block: Block, points: np.ndarray, corners: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the corners in the slope that fits them best, shape (entry_count, 3), and the means of the corners."""
    weight, centre = np.empty((len(corners.column), 3)), np.zeros((block.cell_count, 3))
    across = np.ascontiguousarray(points.T)

    def work(chunk: Chunk) -> None:
        reach = across[:, chunk.corners]
        mean = reach.mean(axis=1)
        centre[chunk.cell] = mean.T
        found = _weights(reach - mean[:, None])
        begin = corners.start[chunk.cell]
        for corner in range(len(chunk.corners)):
            weight[begin + corner] = found[:, corner].T

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for _ in pool.map(work, corner_chunks(block)):
            pass
    return weight, centre


def _weights(step: np.ndarray) -> np.ndarray:
    """Weights of values at places `step` from their mean (3, k, n) in the slope that fits them best, same shape."""
    square = {(i, j): (step[i] * step[j]).sum(axis=0) for i in range(3) for j in range(i, 3)}
    xx, xy, xz, yy, yz, zz = (square[key] for key in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    determinant = xx * a + xy * b + xz * c
    good = np.abs(determinant) > 1e-30 * (xx + yy + zz) ** 3
    inverse = np.where(good, 1.0, 0.0) / np.where(good, determinant, 1.0)
    return np.stack([
        (a * step[0] + b * step[1] + c * step[2]) * inverse,
        (b * step[0] + d * step[1] + e * step[2]) * inverse,
        (c * step[0] + e * step[1] + f * step[2]) * inverse,
    ])  # fmt: skip


def _between_neighbours(block: Block, points: np.ndarray, facts: CellFacts) -> tuple[Rows, np.ndarray]:
    """Polyhedra: the slope by Green and Gauss, with face values on the line between the middles of two neighbours.

    The sum of a cell's area vectors is zero, so what counts are differences to its neighbours.
    """
    assert block.cells is not None and block.cells.faces is not None
    faces = block.cells.faces
    inner = len(faces.neighbour)
    one, other = faces.owner[:inner], faces.neighbour
    last = int(faces.start[inner])
    begin, width = faces.start[:inner], np.diff(faces.start)[:inner]
    if not inner:  # faces that do not know their neighbours tell nothing of a slope
        none = np.zeros(block.cell_count + 1, np.int64)
        return Rows(none, np.empty(0, np.int32)), np.empty((0, 3))
    at = points[faces.points[:last]]
    mean = np.add.reduceat(at, begin, axis=0) / width[:, None]
    following = np.arange(1, len(at) + 1)
    following[faces.start[1 : inner + 1] - 1] = begin
    spoke = at - np.repeat(mean, width, axis=0)
    area = np.add.reduceat(0.5 * np.cross(spoke, spoke[following]), begin)
    near = np.abs(np.einsum("nk,nk->n", area, mean - facts.middle[one]))
    far = np.abs(np.einsum("nk,nk->n", area, facts.middle[other] - mean))
    share = (near / np.maximum(near + far, 1e-300))[:, None]
    with np.errstate(all="ignore"):
        outward = share * area / facts.volume[one, None]
        inward = -(1.0 - share) * area / facts.volume[other, None]
    weight = np.concatenate([outward, inward])
    weight[~np.isfinite(weight).all(axis=1)] = 0.0
    rows, order = Rows.sorted(np.concatenate([one, other]), np.concatenate([other, one]), block.cell_count)
    return rows, np.ascontiguousarray(weight[order])
