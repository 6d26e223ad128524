"""The next order's change and thinned sums of a volume's samples, on each ray's crossings with planes of nodes.

Along the axis that a ray follows most, each order of interpolation has nearly the sum over the planes of nodes. What the
next order changes is the interpolation within the planes, so that a path's integral is a sum over the planes that it
crosses, of a spline along two axes. The sum over every j-th plane less the sum over all, on which `jumps.py` builds, is
made of the same values.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...medium import IndexField
from .paths import Paths
from .rays import Rays
from .splines import Surface

THINNED = (2, 3, 4)
# Order of the polynomials that a thinned sum's ends leave out.
SMOOTH = 4


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where the paths of some rays cross planes of nodes.

    Attributes:
        rows: The rays, shape (n,).
        paths: Their paths.
        axis: The axis across the planes.
        plane: Numbers of the planes, shape (k,).
        share: Where the paths cross them, as shares of their lengths, shape (n, k).
        weight: Length of the path that each crossing stands for [m], shape (n, k); 0 where a path ends before.
        place: Places within the planes [nodes], shape (n, k, 2).
    """

    rows: np.ndarray
    paths: Paths
    axis: int
    plane: np.ndarray
    share: np.ndarray
    weight: np.ndarray
    place: np.ndarray

    @property
    def others(self) -> list[int]:
        """The axes in the planes."""
        return [axis for axis in range(3) if axis != self.axis]

    def in_space(self, slope: np.ndarray, spacing: np.ndarray) -> np.ndarray:
        """Return how sums over planes change as their rays are shifted across themselves [1/m], shape (n, k, 3).

        `slope` are slopes per node in the planes, shape (n, k, 2). A shift along the axis of the planes moves the
        crossing within its plane.
        """
        found = np.zeros((*slope.shape[:2], 3))
        found[..., self.others] = slope / spacing[self.others]
        chord = self.paths.last - self.paths.first
        along = np.einsum("nki,ni->nk", found, chord / chord[:, self.axis, None])
        found[..., self.axis] = -along
        return found


def crossings(field: IndexField, paths: Paths) -> Iterator[Crossings]:
    """Yield the crossings of rays with planes of nodes, for each axis those of the rays that follow it most."""
    grid = field.samples
    begin, end = ((points - grid.origin) / grid.spacing for points in (paths.first, paths.last))
    follows = np.where(paths.length > 0.0, np.argmax(np.abs(end - begin), axis=1), -1)
    for axis in range(3):
        rows = np.flatnonzero(follows == axis)
        if not len(rows):
            continue
        one, a, b = paths.rows(rows), begin[rows, axis], end[rows, axis]
        low, high = np.minimum(a, b)[:, None], np.maximum(a, b)[:, None]
        plane = np.arange(max(int(np.floor(low.min())), 0), min(int(np.ceil(high.max())), grid.shape[axis] - 1) + 1)
        share = np.clip((plane - a[:, None]) / (b - a)[:, None], 0.0, 1.0)
        cells = np.clip(np.minimum(plane + 0.5, high) - np.maximum(plane - 0.5, low), 0.0, None)
        weight = cells * (one.length[:, None] / (high - low))
        others = [k for k in range(3) if k != axis]
        place = ((one.at(share) - grid.origin) / grid.spacing)[..., others]
        place = np.clip(place, 0.0, np.array(grid.shape)[others] - 1.0)
        yield Crossings(rows, one, axis, plane, share, weight, place)


def values_at(field: IndexField, found: Crossings, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the contrast of a spline within planes, (n, k), and its slopes per node, (n, k, 2), at crossings."""
    samples = np.moveaxis(field.samples.samples, found.axis, 0)[found.plane[0] : found.plane[-1] + 1]
    low, high = found.place.min(axis=(0, 1)), found.place.max(axis=(0, 1))
    surface = Surface(samples, low, high, order, even=False)
    plane = np.broadcast_to(found.plane - found.plane[0], found.share.shape)
    value, slope = surface(plane.reshape(-1), found.place.reshape(-1, 2))
    return value.reshape(plane.shape), slope.reshape(*plane.shape, 2)


def volume_changes(field: IndexField, paths: Paths, orders: tuple[int, int]) -> tuple[Rays, Rays, dict[int, float]]:
    """Return the change by the next order, the thinned sum's change by two, and the rms changes by two, three and four.

    Args:
        field: A volume on a uniform grid.
        paths: The rays' paths.
        orders: The interpolant's order, and the next.
    """
    order, sums = Rays.still(len(paths.length)), Rays.still(len(paths.length))
    square = dict.fromkeys(THINNED, 0.0)
    for found in crossings(field, paths):
        value, slope = values_at(field, found, orders[0])
        next_value, next_slope = values_at(field, found, orders[1])
        spacing = field.samples.spacing
        _put(order, found, next_value - value, found.in_space(next_slope - slope, spacing), found.weight)
        weight = found.weight.max(axis=1, keepdims=True)
        for thin in THINNED:
            taper = _taper(found, thin)
            for first in range(thin):
                pattern = np.where(found.plane % thin == first, thin - 1.0, -1.0)
                square[thin] += float(np.sum(np.sum(weight * taper * pattern * value, axis=1) ** 2)) / thin
        pattern = np.where(found.plane % 2 == 0, 1.0, -1.0)
        _put(sums, found, value, found.in_space(slope, spacing), weight * _taper(found, 2) * pattern)
    count = max(np.count_nonzero(paths.length > 0.0), 1)
    return order, sums, {thin: float(np.sqrt(total / count)) for thin, total in square.items()}


def _put(whole: Rays, found: Crossings, value: np.ndarray, slope: np.ndarray, weight: np.ndarray) -> None:
    part = found.paths.carried(value, slope, found.share, weight)
    whole.opd[found.rows], whole.direction[found.rows], whole.position[found.rows] = (
        part.opd,
        part.direction,
        part.position,
    )


def _taper(found: Crossings, thin: int) -> np.ndarray:
    """Return weights of planes that begin and end smoothly where a path does, shape (n, k).

    They are those of a box, `SMOOTH` times averaged over `thin` planes: every `thin`-th of them and all of them have
    the same sum times any polynomial of an order below SMOOTH.
    """
    kernel = np.ones(1)
    for _ in range(SMOOTH):
        kernel = np.convolve(kernel, np.full(thin, 1.0 / thin))
    there = found.weight > 0.49 * found.weight.max(axis=1, keepdims=True)
    left = np.cumsum(there[:, ::-1], axis=1)[:, ::-1]
    box = (there & (left >= len(kernel))).astype(np.float64)
    taper = np.zeros(box.shape)
    for shift, share in enumerate(kernel):
        taper[:, shift:] += share * box[:, : box.shape[1] - shift]
    return taper
