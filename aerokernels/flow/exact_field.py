"""A density field made from a formula: exact averages on rectangular cells, and the formula itself beside them."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..display.shown import shown
from ..inputs.checks import check_positive
from ..medium import QuadMesh
from .density_field import CellDensity, in_plane

# More cells than a machine's memory should be asked for by a spacing given in the wrong unit.
CELL_LIMIT = 4_000_000
# Cells along the field where no spacing is given, cells of undisturbed gas around what is disturbed, and the least
# number along either axis.
DEFAULT_CELLS, MARGIN, LEAST_CELLS = 200, 8, 8


class Solution(Protocol):
    """A flow in a plane, of which the density relative to the ambient one is known everywhere."""

    def density_ratio_at(self, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Density over the ambient density at (y, z) or (r, z) [m]."""
        ...


@shown
@dataclass(frozen=True, eq=False)
class ExactField(CellDensity):
    """A density field whose cell averages were made from a formula. See CellDensity for what it shares with that.

    Attributes:
        solution: The flow, with its relations.
    """

    solution: Solution | None = None

    def density_at(self, points) -> np.ndarray:
        """Density by the formula [kg/m3] at points (x, y, z) [m], shape (n, 3): shape (n,).

        NaN inside the body; the ambient density outside the mesh.

        Raises:
            ValueError: Points of another shape.
        """
        local = in_plane(points, self.geometry)
        low, high = self.mesh.box
        inside = np.all((local >= low) & (local <= high), axis=1)
        assert self.solution is not None
        ratio = np.where(inside, self.solution.density_ratio_at(local[:, 0], local[:, 1]), 1.0)
        if self.body is not None:
            ratio = np.where(self.body.contains(local), np.nan, ratio)
        return self.ambient_density * ratio


def square_step(length: float, spacing: float | None, cells: int = DEFAULT_CELLS) -> float:
    """Width of square cells [m]: the greatest that divides a length and is no wider than the spacing, if one is given.

    Raises:
        ValueError: A length or a spacing that is not positive and finite.
    """
    check_positive(length, "length")
    count = cells if spacing is None else math.ceil(length / check_positive(spacing, "spacing") * (1.0 - 1e-12))
    return length / count


def edges(low: float, high: float, spacing: float) -> np.ndarray:
    """Edges of cells of one width [m] that cover a range with 0 in it or at its end; one of them is at 0.

    Raises:
        ValueError: More than 4 million cells.
    """
    below, above = (math.ceil(reach / spacing * (1.0 - 1e-9)) for reach in (-low, high))
    if below + above > CELL_LIMIT:
        raise ValueError(
            f"spacing {spacing:g} m asks for {below + above} cells from {low:g} to {high:g} m: take a wider one"
        )
    return spacing * np.arange(-below, above + 1)


def rectangles(y: np.ndarray, z: np.ndarray, geometry: str = "planar") -> QuadMesh:
    """The mesh of rectangles between edges along y (or r) and z [m]; cells in the order [y, z].

    Raises:
        ValueError: Fewer than 8 cells along an axis, or more than 4 million in all.
    """
    cells = (len(y) - 1, len(z) - 1)
    if cells[0] * cells[1] > CELL_LIMIT:
        raise ValueError(f"spacing asks for {cells[0]} x {cells[1]} cells, more than {CELL_LIMIT}: take a wider one")
    if min(cells) < LEAST_CELLS:
        raise ValueError(
            f"spacing leaves {cells[0]} x {cells[1]} cells: take one with at least {LEAST_CELLS} either way"
        )
    first, second = np.meshgrid(y, z, indexing="ij")
    return QuadMesh.structured(first, second, geometry)
