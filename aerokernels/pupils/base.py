"""The base class of all pupils."""

import weakref
from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import fields
from functools import cached_property
from hashlib import blake2b

import numpy as np

from ..inputs.checks import check_choice, check_count
from ..sobol import sobol_points
from .square_map import SquareMap
from .vectors import as_unit_vector, as_vector, transverse_axes

SAMPLINGS = ("sobol", "gauss", "grid", "random")

AREA_NOISE = 1e-14  # rounding error of the area of a cell in a pupil, over the pupil's size squared


def cell_shares(area: np.ndarray, x_edges: np.ndarray, y_edges: np.ndarray, size: float) -> np.ndarray:
    """Return the fractions of a grid's cells that a pupil covers; zero where the area is within rounding errors.

    Args:
        area: Area of each cell in the pupil [m2], shape (y count, x count).
        x_edges: Edges of the cells along the first axis [m].
        y_edges: Edges of the cells along the second axis [m].
        size: Size of the pupil [m].
    """
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
