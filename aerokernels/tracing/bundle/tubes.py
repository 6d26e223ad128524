r"""Bound the structure between the traced lines of a block from the field itself, so that none is missed.

The error of a line integral of the contrast m, interpolated between lines a distance s apart, is at most

    E <= K / 384 int s^4 (|d4 m / du^4| + |d4 m / dv^4|) dl + int (kinks) / 8 dl

with the greatest derivatives within the tube around the block's lines. Where s is below RESOLVED cells, a sampled field
holds nothing that the lines do not show, and the residuals of refine.py are relied on instead.
"""

from dataclasses import dataclass

import numpy as np

from ...medium import IndexField
from ...medium.grid import local_coordinates
from ..lines import box_span
from .family import Family
from .nodes import undisturbed_length
from .roughness import Roughness, roughness_of

# Distance between lines, in cells, below which they resolve everything that a grid holds.
RESOLVED = 0.75
# Error of a patch divided by s^4 f'''' of both axes, with an allowance for mixed terms and for the slopes' errors.
CONSTANT = 2.0 / 384.0
# Factor if directions are requested, whose error is converted to a path over one cell: derivatives are rougher.
OF_DIRECTION = 2.0
# Azimuthal derivatives of an axisymmetric field, divided by the radial ones.
ABOUT_AXIS = 2.0
# Error of an interpolant at a kink, divided by the kink times the spacing.
OF_KINK = 1.0 / 8.0


@dataclass(frozen=True, eq=False)
class Tubes:
    """The tubes around blocks of a family's lines.

    Attributes:
        field: The refractive index.
        family: The lines.
        until: Where the rays end.
        roughness: Roughness of the field.
        counts_direction: Whether directions are requested.
    """

    field: IndexField
    family: Family
    until: object
    roughness: Roughness
    counts_direction: bool

    @classmethod
    def of(cls, field: IndexField, family: Family, until, counts_direction: bool) -> "Tubes | None":
        """Return the tubes in a field; None if the field's roughness is not known."""
        roughness = roughness_of(field)
        return None if roughness is None else cls(field, family, until, roughness, counts_direction)

    def missed(self, middle: np.ndarray, half: np.ndarray, step: np.ndarray, bent: np.ndarray) -> np.ndarray:
        """Bound the interpolation error of blocks [m of OPD; directions are converted to a path], shape (n,).

        Args:
            middle: Parameters of the blocks' middles, shape (n, 2).
            half: Half their width in parameters, shape (2,).
            step: Distance between lines in parameters, shape (2,).
            bent: Greatest displacement of the lines [m], shape (n,).
        """
        position, direction = self.family.rays(middle)
        corners = [self.family.rays(middle + half * sign) for sign in np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])]
        begin, end = self._span(position, direction)
        for place, along in corners:
            first, last = self._span(place, along)
            begin, end = np.minimum(begin, first), np.maximum(end, last)
        length = np.where(end > begin, end - begin, 0.0)
        stride = float(self.roughness.size.min())
        found = np.zeros(len(middle))
        steps = int(np.ceil(length.max(initial=0.0) / stride))
        for number in range(steps):
            rows = np.flatnonzero(begin + number * stride < end)
            at = begin[rows] + (number + 0.5) * stride
            found[rows] += stride * self._rate(position[rows], direction[rows], at, half, step, bent[rows])
        return found * (OF_DIRECTION if self.counts_direction else 1.0)

    def greatest_spacing(self, middle: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Greatest distance, in cells of the field, between the lines around the middles (n, 2), shape (n,)."""
        position, direction = self.family.rays(middle)
        begin, end = self._span(position, direction)
        found = np.zeros(len(middle))
        for at in (np.where(end > begin, begin, 0.0), np.where(end > begin, end, 0.0)):
            apart = self._scale(position + at[:, None] * direction, direction)[:, None] * step
            for axis, across in enumerate(self._across()):
                found = np.maximum(found, apart[:, axis] * (across / self.roughness.cell).max())
        return found

    def _scale(self, place: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Metres per unit of the parameters at places (n, 3) on lines."""
        if not self.family.converges:
            return np.ones(len(place))
        axis = self.family.axes[2]
        return np.asarray(np.abs((place - self.family.origin) @ axis) / (direction @ axis))

    def _across(self) -> np.ndarray:
        """Absolute components along the local axes of unit vectors along both parameters, shape (2, d)."""
        return local_coordinates(np.abs(self.family.axes[:2]), self.field.geometry)

    def _span(self, position: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        span = box_span(self.field, position, direction)
        stop = undisturbed_length(self.field, position, direction, self.until)
        end = np.minimum(span.leave, np.where(stop > 0.0, stop, np.inf))
        meets = span.meets & np.isfinite(end)
        return np.where(meets, span.enter, np.inf), np.where(meets, end, -np.inf)

    def _rate(self, position, direction, at, half, step, bent) -> np.ndarray:
        """The bound per metre of the lines at distances `at`."""
        geometry = self.field.geometry
        dimension = len(self.roughness.low)
        place = position + at[:, None] * direction
        scale = self._scale(place, direction)
        apart = scale[:, None] * step
        reach = (scale[:, None] * half) @ np.abs(self.family.axes[:2]) + bent[:, None]
        reach, across = local_coordinates(reach, geometry), self._across()
        rough = self.roughness.at(local_coordinates(place, geometry), reach)
        fourth, kink = rough[:, :dimension], rough[:, dimension:].sum(axis=1)
        factor = ABOUT_AXIS if geometry == "axisymmetric" else 1.0
        found = np.zeros(len(at))
        for axis in range(2):
            resolved = apart[:, axis] * (across[axis] / self.roughness.cell).max() <= RESOLVED
            rate = CONSTANT * factor * (apart[:, axis] * (fourth @ across[axis])) ** 4 + OF_KINK * kink
            found += np.where(resolved, 0.0, rate)
        return found
