"""Bound the structure between the traced lines of a block from the field itself, so that none is missed.

    E <= K / 384 int s^4 (|d4 m / du^4| + |d4 m / dv^4|) dl + int (kinks) / 8 dl

for the integral of the contrast m between lines s apart, by the greatest derivatives in the tube around them. Tubes
near a body are found by sphere tracing (J. C. Hart, The Visual Computer 12 (1996) 527).
"""

from dataclasses import dataclass

import numpy as np

from aerokernels.tracing.tasks.family import Family

from ...derived import cached_on
from ...medium import IndexField
from ...medium.grid import UniformGrid, local_coordinates
from ..blocks import greatest_around
from ..lines import box_span
from ..step_bound import roughness_of_blocks
from .lattice import undisturbed_length

# Distance between lines, in cells, below which they resolve everything that a grid holds.
RESOLVED = 0.75


@dataclass(frozen=True, eq=False)
class Roughness:
    """Greatest roughness within a block's width of any place, for blocks of `size` [m], twice that, and so on.

    A level has the greatest fourth root of the fourth derivative along each axis [1/m], and kink [1], (*blocks, 2 d).
    """

    low: np.ndarray
    size: np.ndarray
    cell: np.ndarray
    levels: tuple[np.ndarray, ...]

    def at(self, place: np.ndarray, width: np.ndarray) -> np.ndarray:
        """Greatest roughness within `width` [m, per axis] of places, shapes (n, d): shape (n, 2 d), 0 outside."""
        with np.errstate(divide="ignore"):
            level = np.ceil(np.log2(np.maximum(width / self.size, 1e-9)).max(axis=1))
        level = np.clip(level, 0, len(self.levels) - 1).astype(int)
        found = np.zeros((len(place), 2 * len(self.low)))
        for number in np.unique(level):
            table = self.levels[number]
            count = np.array(table.shape[:-1])
            rows = np.flatnonzero(level == number)
            index = np.floor((place[rows] - self.low) / (self.size * 2.0**number)).astype(np.int64)
            near = ((index >= -1) & (index <= count)).all(axis=1)
            index = np.clip(index, 0, count - 1)
            found[rows] = np.where(near[:, None], table[tuple(index.T)], 0.0)
        return found


