"""Maps of the unit square onto a pupil that preserve area ratios, weighted by the pupil's transmission.

    ring        r^2 = a^2 + (1 - a^2) u,  angle = 2 pi v                    a: inner over outer radius
    pixels      inverse marginal and conditional distribution (L. Devroye, Non-Uniform Random Variate Generation, XI.1)
    triangles   u selects one by area; with u' its position in that interval p + sqrt(u') (e + v (f - e)), e, f edges

The kernels that launch the rays of a pupil use the same formulas. Coordinates are in units of the pupil's reach.
"""

from dataclasses import dataclass

import numpy as np

RING, PIXELS, TRIANGLES = 0, 1, 2
# Numbers before the cumulative shares in the table of PIXELS: corner x, y and pixel x, y.
PIXEL_HEADER = 4


@dataclass(frozen=True, eq=False)
class SquareMap:
    """The numbers of a map.

    Attributes:
        shape: RING, PIXELS or TRIANGLES.
        row_count: Number of rows of pixels, or of triangles.
        column_count: Number of pixels in a row.
        table: RING: the square of the inner over the outer radius. PIXELS: x and y of the first pixel's outer corner,
            its width and height, the row_count + 1 cumulative shares of the rows, and for each row the column_count + 1
            cumulative shares of its pixels. TRIANGLES: the row_count + 1 cumulative shares, and for each triangle a
            corner and two edges, 6 numbers.
    """

    shape: int
    row_count: int
    column_count: int
    table: np.ndarray

    def points(self, square: np.ndarray) -> np.ndarray:
        """Return points of the pupil in units of its reach, shape (n, 2), from points of the unit square (n, 2)."""
        u, v = square[:, 0], square[:, 1]
        if self.shape == RING:
            inner = self.table[0]
            radius, angle = np.sqrt(inner + (1.0 - inner) * u), 2.0 * np.pi * v
            return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        if self.shape == PIXELS:
            return self._in_pixels(u, v)
        shares = self.table[: self.row_count + 1]
        one, rest = _locate(shares, u)
        corner, first, second = np.moveaxis(self.table[self.row_count + 1 :].reshape(-1, 3, 2)[one], 1, 0)
        return corner + np.sqrt(rest)[:, None] * (first + v[:, None] * (second - first))

    def _in_pixels(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        left, low, width, height = self.table[:PIXEL_HEADER]
        shares = self.table[PIXEL_HEADER:]
        row, up = _locate(shares[: self.row_count + 1], v)
        within = shares[self.row_count + 1 :].reshape(self.row_count, self.column_count + 1)
        # One ascending array for all rows: the cumulative shares of row r are shifted to between r and r + 1.
        ascending = (within + np.arange(self.row_count)[:, None]).ravel()
        column = np.searchsorted(ascending, row + u, side="right") - 1 - row * (self.column_count + 1)
        # Because r + u is rounded, the pixel found may be a neighbour of the right one.
        column = np.clip(column, 0, self.column_count - 1)
        column += (within[row, column + 1] <= u).astype(int) - (within[row, column] > u).astype(int)
        begin, end = within[row, column], within[row, column + 1]
        across = (u - begin) / np.where(end > begin, end - begin, 1.0)
        return np.stack([left + (column + across) * width, low + (row + up) * height], axis=1)


def _locate(shares: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the interval of ascending shares that contains each value, and the position in it, 0 to 1."""
    found = np.clip(np.searchsorted(shares, value, side="right") - 1, 0, len(shares) - 2)
    return found, (value - shares[found]) / (shares[found + 1] - shares[found])


def cumulative(shares: np.ndarray) -> np.ndarray:
    """Return the n + 1 cumulative shares along the last axis, from 0 to exactly 1; all zero where the sum is zero."""
    total = np.cumsum(shares, axis=-1)
    whole = np.where(total[..., -1:] > 0.0, total[..., -1:], 1.0)
    return np.concatenate([np.zeros_like(total[..., :1]), total / whole], axis=-1)
