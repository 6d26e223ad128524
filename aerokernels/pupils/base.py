"""What all pupils have in common."""

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np

from ..inputs.checks import check_choice, check_count
from ..sobol import sobol_points
from .square_map import SquareMap
from .vectors import as_unit_vector, as_vector, transverse_axes

SAMPLINGS = ("sobol", "gauss", "grid", "random")

AREA_NOISE = 1e-14  # of a pupil's size squared: what the area of a cell that lies in it is rounded to


def cell_shares(area: np.ndarray, x_edges: np.ndarray, y_edges: np.ndarray, size: float) -> np.ndarray:
    """Areas [m^2] of a grid's cells in a pupil of that size [m], as shares of the cells; none where rounding is all."""
    cells = np.diff(y_edges)[:, None] * np.diff(x_edges)[None, :]
    return np.clip(np.where(area > AREA_NOISE * size**2, area, 0.0) / cells, 0.0, 1.0)


class Pupil(ABC):
    """A flat aperture of some shape and transmission.

    The transmission is that of the amplitude, of any scale: what counts are shares. It weights the mean of exp(i k OPD)
    that the Strehl ratio is made of.

    Attributes:
        center: The point from which its coordinates are measured [m], shape (3,).
        normal: Direction in which it looks, a unit vector, shape (3,).
    """

    center: np.ndarray
    normal: np.ndarray

    def _check_place(self) -> None:
        kind = type(self).__name__
        object.__setattr__(self, "center", as_vector(self.center, f"{kind} center"))
        object.__setattr__(self, "normal", as_unit_vector(self.normal, f"{kind} normal"))

    @cached_property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """The two unit vectors in the pupil's plane, read-only: x and y where it looks along z."""
        axes = transverse_axes(self.normal)
        for axis in axes:
            axis.setflags(write=False)
        return axes

    @property
    @abstractmethod
    def reach(self) -> float:
        """Radius of the circle about the centre that holds the pupil [m]."""

    @property
    @abstractmethod
    def area(self) -> float:
        """Integral of the transmission over the pupil [m2]; its area where all of it transmits alike."""

    @property
    def _lit_area(self) -> float:
        """Area that light gets through [m2]."""
        return self.area

    @property
    @abstractmethod
    def half_extent(self) -> tuple[float, float]:
        """The greatest distance from the centre along each of the axes [m]."""

    @property
    def inner_ratio(self) -> float | None:
        """Inner over outer radius of a pupil that is round about its centre; None for any other."""
        return None

    @cached_property
    @abstractmethod
    def square_map(self) -> SquareMap:
        """How the unit square is mapped on it, in units of `reach`."""

    @abstractmethod
    def coverage(self, x_edges: np.ndarray, y_edges: np.ndarray, power: int = 1) -> np.ndarray:
        """Mean of the transmission's power in each cell of a grid, exact, shape (y count, x count).

        Args:
            x_edges: Edges of the cells along the first axis, ascending [m], shape (x count + 1,).
            y_edges: Those along the second, shape (y count + 1,).
            power: 1 for the mean amplitude, 2 for the mean intensity.
        """

    @abstractmethod
    def transmission(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Transmission of the amplitude at points along both axes from the centre [m], of their shape; 0 outside."""

    def sample(self, count: int, sampling: str = "sobol", seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Points in the pupil [m], shape (n, 3), and weights that sum to 1, shape (n,).

        "sobol" (scrambled) and "random" give exactly `count` points of equal weights; "gauss" (a product rule, exact
        for polynomials over a shape of one transmission) and "grid" (cells of a grid, each with its share) about
        `count`.
        """
        flat, weight = self.flat_sample(count, sampling, seed)
        first, second = self.axes
        points = self.center + self.reach * (flat[:, :1] * first + flat[:, 1:] * second)
        return points, weight

    def flat_sample(self, count: int, sampling: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Points along both axes in units of `reach`, shape (n, 2), and weights: those of `sample`."""
        count = check_count(count)
        check_choice(sampling, "sampling", SAMPLINGS)
        return self._flat_sample(count, sampling, seed)

    def _flat_sample(self, count: int, sampling: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
        if sampling == "gauss":
            return self._gauss(count)
        if sampling == "grid":
            return self._grid(count)
        square = sobol_points(count, 2, seed) if sampling == "sobol" else np.random.default_rng(seed).random((count, 2))
        return self.square_map.points(square), np.full(count, 1.0 / count)

    @abstractmethod
    def _gauss(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """About `count` points in units of `reach` and their weights, exact for polynomials where that can be."""

    def _grid(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The centres of the cells of a grid that the pupil covers some of, weighted by how much."""
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
