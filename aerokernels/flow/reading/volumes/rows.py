"""Lists of numbers, one for each row: the cells at each point, or the points of each cell."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Rows:
    """For each row a list of numbers: `column[start[row]:start[row + 1]]`.

    Attributes:
        start: int64, shape (row_count + 1,).
        column: int32.
    """

    start: np.ndarray
    column: np.ndarray

    @classmethod
    def sorted(cls, row: np.ndarray, column: np.ndarray, count: int) -> tuple["Rows", np.ndarray]:
        """Return pairs sorted by their rows, and the order that sorts them."""
        order = np.argsort(row, kind="stable")
        start = np.zeros(count + 1, np.int64)
        np.cumsum(np.bincount(row, minlength=count), out=start[1:])
        return cls(start, column[order].astype(np.int32)), order

    @classmethod
    def of_matrix(cls, matrix) -> "Rows":
        """Return the columns of the entries in each row of a sparse matrix, ascending."""
        matrix.sort_indices()
        return cls(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32, copy=False))

    def matrix(self, width: int):
        """Return a sparse boolean matrix with these entries and `width` columns."""
        from scipy.sparse import csr_array

        true = np.ones(len(self.column), bool)
        return csr_array((true, self.column, self.start), shape=(len(self.start) - 1, width))

    def transposed(self, width: int) -> "Rows":
        """Return for each of `width` columns the rows that list it, ascending."""
        # Transposing a sparse matrix sorts in one pass, faster than a sort of the numbers.
        turned = self.matrix(width).tocsc()
        return Rows(turned.indptr.astype(np.int64), turned.indices.astype(np.int32, copy=False))

    def select(self, row: np.ndarray) -> tuple["Rows", np.ndarray]:
        """Return some of the rows in a given order, and the positions of their entries in `column`."""
        begin, width = self.start[row], np.diff(self.start)[row]
        start = np.zeros(len(row) + 1, np.int64)
        np.cumsum(width, out=start[1:])
        entry = np.arange(start[-1]) + np.repeat(begin - start[:-1], width)
        return Rows(start, self.column[entry]), entry

    def means(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of the values that each row lists, 0 for an empty row."""
        from aerokernels.flow.reading.volumes.mesh_kernels import launch, mean_of_listed

        result = np.empty(len(self.start) - 1)
        launch(mean_of_listed, len(result), self.start, self.column, np.ascontiguousarray(values), result)
        return result

    def signed_rms(self, each: np.ndarray) -> np.ndarray:
        """Return the root mean square of each row's entries, with the sign of their mean; no row may be empty."""
        if not len(each):
            return np.empty(0)
        begin = self.start[:-1]
        squares = np.add.reduceat(each**2, begin) / np.diff(self.start)
        return np.copysign(np.sqrt(squares), np.add.reduceat(each, begin))
