"""The base class of all pupils."""

import weakref
from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass, fields
from functools import cached_property
from hashlib import blake2b
from itertools import pairwise
from typing import Any

import numpy as np

from ..inputs.checks import check_choice, check_count
from ..inputs.kinds import are_numbers
from ..sobol import sobol_points
from .square_map import SquareMap

SAMPLINGS = ("sobol", "gauss", "grid", "random")

AREA_NOISE = 1e-14  # rounding error of the area of a cell in a pupil, over the pupil's size squared


def cell_shares(area: np.ndarray, x_edges: np.ndarray, y_edges: np.ndarray, size: float) -> np.ndarray:
    """Return the shares of cells (y, x) that a pupil of a size [m] covers, from areas in it [m2] and edges [m]."""
    width, height = (np.asarray(edges)[1:] - np.asarray(edges)[:-1] for edges in (x_edges, y_edges))
    shares = np.where(area > AREA_NOISE * size**2, area, 0.0) / (height[:, None] * width)
    return np.minimum(np.maximum(shares, 0.0, out=shares), 1.0, out=shares)


class Pupil(ABC):
    """A flat aperture of some shape and transmission.

    The transmission is that of the amplitude and may have any scale, since only ratios matter. It is the weight in the
    mean of exp(i k OPD) from which the Strehl ratio is computed.

    Attributes:
        center: Origin of the pupil's coordinates [m], shape (3,).
        normal: Direction in which the pupil faces, a unit vector, shape (3,).
    """

    center: np.ndarray
    normal: np.ndarray

    def _check_place(self) -> None:
        kind = type(self).__name__
        object.__setattr__(self, "center", as_vector(self.center, f"{kind} center"))
        object.__setattr__(self, "normal", as_unit_vector(self.normal, f"{kind} normal"))

    @property
    def key(self) -> Hashable:
        """A key for caches that is equal for equal pupils; classes made elsewhere may hold more than their fields."""
        return self._digest if type(self).__module__.startswith(f"{__package__}.") else weakref.ref(self)

    @cached_property
    def _digest(self) -> tuple:
        """Digests of the numbers of each attribute, and their shapes."""
        numbers = [np.array(getattr(self, entry.name), np.float64) for entry in fields(self)]  # type: ignore[arg-type]
        return type(self), *((one.shape, blake2b(one.tobytes(), digest_size=16).digest()) for one in numbers)

    @cached_property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """The two unit vectors in the pupil's plane, read-only: along x and y if the normal is +z."""
        axes = transverse_axes(self.normal)
        for axis in axes:
            axis.setflags(write=False)
        return axes

    @property
    @abstractmethod
    def reach(self) -> float:
        """Radius of the circle about the centre that encloses the pupil [m]."""

    @property
    @abstractmethod
    def area(self) -> float:
        """Integral of the transmission over the pupil [m2]; its area if the transmission is 1 everywhere."""

    @property
    def _lit_area(self) -> float:
        """Area with a transmission above 0 [m2]."""
        return self.area

    @property
    @abstractmethod
    def half_extent(self) -> tuple[float, float]:
        """Greatest distance from the centre along each of the axes [m]."""

    @property
    def inner_ratio(self) -> float | None:
        """Inner over outer radius of a pupil that is circular about its centre; None for any other."""
        return None

    @cached_property
    @abstractmethod
    def square_map(self) -> SquareMap:
        """Map of the unit square onto the pupil, in units of `reach`."""

    @abstractmethod
    def coverage(self, x_edges: np.ndarray, y_edges: np.ndarray, power: int = 1) -> np.ndarray:
        """Return the exact mean of a power of the transmission in each cell of a grid, shape (y count, x count).

        Args:
            x_edges: Edges of the cells along the first axis, ascending [m], shape (x count + 1,).
            y_edges: Edges of the cells along the second axis, ascending [m], shape (y count + 1,).
            power: 1 for the mean amplitude, 2 for the mean intensity.
        """

    @abstractmethod
    def transmission(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the transmission of the amplitude at coordinates along both axes [m], of their shape; 0 outside."""

    def sample(self, count: int, sampling: str = "sobol", seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return points in the pupil [m], shape (n, 3), and weights with a sum of 1, shape (n,).

        "sobol" (scrambled) and "random" give exactly `count` points of equal weights. "gauss" (a product rule, exact
        for polynomials if the transmission is uniform) and "grid" (centres of grid cells, weighted by the cells' mean
        transmission) give about `count` points.
        """
        flat, weight = self.flat_sample(count, sampling, seed)
        first, second = self.axes
        points = self.center + self.reach * (flat[:, :1] * first + flat[:, 1:] * second)
        return points, weight

    def flat_sample(self, count: int, sampling: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the points of `sample` along both axes in units of `reach`, shape (n, 2), and their weights."""
        count = check_count(count)
        check_choice(sampling, "sampling", SAMPLINGS)
        if sampling == "gauss":
            return self._gauss(count)
        if sampling == "grid":
            return self._grid(count)
        square = sobol_points(count, 2, seed) if sampling == "sobol" else np.random.default_rng(seed).random((count, 2))
        return self.square_map.points(square), np.full(count, 1.0 / count)

    @abstractmethod
    def _gauss(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return about `count` points in units of `reach` and their weights, exact for polynomials where possible."""

    def _grid(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the centres of the grid cells that the pupil covers at least in part, and their weights."""
        width, height = (2.0 * extent for extent in self.half_extent)
        cell = np.sqrt(self._lit_area / count)
        counts = max(1, round(width / cell)), max(1, round(height / cell))
        x_edges, y_edges = (
            np.linspace(-0.5 * size, 0.5 * size, n + 1) for size, n in zip((width, height), counts, strict=True)
        )
        weight = self.coverage(x_edges, y_edges)
        x, y = np.meshgrid(*(0.5 * (edge[1:] + edge[:-1]) / self.reach for edge in (x_edges, y_edges)))
        lit = weight > 0.0
        return np.stack([x[lit], y[lit]], axis=1), weight[lit] / weight[lit].sum()


def as_vector(value, name: str) -> np.ndarray:
    """Return `value` as a finite float64 vector of shape (3,), a read-only copy: callers may reuse their array.

    Raises:
        TypeError: It does not consist of numbers.
        ValueError: It is not three finite numbers.
    """
    if not are_numbers(value):
        raise TypeError(f"{name} must be three finite numbers (x, y, z), got {value!r}")
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{name} must be three finite numbers (x, y, z), got {value!r}")
    vector.setflags(write=False)
    return vector


def as_unit_vector(value, name: str) -> np.ndarray:
    """Return `value` normalised to length 1, read-only, shape (3,).

    Raises:
        TypeError: As for `as_vector`.
        ValueError: As for `as_vector`, or the zero vector.
    """
    vector = as_vector(value, name)
    greatest = np.abs(vector).max()
    if greatest == 0.0:
        raise ValueError(f"{name} must not be the zero vector")
    # Scaled first, because the squared length of a very long or short vector would overflow or underflow.
    vector = vector / greatest
    vector /= np.linalg.norm(vector)
    vector.setflags(write=False)
    return vector


def transverse_axes(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors that complete `normal` to a right-handed frame; x and y if `normal` is +z."""
    helper = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    first = _cross(helper, normal)
    first /= np.linalg.norm(first)
    return first, _cross(normal, first)


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the cross product of two vectors (3,), in a tenth of the time of `np.cross`."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors (n, 3), shape (n,), in a fifth of the time of `np.linalg.norm`."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def direction_of(azimuth: Any, elevation: Any) -> np.ndarray:
    """Return look directions, shape (..., 3), of azimuths toward +x and elevations toward +y [rad]; 0, 0 is +z."""
    flat = np.cos(elevation)
    return np.stack(np.broadcast_arrays(np.sin(azimuth) * flat, np.sin(elevation), np.cos(azimuth) * flat), axis=-1)


# Points along each side of a cell at which the transmission of a pupil seen askew is sampled.
SUBDIVISION = 16


def across_look(pupil: Pupil, look: np.ndarray) -> np.ndarray:
    """Return the matrix (2, 2) from coordinates in the pupil's plane to those across a look direction."""
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
    """A pupil in coordinates across a look direction; `matrix` (2, 2) makes these of those in its plane."""

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

        Exact if the look direction is turned about one of the pupil's axes; otherwise a mean over points, by which the
        share of a cell on the pupil's edge is off by about a hundredth.
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
