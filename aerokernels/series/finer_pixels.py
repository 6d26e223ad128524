"""A map of a snapshot on pixels of a third of the side, by which the error due to its pixels is told.

A pixel has one ray, at its centre, and its share of the pupil. The optical path differences at the middles of its parts
are its Taylor series to second order along either axis, with derivatives from the neighbours inside the pupil, and
their shares are the pupil's. The error is twice what a number changes by.
"""

from collections.abc import Callable

import numpy as np

from ..wavefront.pixels import derivatives

FACTOR = 2.0
# Parts of a pixel's side, and their middles from its own [pixels].
PARTS, STEPS = 3, (-1.0 / 3.0, 0.0, 1.0 / 3.0)


class FinerPixels:
    """The parts of a map's pixels that lie in the pupil.

    Attributes:
        points: Coordinates of the parts [m], shape (m, 2).
        weight: Their shares of the pupil, shape (m,).
    """

    def __init__(
        self, x: np.ndarray, y: np.ndarray, pixel: float, weight: np.ndarray, coverage: Callable[..., np.ndarray]
    ):
        """Divide the pixels.

        Args:
            x: Pixel centres along the first axis [m], shape (nx,).
            y: Pixel centres along the second axis [m], shape (ny,).
            pixel: Side of a pixel [m].
            weight: Shares of the pixels, 0 where there is no ray, shape (ny, nx).
            coverage: Returns the shares of cells, between edges along both axes, that are in the pupil.
        """
        self._lit = weight > 0.0
        middles = [(axis[:, None] + pixel * np.array(STEPS)).ravel() for axis in (x, y)]
        edges = [np.append(axis, axis[-1] + pixel / PARTS) - 0.5 * pixel / PARTS for axis in middles]
        share = coverage(*edges)
        whole, mean = (
            np.repeat(np.repeat(one, PARTS, axis=0), PARTS, axis=1)
            for one in (weight, share.reshape(len(y), PARTS, len(x), PARTS).mean(axis=(1, 3)))
        )
        fine = whole * share / np.where(mean > 0.0, mean, 1.0)
        self._there = fine > 0.0
        self.weight = fine[self._there] / fine.sum()
        columns, rows = np.meshgrid(*middles)
        self.points = np.stack([columns[self._there], rows[self._there]], axis=1)

    def __call__(self, opd: np.ndarray) -> np.ndarray:
        """Return the optical path differences of the parts, shape (m,), from those of the lit pixels, shape (n,)."""
        whole = np.zeros(self._lit.shape)
        whole[self._lit] = opd
        parts = [whole]
        for axis in (0, 1):
            parts = [
                one + step * slope + 0.5 * step**2 * bend
                for one in parts
                for slope, bend in [derivatives(one, self._lit, axis)]
                for step in STEPS
            ]
        fine = np.stack(parts).reshape(PARTS, PARTS, *whole.shape).transpose(2, 0, 3, 1).reshape(self._there.shape)
        return np.asarray(fine[self._there])