@dataclass(frozen=True, eq=False)
class Tubes:
    """The tubes around blocks of a family's lines up to their stop, and whether directions are requested."""

    field: IndexField
    family: Family
    until: object
    roughness: Roughness
    counts_direction: bool

    @classmethod
    def of(cls, field: IndexField, family: Family, until, counts_direction: bool) -> "Tubes | None":
        """Return the tubes in a field; None if the field's roughness is not known."""
        if not isinstance(field.samples, UniformGrid):
            return None
        return cls(field, family, until, roughness_of(field.samples), counts_direction)

    def missed(self, middle: np.ndarray, half: np.ndarray, step: np.ndarray, bent: np.ndarray) -> np.ndarray:
        """Bound the interpolation error of blocks [m of OPD; directions are converted to a path], shape (n,).

        Blocks have a middle (n, 2), half a width and a distance of lines (2,) in parameters; lines are `bent` by up to
        [m].
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
        # Factor if directions are requested, whose error is converted to a path over one cell: derivatives are rougher.
        return found * (2.0 if self.counts_direction else 1.0)

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
        # Azimuthal derivatives of an axisymmetric field, divided by the radial ones.
        factor = 2.0 if geometry == "axisymmetric" else 1.0
        found = np.zeros(len(at))
        for axis in range(2):
            resolved = apart[:, axis] * (across[axis] / self.roughness.cell).max() <= RESOLVED
            # Error of a patch divided by s^4 f'''' of both axes, with an allowance for mixed terms and for the slopes'
            # errors.
            # Error of an interpolant at a kink, divided by the kink times the spacing.
            rate = (2.0 / 384.0) * factor * (apart[:, axis] * (fourth @ across[axis])) ** 4 + (1.0 / 8.0) * kink
            found += np.where(resolved, 0.0, rate)
        return found


@cached_on("grid")
def roughness_of(grid: UniformGrid) -> Roughness:
    """The roughness of a field on a grid."""
    block, fourth, kink = roughness_of_blocks(grid)
    table = np.stack([*(np.sqrt(np.sqrt(part)) for part in fourth), *kink], axis=-1)
    levels = []
    # Levels of blocks, each of twice the width.
    for _ in range(12):
        beside = [*[1] * (table.ndim - 1), 0]
        wide = greatest_around(table, np.negative(beside), beside)
        levels.append(np.ascontiguousarray(wide))
        if max(table.shape[:-1]) == 1:
            break
        table = _halved(table)
    cell = np.asarray(grid.spacing, dtype=float)
    return Roughness(np.asarray(grid.low, dtype=float), block * cell, cell, tuple(levels))


def _halved(table: np.ndarray) -> np.ndarray:
    for axis in range(table.ndim - 1):
        if table.shape[axis] % 2:
            width = [(0, 1) if other == axis else (0, 0) for other in range(table.ndim)]
            table = np.pad(table, width)
        even, odd = (table.take(range(first, table.shape[axis], 2), axis) for first in (0, 1))
        table = np.maximum(even, odd)
    return table


# Places along each axis at which the distance is tabulated, by the number of axes, and steps after which a tube does
# not count as clear.
PLACES, MOST_STEPS = {2: 192, 3: 48}, 96


@dataclass(frozen=True, eq=False)
class Distances:
    """A table of distances from a body [m], negative inside, at places low + index * step along the local axes [m]."""

    low: np.ndarray
    step: np.ndarray
    table: np.ndarray

    def at_least(self, place: np.ndarray) -> np.ndarray:
        """Lower bounds of the distances from places (n, d) to the body [m]."""
        index = np.rint((place - self.low) / self.step)
        index = np.clip(index, 0, np.array(self.table.shape) - 1).astype(int)
        nearest = self.low + index * self.step
        off = np.linalg.norm(place - nearest, axis=1)
        # The body is inside the table, so a place outside is at least as far from the body as from the table's edge.
        high = self.low + self.step * (np.array(self.table.shape) - 1)
        outside = np.linalg.norm(np.maximum(np.maximum(self.low - place, place - high), 0.0), axis=1)
        return np.asarray(np.maximum(self.table[tuple(index.T)] - off, outside))


@cached_on("field")
def distances_of(field: IndexField) -> Distances:
    """The distances from a field's body."""
    body = field.body
    assert body is not None
    low = np.minimum(np.asarray(field.samples.low, dtype=float), body.box[0])
    high = np.maximum(np.asarray(field.samples.high, dtype=float), body.box[1])
    count = PLACES[len(low)]
    step = (high - low) / (count - 1)
    places = np.meshgrid(*(low[axis] + step[axis] * np.arange(count) for axis in range(len(low))), indexing="ij")
    distance = body.signed_distance(np.stack([place.ravel() for place in places], axis=1))
    return Distances(low, step, distance.reshape(places[0].shape))


@dataclass(frozen=True, eq=False)
class Clearance:
    """Test tubes around a family's lines against a body."""

    field: IndexField
    family: Family
    until: object

    def of_blocks(self, middle: np.ndarray, half: np.ndarray, bent: float) -> np.ndarray:
        """Which blocks stay clear, (n,), by middles (n, 2) and half widths (2,) in parameters, and the bending [m]."""
        distances = distances_of(self.field)
        position, direction = self.family.rays(middle)
        end = undisturbed_length(self.field, position, direction, self.until)
        # Beyond this distance from the table no line can meet the body.
        extent = float(np.linalg.norm(distances.step * (np.array(distances.table.shape) - 1))) + float(
            np.abs(distances.low).max()
        )
        away = np.linalg.norm(position, axis=1) + 2.0 * extent
        end = np.where(np.isfinite(end) & (end < away), end, away)
        radius = float(np.linalg.norm(half)) * self._greatest_scale(position, direction, end) + bent
        # Margin around the tube, in cells of the table.
        radius = radius + 0.5 * float(distances.step.max())
        at, clear = np.zeros(len(middle)), np.ones(len(middle), bool)
        going = np.ones(len(middle), bool)
        for _ in range(MOST_STEPS):
            rows = np.flatnonzero(going)
            if not len(rows):
                break
            place = position[rows] + at[rows, None] * direction[rows]
            free = distances.at_least(local_coordinates(place, self.field.geometry)) - radius[rows]
            clear[rows] = free > 0.0
            at[rows] += np.maximum(free, 0.0)
            going[rows] = (free > 0.0) & (at[rows] < end[rows])
        return clear & ~going

    def _greatest_scale(self, position: np.ndarray, direction: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Metres per unit of the parameters where the lines are farthest apart, shape (n,)."""
        if not self.family.converges:
            return np.ones(len(position))
        axis = self.family.axes[2]
        ends = [(position + at[:, None] * direction - self.family.origin) @ axis for at in (np.zeros(len(end)), end)]
        return np.asarray(np.maximum(*np.abs(ends)) / (direction @ axis) ** 2)
