"""The paths of traced rays through a field's box, and integrals of other contrasts along them.

A path is a cubic that begins and ends at the ray's crossings of the box with the ray's directions there. To first order
a change e of the contrast adds int e ds to the optical path, turns the ray by int grad e ds / n across it, and moves it
at its stop by int (length left) grad e ds / n.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...medium import IndexField
from ..lines import after_body, box_span, cell_along
from ..stop import Plane, stop_distance

GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
# Least and greatest number of pieces of a path, each with two Gauss points.
LEAST_PIECES, MOST_PIECES = 8, 2048
# Attributes of paths that have an entry for each ray.
OF_RAYS = ("first", "last", "ahead", "onward", "length", "rest")
# points (m, 3) [m] -> contrast (m,) and its gradient [1/m] (m, 3)
Contrast = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Rays:
    """OPD [m], (n,), direction and position [m], (n, 3), of rays at their stop, or a difference of two runs."""

    opd: np.ndarray
    direction: np.ndarray
    position: np.ndarray

    @classmethod
    def still(cls, count: int) -> "Rays":
        """The difference of two equal runs."""
        return cls(np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3)))

    def __add__(self, other: "Rays") -> "Rays":
        """Return the sum of both."""
        return Rays(self.opd + other.opd, self.direction + other.direction, self.position + other.position)

    def __sub__(self, other: "Rays") -> "Rays":
        """Return the difference of both."""
        return Rays(self.opd - other.opd, self.direction - other.direction, self.position - other.position)

    def __mul__(self, factor: float | np.ndarray) -> "Rays":
        """Return everything times a number, or each ray times its own, shape (n,)."""
        return Rays(self.opd * factor, (self.direction.T * factor).T, (self.position.T * factor).T)

    def __getitem__(self, rows) -> "Rays":
        """Return some of the rays."""
        return Rays(self.opd[rows], self.direction[rows], self.position[rows])

    def lifted(self, piston: float) -> "Rays":
        """Return the rays with a length added to every path [m]."""
        return Rays(self.opd + piston, self.direction, self.position)

    def put(self, rows: np.ndarray, part: "Rays") -> None:
        """Overwrite some of the rays."""
        self.opd[rows], self.direction[rows], self.position[rows] = part.opd, part.direction, part.position


@dataclass(frozen=True, eq=False)
class Cause:
    """How the rays change by one cause of an error.

    Signed changes to what is right, of these rays, each of which counts by itself; changes that are like those; and
    equally likely draws, of which one is real.
    """

    known: tuple[Rays, ...] = ()
    like: tuple[Rays, ...] = ()
    draws: tuple[Rays, ...] = ()


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths of rays through a box: ends [m] and unit directions there (n, 3), lengths [m] (n,), or 0.

    `rest` is the length from there to the stop [m], (n,), `normal` that of the plane at which the rays stop, or None,
    and `index` the ambient index.
    """

    first: np.ndarray
    last: np.ndarray
    ahead: np.ndarray
    onward: np.ndarray
    length: np.ndarray
    rest: np.ndarray
    normal: np.ndarray | None
    index: float

    def at(self, share: np.ndarray) -> np.ndarray:
        """Return the points at shares of the lengths, (k,) or (n, k), as an array of shape (n, k, 3) [m]."""
        t = np.broadcast_to(share, (len(self.length), np.shape(share)[-1]))[..., None]
        chord = (self.last - self.first)[:, None]
        size = np.linalg.norm(chord, axis=2, keepdims=True)
        begin, end = size * self.ahead[:, None] - chord, size * self.onward[:, None] - chord
        bend = t * (1.0 - t) * ((1.0 - t) * begin - t * end)
        return np.asarray(self.first[:, None] + t * chord + bend)

    def rows(self, rows: np.ndarray) -> "Paths":
        """Return some of the paths."""
        return replace(self, **{name: getattr(self, name)[rows] for name in OF_RAYS})

    @classmethod
    def joined(cls, paths: Sequence["Paths"], normal: np.ndarray | None = None) -> "Paths":
        """Return the paths of several bundles in one; `normal` is that of the plane at which all stop."""
        together: dict[str, Any] = {name: np.concatenate([getattr(one, name) for one in paths]) for name in OF_RAYS}
        return replace(paths[0], normal=normal, **together)

    def integral(self, contrast: Contrast, cell: float) -> Rays:
        """Return what a change of the contrast adds to each ray, by Gauss points of pieces of at most `cell` [m]."""
        found = Rays.still(len(self.length))
        rows = np.flatnonzero(self.length > 0.0)
        if not len(rows):
            return found
        some = self.rows(rows)
        pieces = int(np.clip(np.ceil(some.length.max() / cell), LEAST_PIECES, MOST_PIECES))
        share = ((np.arange(pieces)[:, None] + GAUSS) / pieces).ravel()
        points = some.at(share)
        value, slope = contrast(points.reshape(-1, 3))
        weight = np.repeat(some.length[:, None] / len(share), len(share), axis=1)
        found.put(rows, some.carried(value.reshape(weight.shape), slope.reshape(*weight.shape, 3), share, weight))
        return found

    def carried(self, value: np.ndarray, slope: np.ndarray, share: np.ndarray, weight: np.ndarray) -> Rays:
        """What changes of the contrast (n, k) and its gradient [1/m] (n, k, 3) on the paths add at the stop.

        They are at a `share` of the length, and stand for a length of `weight` [m], (n, k).
        """
        left = (1.0 - share) * self.length[:, None] + self.rest[:, None]
        turned = np.einsum("nk,nki->ni", weight / self.index, slope)
        moved = np.einsum("nk,nki->ni", weight * left / self.index, slope)
        return self.landed(np.sum(weight * value, axis=1), turned, moved)

    def landed(self, opd: np.ndarray, turned: np.ndarray, moved: np.ndarray) -> Rays:
        """Changes at the stop of rays that are turned, and moved [m] where they would meet it, both (n, 3).

        A plane that is askew to a ray is met sooner or later by the one that is moved, which adds to its path.
        """
        turned, moved = (
            part - np.sum(part * self.onward, axis=1, keepdims=True) * self.onward for part in (turned, moved)
        )
        if self.normal is not None:
            later = -(moved @ self.normal) / (self.onward @ self.normal)
            opd, moved = opd + self.index * later, moved + later[:, None] * self.onward
        return Rays(opd, turned, moved)


