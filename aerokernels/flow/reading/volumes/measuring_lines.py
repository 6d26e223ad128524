"""Measure on lines along z how resampling a mesh to a grid changes the density."""

from dataclasses import dataclass

import numpy as np

from aerokernels.flow.reading.volumes.reconstruction import Linear, Reconstruction, SomeCells
from aerokernels.flow.reading.volumes.solids import NodeGrid

LINES = 12  # measuring lines along x and along y
GREATEST = 3.0  # budgets report three times the rms error: the greatest error of a line counts where it is more
ALONG = 2.0  # greatest increase of the squares in a row of cells where the line runs along or inside a shock
PLACE = 2.0  # the average leaves a shock's place in its cell open: deficit of the worst corner over the corners' rms


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
        grid = max(self.column_rms, self.column_max / GREATEST)
        return float(np.hypot(grid, max(self.unresolved_column_rms, self.unresolved_column_max / GREATEST)))


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
        """Store what is needed of the cells that the lines cross, one part for each block.

        `firsts` are the numbers of the first cells of the blocks in the lines' grid.
        """
        from scipy.sparse import csr_array

        grid = self.grid
        self._node = np.flatnonzero(grid.cell >= 0)
        cells, self._of = np.unique(grid.cell[self._node], return_inverse=True)
        self._order = sorted(range(len(parts)), key=lambda k: (firsts[k], cell_counts[k]))
        self._parts = []
        for k in self._order:
            own = cells[(cells >= firsts[k]) & (cells < firsts[k] + cell_counts[k])]
            self._parts.append(SomeCells.of(parts[k], own - firsts[k]))
        self._at = grid.positions(self._node)
        # The eight nodes around each place, and their weights in trilinear interpolation.
        place = (self._at - self._low) / self._spacing
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
        change, flat, deficit = (np.zeros(int(np.prod(shape))) for _ in range(3))
        span = 0.0
        if len(node):
            each = zip(self._parts, [values[k] for k in self._order], strict=True)
            linear = Linear.joined([part.linear(value, near, self._low) for part, (value, near) in each])
            truth = linear.at(self._of, self._at)
            change[node] = self._between @ density - truth
            flat[node] = linear.value[self._of] - truth
            deficit[node] = linear.deficit[self._of]
            span = float(np.ptp(linear.value))
        columns = [self._length * own.reshape(shape).sum(axis=2) for own in (change, flat)]
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

    Args:
        lines: Contribution of `deficit` to each place of each line [kg/m2], shape (line_count, place_count).
        deficit: Deficit of the function of the cell there [kg/m3], likewise.
        cell: Numbers of the cells, likewise.
        span: The range of the density [kg/m3].
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
    squares = (PLACE * np.add.reduceat(lines.ravel(), begin)) ** 2
    line = begin // lines.shape[1]
    likely = together**2 + np.bincount(line, squares, len(lines))
    return np.sqrt(likely), np.sqrt(likely + np.bincount(line[along], ALONG * squares[along], len(lines)))
