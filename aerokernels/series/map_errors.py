r"""Errors of a series' maps due to their pixels, each of which has one ray: see wavefront/pixel_errors.py.

All numbers follow from sums over the pixels of cos p, sin p, f, f^2, x f and y f, where p is the phase and f the OPD.
They are computed with the weights of the map, with exact weights, which differ only near the edge, and on the four
interleaved grids of every other row and column. The errors follow from the differences.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ..wavefront import SAFETY

# Differences of weights below this share of the greatest weight are rounding.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class PixelErrors:
    """Errors of a `Reading` due to the pixels, by its names and in its units; NaN if not computed."""

    strehl: float = math.nan
    rms: float = math.nan
    rms_without_tilt: float = math.nan
    tilt: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))


class MapErrors:
    """Pixel errors of maps with the same pixels."""

    def __init__(self, centred: np.ndarray, weight: np.ndarray, lacking: np.ndarray, quarter: np.ndarray):
        """Compute the part that depends on the pixels alone.

        Args:
            centred: Coordinates of the pixels from their mean [m], shape (n, 2).
            weight: Their shares, which sum to 1, shape (n,).
            lacking: Exact weights minus the shares, shape (n,).
            quarter: Number of the interleaved grid of each pixel, 0 to 3, shape (n,).
        """
        self._points, self._weight, self._quarter = centred, weight, quarter
        self._edge = np.flatnonzero(np.abs(lacking) > ROUNDING * weight.max())
        self._lacking = lacking[self._edge]
        x, y = centred.T
        shapes = np.stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
        grids = self._sums(shapes)
        whole = grids.sum(axis=0)
        self._there = grids[:, 0] > 0.0
        self._plain, self._exact = _Shape(whole), _Shape(whole + shapes[:, self._edge] @ self._lacking)
        self._grids = [_Shape(one) for one in grids[self._there]]

    def __call__(self, cosine: np.ndarray, sine: np.ndarray, flat: np.ndarray, tilt: np.ndarray) -> PixelErrors:
        """Return the errors of a map of mean 0 [m], with its phase's cosine and sine, shape (n,), and tilt [rad]."""
        x, y = self._points.T
        values = [cosine, sine, flat, flat**2, x * flat, y * flat]
        sums = self._sums(values)
        at_edge = np.array([one[self._edge] @ self._lacking for one in values])
        whole = sums.sum(axis=0)
        plain = self._plain.numbers(whole, tilt)
        second_order = SAFETY * np.abs(self._exact.numbers(whole + at_edge, tilt) - plain)
        grids = [grid.numbers(one, tilt) for grid, one in zip(self._grids, sums[self._there], strict=True)]
        spread = np.std(grids, axis=0, ddof=1) / np.sqrt(len(grids)) if len(grids) > 1 else 0.0
        found = np.hypot(second_order, spread)
        return PixelErrors(float(found[0]), float(found[1]), float(found[2]), found[3:])

    def _sums(self, values) -> np.ndarray:
        """Return weighted sums over each of the four grids, shape (4, number of values)."""
        return np.stack([np.bincount(self._quarter, self._weight * one, 4) for one in values], axis=1)


class _Shape:
    """Moments of the places of some weighted pixels."""

    def __init__(self, sums: np.ndarray):
        """Compute them from the weighted sums of 1, x, y, x^2, x y and y^2."""
        self.total = sums[0]
        x, y, xx, xy, yy = sums[1:] / self.total
        self.middle = np.array([x, y])
        self.extent = np.array([[xx - x * x, xy - x * y], [xy - x * y, yy - y * y]])
        self.inverse = np.linalg.pinv(self.extent, rcond=1e-12)

    def numbers(self, sums: np.ndarray, tilt: np.ndarray) -> np.ndarray:
        """Return Strehl ratio, rms, rms without a given tilt, and both slopes, from weighted sums over the pixels."""
        cosine, sine, mean, square = sums[:4] / self.total
        with_points = sums[4:] / self.total - self.middle * mean
        rms = square - mean**2
        level = rms - 2.0 * tilt @ with_points + tilt @ self.extent @ tilt
        roots = math.sqrt(max(rms, 0.0)), math.sqrt(max(level, 0.0))
        return np.array([cosine**2 + sine**2, *roots, *(self.inverse @ with_points)])
