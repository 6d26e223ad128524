"""A density field made from a formula: exact averages over rectangular cells, together with the formula.

A density f of the direction from the origin alone has div(f x) = 2 f, and the integral over a cell becomes one over its
edges: 2 int f dA = z+ int_{z+} f dy - z- int_{z-} f dy + y+ int_{y+} f dz - y- int_{y-} f dz. An edge is split at
shocks and Mach lines and each part integrated by Gauss's rule. Rounding error: 1e-16 of the change within a cell, times
the number of cells from the origin.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from aerokernels.display.shown import shown
from aerokernels.flow.density_field import local_points
from aerokernels.flow.gas import GAMMA_AIR, SEA_LEVEL_DENSITY, FreeStream, check_density, check_gamma
from aerokernels.flow.sampled_density import CellDensity
from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import check_positive
from aerokernels.medium import Body, QuadMesh

# A spacing given in the wrong unit could otherwise request more cells than fit in memory.
CELL_LIMIT = 4_000_000
# Default number of cells along the field, and cells of undisturbed gas around the disturbed region.
DEFAULT_CELLS, MARGIN = 200, 8


class DirectionFlow(ABC):
    """A flow in a plane whose density depends only on the direction from the origin; the stream comes from +z."""

    @abstractmethod
    def ratio_of_angle(self, angle) -> np.ndarray:
        """Density over the ambient density in a direction from the origin, an angle from -z towards +y [rad]."""

    @property
    @abstractmethod
    def breaks(self) -> tuple[float, ...]:
        """Directions of its jumps and kinks [rad]."""

    @checked
    def density_ratio_at(self, y: Numbers, z: Numbers) -> np.ndarray:
        """Density over the ambient density at (y, z) [m]."""
        return self.ratio_of_angle(np.arctan2(y, -np.asarray(z)))

    def field(
        self, y: np.ndarray, z: np.ndarray, stream: FreeStream, body: Body | None, provenance: str
    ) -> "ExactField":
        """Return the flow as a density field on rectangular cells between edges along y and z [m]."""
        mesh = rectangles(y, z)
        ratio = direction_averages(self.ratio_of_angle, self.breaks, y, z)
        return ExactField(mesh, stream.density * ratio, stream.density, body, stream, provenance, self)


@shown
@dataclass(frozen=True, eq=False)
class ExactField(CellDensity):
    """A density field whose cell averages were made from a formula; see `CellDensity` for its other attributes.

    Attributes:
        solution: The flow, with its relations.
    """

    solution: Any = None

    def density_at(self, points) -> np.ndarray:
        """Return the formula's density [kg/m3], shape (n,), at points (x, y, z) [m], shape (n, 3).

        NaN inside the body and at points that are NaN; the ambient density outside the mesh.
        """
        local = local_points(points, self.geometry)
        low, high = self.mesh.box
        inside = np.all((local >= low) & (local <= high), axis=1)
        ratio = np.where(inside, self.solution.density_ratio_at(local[:, 0], local[:, 1]), 1.0)
        return self._where_known(self.ambient_density * ratio, local)


def square_step(length: float, spacing: float | None, cells: int = DEFAULT_CELLS) -> float:
    """Return the side of square cells [m]: the greatest divisor of a length that does not exceed the spacing."""
    check_positive(length, "length")
    count = cells if spacing is None else math.ceil(length / check_positive(spacing, "spacing") * (1.0 - 1e-12))
    return length / count


def edges(low: float, high: float, spacing: float) -> np.ndarray:
    """Return the edges of equal cells [m] that cover a range which contains 0; one edge is at 0."""
    below, above = (math.ceil(reach / spacing * (1.0 - 1e-9)) for reach in (-low, high))
    if below + above > CELL_LIMIT:
        raise ValueError(
            f"spacing {spacing:g} m gives {below + above} cells from {low:g} to {high:g} m: take a wider one"
        )
    return spacing * np.arange(-below, above + 1)


def rectangles(y: np.ndarray, z: np.ndarray, geometry: str = "planar") -> QuadMesh:
    """Return the mesh of rectangles between edges along y (or r) and z [m], with cells in the order [y, z]."""
    cells = (len(y) - 1, len(z) - 1)
    if cells[0] * cells[1] > CELL_LIMIT:
        raise ValueError(f"spacing gives {cells[0]} x {cells[1]} cells, more than {CELL_LIMIT}: take a wider one")
    first, second = np.meshgrid(y, z, indexing="ij")
    return QuadMesh.structured(first, second, geometry)


def unit_gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and weights of Gauss's rule on the interval from 0 to 1, shape (points,) each."""
    node, weight = np.polynomial.legendre.leggauss(points)
    return 0.5 * (node + 1.0), 0.5 * weight


