"""Reconstruct a linear density in each solid cell, from cell averages or from values at points.

In every cell the density is its value at the cell's middle plus a slope, clamped to the range of the cell and its
corners. The average over a cell remains that of the file; linear functions of point data are kept exactly. Weights that
depend on the mesh alone are computed once; each set of densities then costs one pass over the cells.
"""

from dataclasses import dataclass

import numpy as np

from aerokernels.flow.reading.dataset import POLYHEDRON, Block, Faces
from aerokernels.flow.reading.volumes.point_values import PointDeficits, PointValues, Rows
from aerokernels.flow.reading.volumes.solids import CellFacts, corner_chunks, corner_counts


@dataclass(frozen=True, eq=False)
class Linear:
    """A linear function in each cell.

    Attributes:
        value: Its average over the cell, shape (n,).
        function: Value at the origin, slope, least and greatest value allowed, shape (n, 6).
        deficit: What it lacks in a curved density: its deviation from the values at the corners of the cell, root mean
            square with the sign of the mean. For values at points it is twice the deficit at the mean of the corners.
        origin: The point from which places are measured [m].
    """

    value: np.ndarray
    function: np.ndarray
    deficit: np.ndarray
    origin: tuple[float, float, float]

    def at(self, cell: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return values at points (n, 3) inside cells (n,)."""
        own = self.function[cell]
        rise = np.einsum("nk,nk->n", points - np.array(self.origin), own[:, 1:4])
        return np.clip(own[:, 0] + rise, own[:, 4], own[:, 5])

    @classmethod
    def joined(cls, parts: list["Linear"]) -> "Linear":
        """Concatenate the cells of several blocks."""
        if len(parts) == 1:
            return parts[0]
        names = ("value", "function", "deficit")
        value, function, deficit = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
        return cls(value, function, deficit, parts[0].origin)


class Reconstruction:
    """The weights of the linear functions in the cells of a block, which depend on its mesh alone."""

    def __init__(self, block: Block, points: np.ndarray, where: str, facts: CellFacts):
        """Compute the weights."""
        self.where = where
        self.count = block.cell_count if where == "cell" else len(points)
        self.rows = cell_corners(block)
        self.weight, self.centre = _fitted(self.rows, points)
        self.middle = facts.middle if where == "cell" else self.centre
        self._of_points: PointValues | None = None
        self.points = points
        if where == "point":
            self._corners = self.rows
        else:
            blank = block.blank if block.blank is not None and len(block.blank) == block.cell_count else None
            self._of_points = PointValues.of(self.rows, self.middle, points, blank)

    def forget_slopes(self) -> None:
        """Free the weights of the slopes: `values` does not need them."""
        self.rows = Rows(np.zeros(1, np.int64), np.empty(0, np.int32))
        self.weight, self.middle, self.centre, self.points = (np.empty((0, 3)) for _ in range(4))

    def values(self, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the average of each cell and the values at the points, for densities of the cells or the points."""
        given = np.ascontiguousarray(density, dtype=np.float64)
        if self._of_points is None:
            return self._corners.means(given), given
        return given, self._of_points.values(given)


@dataclass(frozen=True, eq=False)
class SomeCells:
    """Cells of a block whose linear functions are evaluated at given places."""

    cell: np.ndarray
    rows: Rows
    weight: np.ndarray
    middle: np.ndarray
    to_corner: np.ndarray
    deficits: PointDeficits | None

    @classmethod
    def of(cls, part: Reconstruction, cell: np.ndarray) -> "SomeCells":
        """Return the cells of a block with the given numbers."""
        rows, entry = part.rows.select(cell)
        at_points = part.where == "point" and len(cell) > 0
        deficits = PointDeficits.of(part.rows, part.weight, part.centre, part.points, cell) if at_points else None
        to_corner = part.points[rows.column] - np.repeat(part.middle[cell], np.diff(rows.start), axis=0)
        return cls(cell, rows, part.weight[entry], part.middle[cell], to_corner, deficits)

    def linear(self, value: np.ndarray, near: np.ndarray, origin) -> Linear:
        """Return their linear functions from the result of `Reconstruction.values`, relative to `origin` [m]."""
        from aerokernels.flow.reading.volumes.mesh_kernels import launch, linear_functions

        own, function, origin = value[self.cell], np.empty((len(self.cell), 6)), tuple(float(x) for x in origin)
        launch(
            linear_functions, len(own), self.rows.start, self.rows.column, self.weight, near, own, self.middle, origin,
            function,
        )  # fmt: skip
        if self.deficits is not None:
            return Linear(own, function, self.deficits.deficit(near), origin)
        count = np.diff(self.rows.start)
        rise = np.einsum("nk,nk->n", self.to_corner, np.repeat(function[:, 1:4], count, axis=0))
        return Linear(
            own, function, self.rows.signed_rms(rise - (near[self.rows.column] - np.repeat(own, count))), origin
        )


def cell_corners(block: Block) -> Rows:
    """Return the points of each solid cell, each listed once; none for other cells."""
    count = corner_counts(block)
    cells, of = block.cells, None
    if cells is not None and cells.faces is not None:
        has_faces = cells.types == POLYHEDRON
        of = _points_of_faces(cells.faces, block.cell_count, len(block.points))
        count = np.where(has_faces, np.diff(of.start), count)
    start = np.zeros(block.cell_count + 1, np.int64)
    np.cumsum(count, out=start[1:])
    column = np.empty(start[-1], np.int32)
    for chunk in corner_chunks(block):
        column[start[chunk.cell] + np.arange(len(chunk.corners))[:, None]] = chunk.corners
    if of is not None:
        own = np.flatnonzero(has_faces)
        listed, _ = of.select(own)
        _, entry = Rows(start, column).select(own)
        column[entry] = listed.column
    return Rows(start, column)


def _points_of_faces(faces: Faces, cell_count: int, point_count: int) -> Rows:
    """Return the points of all faces of each cell, each listed once."""
    from scipy.sparse import csr_array

    inner, face_count = len(faces.neighbour), len(faces.owner)
    cell = np.concatenate([faces.owner, faces.neighbour])
    face = np.concatenate([np.arange(face_count), np.arange(inner)])
    of = Rows.sorted(cell, face, cell_count)[0].matrix(face_count)
    true = np.ones(len(faces.points), bool)
    points = csr_array((true, faces.points.astype(np.int32), faces.start), shape=(face_count, point_count))
    return Rows.of_matrix(of @ points)


def _fitted(rows: Rows, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return corner weights in the least-squares slope, shape (entry_count, 3), and the means of the corners."""
    from aerokernels.flow.reading.volumes.mesh_kernels import launch
    from aerokernels.flow.reading.volumes.point_kernels import slope_weights

    count = len(rows.start) - 1
    weight, centre = np.empty((len(rows.column), 3)), np.zeros((count, 3))
    launch(slope_weights, count, rows.start, rows.column, np.ascontiguousarray(points), weight, centre)
    return weight, centre


@dataclass(frozen=True, eq=False)
class CellNodes:
    """The nodes inside the cells of a block, and the weights of the linear function of each of these cells.

    Attributes:
        cell: Numbers of the cells in their block, shape (n,).
        nodes: The nodes inside each cell, ascending.
        rows: The values from which the slope of each cell is computed.
        weight: Weights of these values, shape (entry_count, 3).
        middle: Centroids to which the averages belong, shape (n, 3).
    """

    cell: np.ndarray
    nodes: Rows
    rows: Rows
    weight: np.ndarray
    middle: np.ndarray

    @classmethod
    def of(cls, part: Reconstruction, number: np.ndarray, first_cell: int, cell_count: int) -> "CellNodes":
        """Return the nodes of a block from `number`, the cell of each node or -1; its cells begin at `first_cell`."""
        every = nodes_by_cell(number, first_cell, cell_count)
        some = np.flatnonzero(np.diff(every.start))
        cell = some[np.argsort(every.column[every.start[some]], kind="stable")].astype(np.int32)
        nodes, _ = every.select(cell)
        rows, entry = part.rows.select(cell)
        return cls(cell, nodes, rows, part.weight[entry], part.middle[cell])

    def set_densities(self, value, near, origin, shape, spacing, density: np.ndarray) -> None:
        """Set the densities of these nodes.

        `value` is the average of every cell, `near` what `rows` lists by number, `density` (node_count,) is changed.
        """
        from aerokernels.flow.reading.volumes.mesh_kernels import densities_at_nodes, launch

        launch(
            densities_at_nodes, len(self.cell), self.cell, self.rows.start, self.rows.column, self.weight, near, value,
            self.middle, tuple(float(x) for x in origin), self.nodes.start, self.nodes.column, shape[2], shape[1],
            tuple(float(x) for x in spacing), density,
        )  # fmt: skip


def nodes_by_cell(number: np.ndarray, first_cell: int, cell_count: int) -> Rows:
    """Return the nodes of each cell, ascending, from the cell of each node; nodes of other blocks are left out."""
    own = (number >= first_cell) & (number < first_cell + cell_count)
    start = np.zeros(len(number) + 1, np.int32)
    np.cumsum(own, out=start[1:])
    column = (number if own.all() else number[own]) - np.int32(first_cell)
    return Rows(start, column).transposed(cell_count)
