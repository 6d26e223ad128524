"""Reconstruct a linear density in each solid cell, from cell averages or from values at points.

In every cell the density is its value at the cell's middle plus a slope, clamped to the range of the cell and its
corners. The average over a cell remains that of the file; linear functions of point data are kept exactly. Weights that
depend on the mesh alone are computed once; each set of densities then costs one pass over the cells.
"""

from dataclasses import dataclass

import numpy as np

from aerokernels.flow.reading.dataset import POLYHEDRON, Block, Faces
from aerokernels.flow.reading.volumes.point_values import PointDeficits, PointValues, Rows
from aerokernels.flow.reading.volumes.solids import CellFacts, NodeGrid, corner_chunks, corner_counts


class Reconstruction:
    """The weights of the linear functions in the cells of a block, which depend on its mesh alone."""

    def __init__(self, block: Block, points: np.ndarray, where: str, facts: CellFacts):
        """Compute the weights of a block with points in the optical frame [m] and values in cells or at points."""
        from aerokernels.flow.reading.volumes.mesh_kernels import launch, slope_weights

        points = np.ascontiguousarray(points)
        self.where = where
        self.count = block.cell_count if where == "cell" else len(points)
        self.rows = cell_corners(block)
        # The weights of the corners in the least-squares slope, and the means of the corners.
        self.weight, self.centre = np.empty((len(self.rows.column), 3)), np.zeros((block.cell_count, 3))
        launch(slope_weights, block.cell_count, self.rows.start, self.rows.column, points, self.weight, self.centre)
        self.middle = facts.middle if where == "cell" else self.centre
        self.points = points
        # From densities of the cells, or of the points, to values at the points, or means over the corners of the cells
        self._between = self.rows if where == "point" else PointValues.of(self.rows, self.middle, points, block.blank)

    def forget_slopes(self) -> None:
        """Free the weights of the slopes: `values` does not need them."""
        self.rows = Rows(np.zeros(1, np.int64), np.empty(0, np.int32))
        self.weight, self.middle, self.centre, self.points = (np.empty((0, 3)) for _ in range(4))

    def values(self, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the average of each cell and the values at the points, for densities of the cells or the points."""
        own = np.ascontiguousarray(density, dtype=np.float64)
        if isinstance(self._between, Rows):
            return self._between.means(own), own
        return own, self._between.values(own)


@dataclass(frozen=True, eq=False)
class CrossedCells:
    """Cells of a block that lines cross, and the places of the lines in them, relative to an origin."""

    node: np.ndarray  # numbers of the places on the lines, shape (m,)
    place: np.ndarray  # [m], shape (m, 3)
    of: np.ndarray  # the cell of each place, by its number in `cell`
    cell: np.ndarray  # numbers of the cells in their block, shape (n,)
    rows: Rows  # their corners
    weight: np.ndarray  # weights of the corners in the slope, shape (entry_count, 3)
    middle: np.ndarray  # [m], shape (n, 3)
    to_corner: np.ndarray  # from the middle to each corner [m], shape (entry_count, 3)
    deficits: PointDeficits | None  # for values at points

    @classmethod
    def of_block(cls, part: Reconstruction, number, node, at, origin) -> "CrossedCells":
        """Return the cells of a block at places on lines; `number` is the cell at each of them."""
        cell, of = np.unique(number, return_inverse=True)
        rows, entry = part.rows.select(cell)
        at_points = part.where == "point" and len(cell) > 0
        deficits = PointDeficits.of(part.rows, part.weight, part.centre, part.points, cell) if at_points else None
        middle = part.middle[cell]
        to_corner = part.points[rows.column] - rows.spread(middle)
        return cls(node, at - origin, of, cell, rows, part.weight[entry], middle - origin, to_corner, deficits)

    def evaluate(self, value: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return for each place its cell's linear function, average and deficit; arguments of `Reconstruction.values`.

        The deficit is what the function lacks in a curved density: its deviation from the values at the corners of the
        cell, root mean square with the sign of the mean. For values at points it is twice that at their mean.
        """
        own, rows, of = value[self.cell], self.rows, self.of
        slope, (low, high) = rows.slopes(self.weight, near, own), rows.ranges(near, own)
        if self.deficits is not None:
            deficit = self.deficits.deficit(near)
        else:
            rise = np.einsum("nk,nk->n", self.to_corner, rows.spread(slope))
            deficit = rows.signed_rms(rise - (near[rows.column] - rows.spread(own)))
        constant = own - np.einsum("nk,nk->n", self.middle, slope)
        here = constant[of] + np.einsum("nk,nk->n", self.place, slope[of])
        return np.clip(here, low[of], high[of]), own[of], deficit[of]


def cell_corners(block: Block) -> Rows:
    """Return the points of each solid cell, each listed once; none for other cells."""
    count = corner_counts(block)
    cells, of = block.cells, None
    if cells is not None and cells.faces is not None:
        has_faces = cells.types == POLYHEDRON
        of = _points_of_faces(cells.faces, block.cell_count, len(block.points))
        count = np.where(has_faces, of.width, count)
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
    of = csr_array((np.ones(len(cell), bool), (cell, face)), shape=(cell_count, face_count))
    true = np.ones(len(faces.points), bool)
    return Rows.of_matrix(of @ csr_array((true, faces.points, faces.start), shape=(face_count, point_count)))


@dataclass(frozen=True, eq=False)
class CellNodes:
    """The nodes inside the cells of a block, and the weights of the linear function of each of these cells."""

    cell: np.ndarray  # numbers of the cells in their block, shape (n,)
    nodes: Rows  # the nodes inside each cell, ascending
    rows: Rows  # the values from which the slope of each cell is computed
    weight: np.ndarray  # weights of these values, shape (entry_count, 3)
    middle: np.ndarray  # centroids to which the averages belong, shape (n, 3)

    @classmethod
    def of(cls, part: Reconstruction, number: np.ndarray, first_cell: int, cell_count: int) -> "CellNodes":
        """Return the nodes of a block from `number`, the cell of each node or -1; its cells begin at `first_cell`."""
        own = (number >= first_cell) & (number < first_cell + cell_count)
        start = np.zeros(len(number) + 1, np.int32)
        np.cumsum(own, out=start[1:])
        every = Rows(start, (number if own.all() else number[own]) - np.int32(first_cell)).transposed(cell_count)
        some = np.flatnonzero(every.width)
        cell = some[np.argsort(every.column[every.start[some]], kind="stable")].astype(np.int32)
        nodes, _ = every.select(cell)
        rows, entry = part.rows.select(cell)
        return cls(cell, nodes, rows, part.weight[entry], part.middle[cell])

    def set_densities(self, value, near, origin, shape, spacing, density: np.ndarray) -> None:
        """Set the densities of these nodes from the average of every cell and what `rows` lists by number, `near`."""
        from aerokernels.flow.reading.volumes.mesh_kernels import densities_at_nodes, launch

        launch(
            densities_at_nodes, len(self.cell), self.cell, self.rows.start, self.rows.column, self.weight, near, value,
            self.middle, tuple(float(x) for x in origin), self.nodes.start, self.nodes.column, shape[2], shape[1],
            tuple(float(x) for x in spacing), density,
        )  # fmt: skip


LINES = 12  # measuring lines along x and along y


@dataclass(frozen=True)
class VolumeResampling:
    """The changes caused by resampling a mesh to a uniform grid, by cause.

    Attributes:
        spacing: Node spacing of the grid [m], one per axis.
        density_rms: Root mean square change of the density between grid and cells [kg/m3], on lines along z.
        density_max: Greatest change of the density found [kg/m3].
        column_rms: Root mean square change of the integral of the density along those lines [kg/m2].
        column_max: Greatest change of such an integral [kg/m2].
        reconstruction_rms: Part of the columns that is due to the slopes inside cells: against constant cells [kg/m2].
        outside_share: Share of the nodes that are in no cell: in a body, or beyond the mesh.
        averaged_share: Share of the nodes with several cells around them, whose densities were averaged.
        unresolved_rms: Root mean square deficit of the functions in the cells against the flow [kg/m3], estimated from
            their differences at the corners of the cells; for densities at points from changes of slope between cells.
        unresolved_column_rms: The part of the columns due to that deficit [kg/m2].
        unresolved_column_max: Its greatest value on a line [kg/m2]: beside a shock along which the line runs.
    """

    spacing: tuple[float, float, float]
    density_rms: float
    density_max: float
    column_rms: float
    column_max: float
    reconstruction_rms: float
    outside_share: float
    averaged_share: float
    unresolved_rms: float = 0.0
    unresolved_column_rms: float = 0.0
    unresolved_column_max: float = 0.0

    @property
    def column_error(self) -> float:
        """Error of the columns [kg/m2], of the grid and of the functions in the cells together.

        Root mean square, or a third of the greatest error on a line where that is more.
        """
        grid = max(self.column_rms, self.column_max / 3.0)
        return float(np.hypot(grid, max(self.unresolved_column_rms, self.unresolved_column_max / 3.0)))


class MeasuringLines:
    """Lines along z through a grid, sampled finer than the grid, and the cells that they cross."""

    def __init__(self, low: np.ndarray, spacing: np.ndarray, shape):
        """Place the lines in the grid."""
        extent = spacing * (np.array(shape) - 1)
        fine = max(2, min(4 * shape[2], 4096))
        self.grid = NodeGrid(
            low + extent * np.array([0.5 / LINES, 0.5 / LINES, 0.5 / fine]),
            extent / np.array([LINES, LINES, fine]),
            (LINES, LINES, fine),
        )
        self._low, self._spacing, self._shape = low, spacing, shape

    def settle(self, parts: list[Reconstruction], firsts: list[int], cell_counts: list[int]) -> None:
        """Store what is needed of the cells that the lines cross; `firsts` are the first numbers of blocks' cells."""
        from scipy.sparse import csr_array

        grid = self.grid
        self._node = np.flatnonzero(grid.cell >= 0)
        at, cell = grid.positions(self._node), grid.cell[self._node]
        self._crossed = []
        for part, first, count in zip(parts, firsts, cell_counts, strict=True):
            own = (cell >= first) & (cell < first + count)
            crossed = CrossedCells.of_block(part, cell[own] - first, self._node[own], at[own], self._low)
            self._crossed.append(crossed)
        # The eight nodes around each place, and their weights in trilinear interpolation.
        place = (at - self._low) / self._spacing
        corner = np.clip(np.floor(place).astype(np.int64), 0, np.array(self._shape) - 2)
        share = np.clip(place - corner, 0.0, 1.0)
        sides = np.array(np.meshgrid(*[(0, 1)] * 3, indexing="ij")).reshape(3, 8).T
        column = np.ravel_multi_index(tuple((corner[:, None] + sides).transpose(2, 0, 1)), self._shape)
        weight = np.where(sides, share[:, None], 1.0 - share[:, None]).prod(axis=2)
        start = 8 * np.arange(len(place) + 1)
        size = (len(place), int(np.prod(self._shape)))
        self._between = csr_array((weight.ravel(), column.ravel(), start), shape=size)
        self._length = float(grid.spacing[2])

    def measure(self, values, density: np.ndarray, outside_share: float, averaged_share: float) -> VolumeResampling:
        """Return the changes of the grid's density against the cells' functions."""
        shape, node = self.grid.shape, self._node
        change, truth, average, deficit = (np.zeros(int(np.prod(shape))) for _ in range(4))
        for own, (value, near) in zip(self._crossed, values, strict=True):
            truth[own.node], average[own.node], deficit[own.node] = own.evaluate(value, near)
        change[node] = self._between @ density - truth[node]
        span = float(np.ptp(average[node])) if len(node) else 0.0
        columns = [self._length * own.reshape(shape).sum(axis=2) for own in (change, average - truth)]
        seen = change[node] if len(node) else change
        met = max(int((self.grid.cell.reshape(shape) >= 0).any(axis=2).sum()), 1)  # lines that cross any cells
        by_line = deficit.reshape(-1, shape[2])
        likely, greatest = unresolved(by_line * self._length, by_line, self.grid.cell.reshape(by_line.shape), span)
        rms = [float(np.sqrt(np.mean(seen**2))), *(float(np.sqrt(np.sum(own**2) / met)) for own in columns)]
        return VolumeResampling(
            tuple(float(s) for s in self._spacing),  # type: ignore[arg-type]
            rms[0],
            float(np.abs(change).max()),
            rms[1],
            float(np.abs(columns[0]).max()),
            rms[2],
            outside_share,
            averaged_share,
            float(np.sqrt(np.mean(deficit[node] ** 2))) if len(node) else 0.0,
            float(np.sqrt(np.sum(likely**2) / met)),
            float(greatest.max()),
        )


def unresolved(lines: np.ndarray, deficit: np.ndarray, cell: np.ndarray, span: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the likely and the greatest error of each line [kg/m2] due to `deficit`, shape (line_count,) each.

    For each place of each line, shape (line_count, place_count), are given its contribution to the line [kg/m2], the
    deficit of the function of the cell there [kg/m3] and the cell's number; `span` is the range of the density [kg/m3].
    """
    # In a curved density the deficit of a linear function with the right average is up to h^2 / 12 times the second
    # derivative on a line off the centroids of the cells; at the corners it is h^2 / 4, which is what is measured.
    together = 1.0 / 3.0 * lines.sum(axis=1)
    # Of the range of the density: cells with a greater deficit contain a shock, or are beside one.
    shock = np.sign(lines) * (np.abs(deficit) > 0.02 * span)
    other = np.ones(lines.shape, bool)
    other[:, 1:] = cell[:, 1:] != cell[:, :-1]
    # Consecutive cells of a shock along the line have alike deficits: their errors add up.
    first = other.copy()
    first[:, 1:] &= (shock[:, 1:] != shock[:, :-1]) | (shock[:, 1:] == 0)
    begin = np.flatnonzero(first)
    along = np.add.reduceat(other.ravel(), begin, dtype=np.int64) > 1
    # The average leaves a shock's place in its cell open: the worst corner has twice the corners' rms.
    squares = (2.0 * np.add.reduceat(lines.ravel(), begin)) ** 2
    line = begin // lines.shape[1]
    likely = together**2 + np.bincount(line, squares, len(lines))
    # Where the line runs along or inside a shock, the squares in a row of cells increase by at most this factor, 2.
    return np.sqrt(likely), np.sqrt(likely + np.bincount(line[along], 2.0 * squares[along], len(lines)))
