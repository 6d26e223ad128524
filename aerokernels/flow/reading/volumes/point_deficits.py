r"""Estimate the deficit of linear functions between point values in a curved density, from slope changes between cells.

The slope at a point is the mean of the slopes of the cells around it. From a corner p of a cell with the slope s, the
density at the mean m of its corners is f(p) + (m - p) . (g(p) + s) / 2, to the third order of the cell's size, where
the function of the cell has f(p) + (m - p) . s. The difference is alike from every corner where the density is curved,
and changes sign from one side of a captured shock to the other: its root mean square counts, with the sign of its mean.
The result is twice the deficit, as `Linear.deficit` is where averages are given.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.flow.reading.volumes.rows import Rows


@dataclass(frozen=True, eq=False)
class PointDeficits:
    """The geometry for estimating the deficit of some cells.

    Attributes:
        around: Points of the cells around the corners of these cells, one row for each such cell.
        weight: Weights of those points in the slope of their cell, shape (entry_count, 3).
        middle: Mean of the points of each cell of `around` [m].
        own: Row in `around` of each estimated cell.
        to_points: The mean over the cells around each corner, a sparse matrix.
        corners: The corners of each estimated cell, as rows of `to_points`.
        step: From each corner to the mean of the corners [m], shape (entry_count, 3).
    """

    around: Rows
    weight: np.ndarray
    middle: np.ndarray
    own: np.ndarray
    to_points: Any
    corners: Rows
    step: np.ndarray

    @classmethod
    def of(cls, rows: Rows, weight: np.ndarray, centre: np.ndarray, points: np.ndarray, cell: np.ndarray):
        """Prepare the estimate for some cells of a block.

        Args:
            rows: The points of every cell.
            weight: Their weights in the slope of the cell, shape (entry_count, 3).
            centre: The mean of the points of every cell [m].
            points: [m], shape (point_count, 3).
            cell: Numbers of the cells to estimate.
        """
        from scipy.sparse import csr_array

        own, _ = rows.select(cell)
        corner, local = np.unique(own.column, return_inverse=True)
        number = np.full(len(points), -1, np.int32)
        number[corner] = np.arange(len(corner))
        entry = np.flatnonzero(number[rows.column] >= 0)
        near = np.unique(np.searchsorted(rows.start, entry, "right") - 1)
        around, entry = rows.select(near)
        some = number[around.column] >= 0
        of = np.repeat(np.arange(len(near)), np.diff(around.start))[some]
        at = number[around.column[some]]
        share = 1.0 / np.bincount(at, minlength=len(corner))
        mean = csr_array((share[at], (at, of)), shape=(len(corner), len(near)))
        step = np.repeat(centre[cell], np.diff(own.start), axis=0) - points[own.column]
        corners = Rows(own.start, local.astype(np.int32))
        return cls(around, weight[entry], centre[near], np.searchsorted(near, cell), mean, corners, step)

    def deficit(self, value: np.ndarray) -> np.ndarray:
        """Return twice the deficit of each cell's function at the mean of its corners, from values at all points."""
        from aerokernels.flow.reading.volumes.mesh_kernels import launch, linear_functions

        count = len(self.middle)
        function = np.empty((count, 6))
        launch(
            linear_functions, count, self.around.start, self.around.column, self.weight, value,
            self.around.means(value), self.middle, (0.0, 0.0, 0.0), function,
        )  # fmt: skip
        slope = function[:, 1:4]
        own = np.repeat(slope[self.own], np.diff(self.corners.start), axis=0)
        differ = own - (self.to_points @ slope)[self.corners.column]
        return self.corners.signed_rms(np.einsum("nk,nk->n", differ, self.step))