def paths_of(field: IndexField, position: np.ndarray, direction: np.ndarray, until, ends=None) -> Paths:
    """The paths of rays through a field's box to their stop; None: where they leave it.

    `ends` are where they stopped [m] and their unit directions there, both (n, 3); None takes straight lines.
    """
    span = box_span(field, position, direction)
    enter, leave = span.enter, np.minimum(span.leave, stop_distance(position, direction, until))
    if field.body is not None:
        enter = after_body(field.body, position, direction, enter)
    good = span.meets & (leave > enter) & np.isfinite(leave)
    enter, leave = np.where(good, enter, 0.0), np.where(good, leave, 0.0)
    stop = stop_distance(position, direction, until)
    rest = np.where(np.isfinite(stop) & good, stop - leave, 0.0)
    first, last, onward = position + enter[:, None] * direction, position + leave[:, None] * direction, direction
    if ends is not None:  # the traced ray's last leg, back to where it left the box
        back = box_span(field, ends[0], -ends[1])
        inside = good & back.meets & np.isfinite(back.enter)
        distance = np.where(inside, back.enter, 0.0)
        last = np.where(inside[:, None], ends[0] - distance[:, None] * ends[1], last)
        onward = np.where(inside[:, None], ends[1], direction)
        rest = np.where(inside, distance, rest)
    length = np.where(good, np.linalg.norm(last - first, axis=1), 0.0)
    normal = until.normal if isinstance(until, Plane) else None
    return Paths(first, last, direction, np.asarray(onward), length, rest, normal, field.ambient_index)


def shortest_cell(field: IndexField, paths: Paths) -> float:
    """Return the least length of a path in a cell of the field [m]."""
    return float(np.min(cell_along(field, paths.ahead[paths.length > 0.0]), initial=np.inf))
