"""What drawing a mesh into a grid changes, measured on lines along z."""

from dataclasses import dataclass

import numpy as np

from .raster import NodeGrid
from .reconstruction import Linear, Reconstruction, SomeCells

LINES = 8  # along x and y, on which the error is measured


@dataclass(frozen=True)
class VolumeResampling:
    """What resampling a mesh to a uniform grid changed, by cause.

    Attributes:
        spacing: Node spacing of the grid [m], one per axis.
        density_rms: Root mean square change of the density between grid and cells [kg/m3], on lines along z.
        density_max: Greatest change of it seen [kg/m3].
        column_rms: Root mean square change of the integral of the density along those lines [kg/m2].
        column_max: Greatest change of that [kg/m2].
        reconstruction_rms: What of the columns comes from the slopes inside cells: against cells of one density each.
        outside_share: Share of the nodes that no cell holds: in a body, or beyond the mesh.
        averaged_share: Share of the nodes whose neighbourhood has several cells, which were averaged.
    """

    spacing: tuple[float, float, float]
    density_rms: float
    density_max: float
    column_rms: float
    column_max: float
    reconstruction_rms: float
    outside_share: float
    averaged_share: float


class MeasuringLines:
    """Lines through a grid along z, and the cells that they cross: finer than the grid, at the same places for all."""

    def __init__(self, low: np.ndarray, spacing: np.ndarray, shape):
        """Lay them out in the grid of the nodes."""
        extent = spacing * (np.array(shape) - 1)
        fine = max(2, min(4 * shape[2], 4096))
        self.grid = NodeGrid(
            low + extent * np.array([0.5 / LINES, 0.5 / LINES, 0.5 / fine]),
            extent / np.array([LINES, LINES, fine]),
            (LINES, LINES, fine),
        )
        self._low, self._spacing, self._shape = low, spacing, shape

    def settle(self, parts: list[Reconstruction], cell_counts: list[int]) -> None:
        """Keep what is needed of the cells that the lines were drawn through; a part for each block, in their order."""
        from scipy.sparse import csr_array

        grid = self.grid
        self._node = np.flatnonzero(grid.cell >= 0)
        cells, self._of = np.unique(grid.cell[self._node], return_inverse=True)
        ends = np.cumsum([0, *cell_counts])
        self._parts = [
            SomeCells.of(part, cells[(cells >= first) & (cells < last)] - first)
            for part, first, last in zip(parts, ends[:-1], ends[1:], strict=True)
        ]
        self._at = grid.positions(self._node)
        # The eight nodes about each place, and their shares of what is linear between them.
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
        """What the grid's density, flat, changes against the cells' functions.

        Args:
            values: What `Reconstruction.values` gives of each block.
            density: At all nodes of the grid, shape (node_count,).
            outside_share: Share of the nodes that no cell holds.
            averaged_share: Share of the nodes that took an average.
        """
        shape, node = self.grid.shape, self._node
        change, flat = np.zeros(int(np.prod(shape))), np.zeros(int(np.prod(shape)))
        if len(node):
            each = zip(self._parts, values, strict=True)
            linear = Linear.joined([part.linear(value, near, self._low) for part, (value, near) in each])
            truth = linear.at(self._of, self._at)
            change[node] = self._between @ density - truth
            flat[node] = linear.value[self._of] - truth
        columns = [self._length * own.reshape(shape).sum(axis=2) for own in (change, flat)]
        seen = change[node] if len(node) else change
        rms = [float(np.sqrt(np.mean(own**2))) for own in (seen, columns[0], columns[1])]
        return VolumeResampling(
            tuple(float(s) for s in self._spacing),  # type: ignore[arg-type]
            rms[0],
            float(np.abs(change).max()),
            rms[1],
            float(np.abs(columns[0]).max()),
            rms[2],
            outside_share,
            averaged_share,
        )
