"""A density field made from a formula: exact averages over rectangular cells, together with the formula."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..display.shown import shown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_positive
from ..medium import Body, QuadMesh
from .density_field import CellDensity, local_points
from .exact_averages import direction_averages
from .gas import FreeStream

# A spacing given in the wrong unit could otherwise request more cells than fit in memory.
CELL_LIMIT = 4_000_000
# Default number of cells along the field, cells of undisturbed gas around the disturbed region, and the least number of
# cells along either axis.
DEFAULT_CELLS, MARGIN, LEAST_CELLS = 200, 8, 8


class Solution(Protocol):
    """A flow in a plane whose density relative to the ambient density is known everywhere."""

    def density_ratio_at(self, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Density over the ambient density at (y, z) or (r, z) [m]."""
        ...


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

    solution: Solution | None = None

    def density_at(self, points) -> np.ndarray:
        """Return the formula's density [kg/m3], shape (n,), at points (x, y, z) [m], shape (n, 3).

        NaN inside the body and at points that are NaN; the ambient density outside the mesh.

        Raises:
            ValueError: Points of another shape.
        """
        local = local_points(points, self.geometry)
        low, high = self.mesh.box
        inside = np.all((local >= low) & (local <= high), axis=1)
        assert self.solution is not None
        ratio = np.where(inside, self.solution.density_ratio_at(local[:, 0], local[:, 1]), 1.0)
        return self._where_known(self.ambient_density * ratio, local)


def square_step(length: float, spacing: float | None, cells: int = DEFAULT_CELLS) -> float:
    """Return the side of square cells [m]: the greatest divisor of a length that does not exceed the spacing.

    Raises:
        ValueError: A length or a spacing that is not positive and finite.
    """
    check_positive(length, "length")
    count = cells if spacing is None else math.ceil(length / check_positive(spacing, "spacing") * (1.0 - 1e-12))
    return length / count


def edges(low: float, high: float, spacing: float) -> np.ndarray:
    """Return the edges of equal cells [m] that cover a range which contains 0; one edge is at 0.

    Raises:
        ValueError: More than 4 million cells.
    """
    below, above = (math.ceil(reach / spacing * (1.0 - 1e-9)) for reach in (-low, high))
    if below + above > CELL_LIMIT:
        raise ValueError(
            f"spacing {spacing:g} m gives {below + above} cells from {low:g} to {high:g} m: take a wider one"
        )
    return spacing * np.arange(-below, above + 1)


def rectangles(y: np.ndarray, z: np.ndarray, geometry: str = "planar") -> QuadMesh:
    """Return the mesh of rectangles between edges along y (or r) and z [m], with cells in the order [y, z].

    Raises:
        ValueError: Fewer than 8 cells along an axis, or more than 4 million in all.
    """
    cells = (len(y) - 1, len(z) - 1)
    if cells[0] * cells[1] > CELL_LIMIT:
        raise ValueError(f"spacing gives {cells[0]} x {cells[1]} cells, more than {CELL_LIMIT}: take a wider one")
    if min(cells) < LEAST_CELLS:
        raise ValueError(
            f"spacing gives {cells[0]} x {cells[1]} cells: take one with at least {LEAST_CELLS} along either axis"
        )
    first, second = np.meshgrid(y, z, indexing="ij")
    return QuadMesh.structured(first, second, geometry)
