"""Circular pupils: the disc and the annulus, and the exact coverage of grid cells by a circle."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..display.shown import shown
from ..inputs.arguments import checked
from ..inputs.checks import check_positive
from .base import Pupil, cell_shares
from .square_map import RING, SquareMap


def unit_disc_samples(count: int, sampling: str, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return points in the unit disc, shape (n, 2), and weights with a sum of 1, shape (n,).

    "sobol" (scrambled) and "random" give exactly `count` points of equal weights; "gauss" (Gauss-Legendre in r^2,
    equispaced in angle: exact for polynomials) and "grid" (the centres in the disc of the cells of a square grid) give
    about `count`.
    """
    return Disc(1.0).flat_sample(count, sampling, seed)


class _Round(Pupil):
    """Base class of the disc and the annulus."""

    radius: float

    @property
    def _inner(self) -> float:
        return 0.0

    @property
    def reach(self) -> float:
        """Radius of the circle about the centre that encloses the pupil [m]: its radius."""
        return self.radius

    @property
    def half_extent(self) -> tuple[float, float]:
        """Greatest distance from the centre along each of the axes [m]: its radius."""
        return self.radius, self.radius

    @property
    def area(self) -> float:
        """Area [m2]."""
        return float(np.pi * (self.radius**2 - self._inner**2))

    @property
    def inner_ratio(self) -> float | None:
        """Inner over outer radius."""
        return self._inner / self.radius

    @cached_property
    def square_map(self) -> SquareMap:
        """Map of the unit square onto the pupil, in units of `reach`."""
        return SquareMap(RING, 0, 0, np.array([(self._inner / self.radius) ** 2]))

    def coverage(self, x_edges: np.ndarray, y_edges: np.ndarray, power: int = 1) -> np.ndarray:
        """Return the exact fraction of each grid cell that is in the pupil: see `Pupil.coverage`."""
        area = _circle_areas(x_edges, y_edges, self.radius)
        if self._inner > 0.0:
            area = area - _circle_areas(x_edges, y_edges, self._inner)
        return cell_shares(area, x_edges, y_edges, self.radius)

    def transmission(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return 1 in the pupil, its edges included, and 0 elsewhere: see `Pupil.transmission`."""
        squared = np.asarray(x, dtype=np.float64) ** 2 + np.asarray(y, dtype=np.float64) ** 2
        rim, hole = self.radius**2 * (1.0 + 1e-12), self._inner**2 * (1.0 - 1e-12)
        return np.where((squared <= rim) & (squared >= hole), 1.0, 0.0)

    def _gauss(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return Gauss-Legendre points in r^2, equispaced in angle."""
        inner = self._inner / self.radius
        hole = inner**2
        ring_count = max(1, round(np.sqrt(count / 4.0)))
        angle_count = max(1, round(count / ring_count))
        node, weight = np.polynomial.legendre.leggauss(ring_count)
        radius = np.sqrt(0.5 * (node + 1.0) if not inner else hole + (1.0 - hole) * 0.5 * (node + 1.0))
        angle = 2.0 * np.pi * (np.arange(angle_count) + 0.5) / angle_count
        points = np.stack([np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()], axis=1)
        return points, np.repeat(0.5 * weight / angle_count, angle_count)

    def _grid(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the centres of square grid cells that lie in the pupil."""
        hole = (self._inner / self.radius) ** 2
        side = max(1, round(np.sqrt(4.0 * count / (np.pi * (1.0 - hole)))))
        axis = (np.arange(side) + 0.5) * 2.0 / side - 1.0
        x, y = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
        squared = x**2 + y**2
        inside = (squared <= 1.0) & (squared >= hole)
        if not inside.any():  # a ring so thin that it contains no cell's centre
            return self._gauss(count)
        points = np.stack([x[inside], y[inside]], axis=1)
        return points, np.full(len(points), 1.0 / len(points))


@checked
@shown
@dataclass(frozen=True, eq=False)
class Disc(_Round):
    """A flat circular pupil.

    Attributes:
        radius: Radius [m].
        center: Centre [m], shape (3,).
        normal: Direction in which the pupil looks (made a unit vector), shape (3,).

    Raises:
        ValueError: A radius that is not positive, or a centre or normal that is not three finite numbers.
    """

    radius: float
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    if TYPE_CHECKING:  # arrays are made of what is given

        def __init__(self, radius: float, center: ArrayLike = (0, 0, 0), normal: ArrayLike = (0, 0, 1)) -> None: ...  # noqa: D107

    def __post_init__(self):
        """Check and normalise."""
        check_positive(self.radius, "radius of a Disc")
        self._check_place()


@checked
@shown
@dataclass(frozen=True, eq=False)
class Annulus(_Round):
    """A flat circular pupil with a central obstruction.

    Attributes:
        radius: Outer radius [m].
        inner_radius: Radius of the obstruction [m], at least 0 and below `radius`.
        center: Centre [m], shape (3,).
        normal: Direction in which the pupil looks (made a unit vector), shape (3,).

    Raises:
        ValueError: Radii that make no ring, or a centre or normal that is not three finite numbers.
    """

    radius: float
    inner_radius: float
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    if TYPE_CHECKING:  # arrays are made of what is given

        def __init__(  # noqa: D107
            self, radius: float, inner_radius: float, center: ArrayLike = (0, 0, 0), normal: ArrayLike = (0, 0, 1)
        ) -> None: ...

    def __post_init__(self):
        """Check and normalise."""
        check_positive(self.radius, "radius of an Annulus")
        if not (np.isfinite(self.inner_radius) and 0.0 <= self.inner_radius < self.radius):
            raise ValueError(
                f"the inner_radius of an Annulus must be at least 0 m and below its radius of {self.radius!r} m, got "
                f"{self.inner_radius!r}"
            )
        self._check_place()

    @property
    def _inner(self) -> float:
        return float(self.inner_radius)


def _circle_areas(x_edges: np.ndarray, y_edges: np.ndarray, radius: float) -> np.ndarray:
    """Return the area of each grid cell that is in the circle about the origin, shape (y count, x count)."""
    x, y = (np.minimum(np.maximum(np.asarray(edges) / radius, -1.0), 1.0) for edges in (x_edges, y_edges))
    below = area_below(x[None, :], y[:, None])
    rows = below[1:] - below[:-1]
    return np.asarray((rows[:, 1:] - rows[:, :-1]) * radius**2)


def area_below(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    r"""Return the area of the unit disc left of x and below y: \int_{-1}^x (clip(y, -s, s) + s) dt, s^2 = 1 - t^2."""

    def primitive(t):
        return 0.5 * (t * np.sqrt(1.0 - t * t) + np.arcsin(t))

    turn = np.sqrt(1.0 - y * y)  # |t| at which the line y meets the circle
    # The primitive increases, so that it is clipped instead of its argument: it is evaluated once for each edge.
    at_x, at_turn = primitive(x), primitive(turn)
    inside, at_inside = np.minimum(np.maximum(x, -turn), turn), np.minimum(np.maximum(at_x, -at_turn), at_turn)
    middle = y * (inside + turn) + at_inside + at_turn
    ends = np.minimum(at_x, -at_turn) + 0.25 * np.pi + np.maximum(at_x, at_turn) - at_turn
    return middle + np.where(y > 0.0, 2.0 * ends, 0.0)