def piecewise_means(
    function: Callable[[np.ndarray], np.ndarray], edges: np.ndarray, breaks: Sequence[float]
) -> np.ndarray:
    """Return means over the intervals between increasing edges of a function that is smooth between `breaks`."""
    share, weight = unit_gauss(12)
    low, high = edges[:-1], edges[1:]
    cuts = np.stack([low, *(np.clip(place, low, high) for place in sorted(breaks)), high])
    start, width = cuts[:-1], np.diff(cuts, axis=0)
    values = function(start[..., None] + width[..., None] * share)
    # Averaging differences from the first value returns a constant function to the last bit.
    first = values[..., 0]
    mean = first + (values - first[..., None]) @ weight
    return (width / (high - low) * mean).sum(axis=0)


def direction_averages(
    function: Callable[[np.ndarray], np.ndarray], breaks: Sequence[float], y: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Return averages over rectangles, with edges y and z [m], of a function of the direction from the origin.

    The direction is the angle from -z towards +y [rad], -pi to pi; `breaks` are those of the function's jumps and
    kinks.
    """
    cosine, sine = np.cos(breaks), np.sin(breaks)
    # Means along the edges of constant y and of constant z: each edge belongs to two cells and is integrated once.
    level = np.empty((len(y), len(z) - 1))
    for row, height in enumerate(y):
        # A break is a ray from the origin: where it meets the line of this height.
        meets = sine * height > 0.0
        places = -height * cosine[meets] / sine[meets]
        level[row] = piecewise_means(partial(_seen_from_origin, function, height), z, places)
    upright = np.empty((len(y) - 1, len(z)))
    for column, depth in enumerate(z):
        meets = -cosine * depth > 0.0
        places = -depth * sine[meets] / cosine[meets]
        upright[:, column] = piecewise_means(partial(_seen_from_origin, function, z=depth), y, places)
    # A constant is homogeneous too: subtracting the value in the middle returns uniform gas to the last bit.
    middle = function(np.arctan2((0.5 * (y[:-1] + y[1:]))[:, None], -0.5 * (z[:-1] + z[1:])))
    across = (z[1:] * (upright[:, 1:] - middle) - z[:-1] * (upright[:, :-1] - middle)) / np.diff(z)
    along = y[1:, None] * (level[1:] - middle) - y[:-1, None] * (level[:-1] - middle)
    return middle + 0.5 * (across + along / np.diff(y)[:, None])


def _seen_from_origin(function, y, z):
    return function(np.arctan2(y, -z))


def smooth_averages(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray], y: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Return averages over rectangular cells of a function of (y, z), smooth in each, by a product Gauss rule."""
    share, weight = unit_gauss(8)
    across = y[:-1, None] + np.diff(y)[:, None] * share
    along = z[:-1, None] + np.diff(z)[:, None] * share
    result = np.empty((len(across), len(along)))
    for row, place in enumerate(across):
        values = function(place[:, None, None], along[None])
        result[row] = np.einsum("inj,i,j->n", values, weight, weight)
    return result


@checked
def uniform_air(
    density: float = SEA_LEVEL_DENSITY,
    *,
    body: Body | None = None,
    radius: float = 0.04,
    z_range: tuple[float, float] = (-0.04, 0.01),
) -> CellDensity:
    """Return uniform air at rest, such as that in a tunnel before it is started.

    Args:
        density: [kg/m3].
        body: A solid body in the air.
        radius: Radius of the axisymmetric box of the field [m]; the air outside it is the same.
        z_range: Lowest and highest z of the box [m].

    Raises:
        ValueError: A density or radius that is not positive and finite, or a range that does not increase.
    """
    check_positive(radius, "radius")
    low, high = z_range
    if not low < high:
        raise ValueError(f"z_range must increase, got {z_range!r}")
    # Five-point gradients need four cells; eight leave some room.
    nodes = np.meshgrid(np.linspace(0.0, radius, 9), np.linspace(low, high, 9), indexing="ij")
    mesh, ambient = QuadMesh.structured(*nodes, "axisymmetric"), check_positive(density, "density")
    return CellDensity(mesh, np.full(len(mesh.cells), ambient), ambient, body, None, f"air at rest, {ambient:g} kg/m3")


# Half width of the field in radii: at its faces the temperature deviation is 1e-15 of that in the middle.
REACH = 6.0


@dataclass(frozen=True)
class Vortex:
    """An isentropic vortex about the line x = 0, y = 0, z = 0 of the optical frame.

    Attributes:
        mach: Greatest speed of the swirl over the sound speed far away.
        radius: Radius at which the swirl is fastest [m].
        gamma: Ratio of specific heats.
    """

    mach: float
    radius: float
    gamma: float = GAMMA_AIR

    def __post_init__(self):
        """Check the numbers."""
        check_positive(self.mach, "mach")
        check_positive(self.radius, "radius")
        check_gamma(self.gamma)
        greatest = math.sqrt(2.0 / ((self.gamma - 1.0) * math.e))
        if self.mach >= greatest:
            raise ValueError(
                f"mach {self.mach:g} is too great for a vortex: it must be below {greatest:.6g}, where the gas in the "
                f"middle reaches vacuum (gamma {self.gamma:g})"
            )

    @checked
    def temperature_ratio_at(self, distance: Numbers) -> np.ndarray:
        """Temperature over that far away at distances from the middle [m]."""
        square = (np.asarray(distance, dtype=np.float64) / self.radius) ** 2
        return 1.0 - 0.5 * (self.gamma - 1.0) * self.mach**2 * np.exp(1.0 - square)

    @checked
    def density_ratio_at(self, y: Numbers, z: Numbers) -> np.ndarray:
        """Density over that far away at (y, z) [m]."""
        return self.temperature_ratio_at(np.hypot(y, z)) ** (1.0 / (self.gamma - 1.0))


@checked
def vortex(
    mach: float,
    *,
    radius: float = 0.01,
    density: float = SEA_LEVEL_DENSITY,
    spacing: float | None = None,
    gamma: float = GAMMA_AIR,
) -> ExactField:
    """Return the isentropic vortex as a planar density field, with its axis along x through the origin.

    The field extends six radii to each side, where the density equals the ambient one to rounding. Cell averages by
    Gauss's rule are accurate to 1e-11 for cells up to half a radius.

    Args:
        mach: Greatest speed of the swirl over the sound speed far away; below 1.356 in air.
        radius: Radius at which the swirl is fastest [m].
        density: Density far away [kg/m3].
        spacing: Greatest side of the square cells [m]; None takes 1/40 of the radius.
        gamma: Ratio of specific heats.

    Raises:
        ValueError: A quantity that is not positive, a Mach number at which the middle reaches vacuum, gamma not above
            1, or a spacing that exceeds half a radius or gives too many cells.
    """
    swirl = Vortex(float(mach), float(radius), float(gamma))
    check_density(density, "density")
    step = radius / 40 if spacing is None else check_positive(spacing, "spacing")
    if step > 0.5 * radius * (1.0 + 1e-9):
        raise ValueError(f"spacing {step:g} m must be at most half the radius {radius:g} m")
    side = edges(-REACH * radius, REACH * radius, step)
    return ExactField(
        rectangles(side, side),
        density * smooth_averages(swirl.density_ratio_at, side, side),
        density,
        provenance=f"exact isentropic vortex of Mach {mach:g} and radius {radius:g} m",
        solution=swirl,
    )
