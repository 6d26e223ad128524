"""Find the blocks of lines that stay clear of the body; rays of the other blocks might touch it, and are traced.

The distance to the body is tabulated once. The tube around a block's lines is followed by sphere tracing, in steps
along its centre line that are as long as the distance allows (J. C. Hart, The Visual Computer 12 (1996) 527), so that
no thin part of the body is stepped over.
"""

from dataclasses import dataclass

import numpy as np

from ...medium import IndexField
from ...medium.grid import local_coordinates
from .family import Family
from .nodes import undisturbed_length

# Places along each axis at which the distance is tabulated, by the number of axes, and steps after which a tube does
# not count as clear.
PLACES, MOST_STEPS = {2: 192, 3: 48}, 96
# Margin around the tube, in cells of the table.
ROOM = 0.5


@dataclass(frozen=True, eq=False)
class Distances:
    """A table of distances from a body along the local axes.

    Attributes:
        low: First place of the table [m], shape (d,).
        step: Distance of places [m], shape (d,).
        table: Distance to the body [m], negative inside, of d axes.
    """

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


def distances_of(field: IndexField) -> Distances:
    """The distances from a field's body, cached on the field."""
    found: Distances = field.derive("distances from the body", lambda: _distances_of(field))
    return found


def _distances_of(field: IndexField) -> Distances:
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
        """Which blocks stay clear, shape (n,).

        Args:
            middle: Parameters of their middles, shape (n, 2).
            half: Half their width in parameters, shape (2,).
            bent: Greatest displacement of the lines [m].
        """
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
        radius = radius + ROOM * float(distances.step.max())
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
