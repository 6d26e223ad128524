"""The grid nodes inside each cell, cell by cell in the order of their first nodes.

A set of densities then costs one pass over the cells that contain a node: the linear function of a cell is never
stored, and neighbouring cells write to neighbouring nodes.
"""

from dataclasses import dataclass

import numpy as np

from aerokernels.flow.reading.volumes.reconstruction import Reconstruction
from aerokernels.flow.reading.volumes.rows import Rows


@dataclass(frozen=True, eq=False)
class CellNodes:
    """The nodes inside the cells of a block, and the weights of the linear function of each of these cells.

    Attributes:
        cell: Numbers of the cells in their block, shape (n,).
        nodes: The nodes inside each cell, ascending.
        rows: The values from which the slope of each cell is computed.
        weight: Weights of these values, shape (entry_count, 3); for tetrahedra three for each cell, of the differences
            between the values at its other corners and at its first one, shape (3 n, 3).
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
        weight, middle = part.weight[entry], part.middle[cell]
        if (np.diff(rows.start) == 4).all():
            # The weights of a fit sum to zero: that of the first corner follows from the others.
            return cls(cell, nodes, rows, np.ascontiguousarray(weight.reshape(-1, 4, 3)[:, 1:]).reshape(-1, 3), middle)
        return cls(cell, nodes, rows, weight, middle)

    def set_densities(self, value, near, origin, shape, spacing, density: np.ndarray) -> None:
        """Set the densities of these nodes.

        Args:
            value: Average of every cell of the block.
            near: The values that `rows` lists by number.
            origin: The first node of the grid [m].
            shape: Nodes of the grid along x, y and z.
            spacing: Of the nodes [m].
            density: Of all nodes of the grid, shape (node_count,): changed in place.
        """
        from aerokernels.flow.reading.volumes.mesh_kernels import densities_at_nodes, densities_in_tetrahedra, launch

        of_rows: tuple[np.ndarray, ...] = (self.rows.start, self.rows.column)
        kernel = densities_at_nodes
        if len(self.weight) < len(self.rows.column):
            kernel, of_rows = densities_in_tetrahedra, (self.rows.column,)
        launch(
            kernel, len(self.cell), self.cell, *of_rows, self.weight, near, value, self.middle,
            tuple(float(x) for x in origin), self.nodes.start, self.nodes.column, shape[2], shape[1],
            tuple(float(x) for x in spacing), density,
        )  # fmt: skip


def nodes_by_cell(number: np.ndarray, first_cell: int, cell_count: int) -> Rows:
    """Return the nodes of each cell, ascending, from the cell of each node; nodes of other blocks are left out."""
    own = (number >= first_cell) & (number < first_cell + cell_count)
    start = np.zeros(len(number) + 1, np.int32)
    np.cumsum(own, out=start[1:])
    column = (number if own.all() else number[own]) - np.int32(first_cell)
    return Rows(start, column).transposed(cell_count)
