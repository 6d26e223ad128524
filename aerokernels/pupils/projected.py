"""A pupil as it is seen along a line that is not its normal: its projection on a plane across the line.

Angles of light are slopes of the optical path per metre across the light's direction. The pupil's own coordinates are
longer than those across the line, by up to one over the cosine of the angle with the normal.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from .base import Pupil
from .vectors import transverse_axes

# Points along each side of a cell at which the transmission of a pupil seen askew is sampled.
SUBDIVISION = 16


def across_look(pupil: Pupil, look: np.ndarray) -> np.ndarray:
    """Return the matrix that makes coordinates across a look direction of those in the pupil's plane, shape (2, 2).

    The axes across it are those of a pupil that faces along it.
    """
    if np.array_equal(look, pupil.normal):
        return np.eye(2)
    return np.stack(transverse_axes(look)) @ np.stack(pupil.axes, axis=1)


def seen_along(pupil: Pupil, look: np.ndarray | None) -> "Pupil | Projected":
    """Return a pupil as it is seen along a unit vector: itself if that is its normal, or None."""
    if look is None or np.array_equal(look, pupil.normal):
        return pupil
    matrix = across_look(pupil, look)
    if abs(np.linalg.det(matrix)) < 1e-6:
        raise ValueError(f"the pupil is seen from its side along {np.asarray(look).tolist()}: turn its normal")
    return Projected(pupil, matrix)


@dataclass(frozen=True, eq=False)
class Projected:
    """A pupil in coordinates across a look direction.

    Attributes:
        pupil: The pupil.
        matrix: Makes coordinates across the look direction of those in the pupil's plane, shape (2, 2).
    """

    pupil: Pupil
    matrix: np.ndarray

    @property
    def center(self) -> np.ndarray:
        """Origin of the coordinates [m], shape (3,)."""
        return self.pupil.center

    @cached_property
    def _inverse(self) -> np.ndarray:
        return np.linalg.inv(self.matrix)

    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Vectors in the pupil's plane by which points move for a metre of either coordinate, shape (3,) each."""
        first, second = self._inverse.T @ np.stack(self.pupil.axes)
        return first, second

    @cached_property
    def half_extent(self) -> tuple[float, float]:
        """Greatest distance from the centre along each of the axes [m], or slightly more."""
        if self.pupil.inner_ratio is not None:
            x, y = self.pupil.reach * np.linalg.norm(self.matrix, axis=1)
        else:
            x, y = np.abs(self.matrix) @ self.pupil.half_extent
        return float(x), float(y)

    def coverage(self, x_edges: np.ndarray, y_edges: np.ndarray, power: int = 1) -> np.ndarray:
        """Return the mean of a power of the transmission in each cell of a grid: see `Pupil.coverage`.

        It is exact if the look direction is turned about one of the pupil's axes. Otherwise it is a mean over points,
        by which the share of a cell on the pupil's edge is off by about a hundredth.
        """
        x_edges, y_edges = np.asarray(x_edges), np.asarray(y_edges)
        size = np.abs(self.matrix)
        if min(size[0, 0], size[1, 1]) > 0.0 and max(size[0, 1], size[1, 0]) < 1e-12:
            x_sense, y_sense = (-1 if self.matrix[axis, axis] < 0.0 else 1 for axis in (0, 1))
            x, y = x_edges / self.matrix[0, 0], y_edges / self.matrix[1, 1]
            return self.pupil.coverage(x[::x_sense], y[::y_sense], power)[::y_sense, ::x_sense]
        inner = (np.arange(SUBDIVISION) + 0.5) / SUBDIVISION
        x = (x_edges[:-1, None] + inner * np.diff(x_edges)[:, None]).ravel()
        found = np.empty((len(y_edges) - 1, len(x_edges) - 1))
        for row, (low, high) in enumerate(pairwise(y_edges)):
            place = np.stack(np.meshgrid(x, low + inner * (high - low)), axis=-1) @ self._inverse.T
            seen = self.pupil.transmission(place[..., 0], place[..., 1]) ** power
            found[row] = seen.reshape(SUBDIVISION, -1, SUBDIVISION).mean(axis=(0, 2))
        return found
