r"""Estimate the disturbance beyond a point at which the known air ends, from the air just inside it.

A quantity q along a ray, at a depth x below the end of the known air, is assumed to continue beyond that end so that
its integral there is

    A0 = max q over 0 <= x <= s,   A1 = max q over s <= x <= 2 s
    max(a A0, q(0)) min(s / ln(A1 / A0), D, w)  the first of the three only where A1 > A0, where the disturbance decays

a is 1, or less at a face at which all the air fades out (face_shares.py). s is two cells, by their extent along the
ray; D is the box's own extent along the line, since air that does not decay is assumed to continue for the same length
again; w is the length of the path outside. With a = 1, an exponential tail has A0 s / ln(A1 / A0) left from the depth s
on, and a steeper one less.

For q = |m|, the contrast, that integral is an optical path. For q = |grad m . e| it is the angle by which the missing
air would have turned the ray, times the obliquity e of the ray's stop (lever_arms.py): the optical path changes by that
times the distance from the middle of that air to the stop.
"""

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ..lever_arms import obliquity
from ..lines import box_size, box_span, cell_along
from .mesh_rim import rim_contrast

WINDOW_CELLS = 2.0
# An obliquity below this is rounding.
NO_OBLIQUITY = 1e-12
DEPTHS = np.array([0.0, 0.5, 1.0, 1.5, 2.0])  # over s; the middle one belongs to both windows


def lost_beyond(
    field: IndexField, point, inward, chord, path, until, distance, leaves, cell=None, contrast=None, share=1.0
) -> np.ndarray:
    """Optical path beyond some points, and its change at an oblique stop by the deflection there [m], shape (n,).

    Args:
        field: The refractive index.
        point: Points of the boundary [m], shape (n, 3).
        inward: Unit vectors along the rays into the known air, shape (n, 3).
        chord: Length of the known air in that direction [m], shape (n,).
        path: Length of the path beyond, in the direction -inward [m], shape (n,).
        until: The stop.
        distance: From the points to the stop [m], shape (n,); rays for which that is not finite never meet it.
        leaves: Whether rays leave the known air there, or enter it; one for all, or of shape (n,).
        cell: Size of the cells there [m], shape (n,); None for the field's own.
        contrast: |contrast| at the points, shape (n,), where it is already known.
        share: a of the points, shape (n,) or one for all.
    """
    across = obliquity(inward, until)
    is_oblique = (np.abs(across).max(axis=1, initial=0.0) > NO_OBLIQUITY) & np.isfinite(distance)
    share, leaves = np.broadcast_to(share, len(point)), np.broadcast_to(leaves, len(point))
    lost = np.zeros(len(point))
    for rows in (np.flatnonzero(~is_oblique), np.flatnonzero(is_oblique)):
        if not len(rows):
            continue
        own = (None if each is None else each[rows] for each in (cell, contrast, share))
        turns = across[rows] if is_oblique[rows[0]] else None
        found = tails(field, point[rows], inward[rows], chord[rows], turns, *own)
        lengths = [_length(field, tail.scale, inward[rows], path[rows]) for tail in found]
        lost[rows] = found[0].strength * lengths[0]
        if turns is not None:
            middle = np.where(leaves[rows], -0.5, 0.5) * lengths[1]
            lost[rows] += found[1].strength * lengths[1] * np.maximum(distance[rows] + middle, 0.0)
    return lost


class Tail(NamedTuple):
    """max(a A0, q(0)) of a quantity q, and its decay length s / ln(A1 / A0) [m], infinite where there is no decay."""

    strength: np.ndarray
    scale: np.ndarray


def tails(
    field: IndexField, point, inward, chord, across=None, cell=None, contrast=None, share: Any = 1.0
) -> list[Tail]:
    """The tail of |contrast|, and with `across`, vectors (n, 3), that of |grad m . across| as well.

    The other arguments are those of `lost_beyond`.
    """
    field, cell = _original(field, cell, inward)
    places, step = _places(point, inward, chord, cell)
    flat, shape = places.reshape(-1, 3), places.shape[:2]
    along = None if across is None else np.tile(across, (len(DEPTHS), 1))
    if field.is_uniform:
        found = [contrast_in(field, flat)] if along is None else _contrast_and_slope(field, flat, along)
    elif along is None:
        found = [field.contrast_at(flat)]
    else:
        value, gradient = field.evaluate(flat)
        found = [value, np.sum(gradient * along, axis=1)]
    found = [np.abs(each).reshape(shape) for each in found]
    if not field.is_uniform:
        # A point on the rim may be outside the mesh by rounding.
        none = np.flatnonzero(~(found[0][0] > 0.0))
        if len(none):
            found[0][0, none] = rim_contrast(field, point[none]) if contrast is None else contrast[none]
    return [_falls_off(field, each, point, step, share) for each in found]


def _original(field: IndexField, cell, inward: np.ndarray) -> tuple[IndexField, np.ndarray]:
    """The field from which this one was resampled, if it is kept, and the smaller of their cells along rays [m]."""
    if cell is None:
        cell = _cell(field, inward)
    while field.source is not None and field.source is not field:
        cell = np.minimum(_cell(field, inward), _cell(field.source, inward))
        field = field.source
    return field, cell


def _cell(field: IndexField, inward: np.ndarray) -> np.ndarray:
    """Length of rays within a cell [m], shape (n,); at most the cell's longest side."""
    return np.minimum(cell_along(field, inward), float(np.max(field.spacing)))


def _places(point, inward, chord, cell) -> tuple[np.ndarray, np.ndarray]:
    """Points below the boundary [m], shape (5, n, 3), and s [m], shape (n,)."""
    step = WINDOW_CELLS * cell
    depth = np.minimum(step * DEPTHS[:, None], chord)
    return point + depth[..., None] * inward, step


def _falls_off(field: IndexField, found: np.ndarray, point, step, share) -> Tail:
    """The tail of a quantity q sampled at the depths, shape (5, n)."""
    if field.body is not None and len(point):
        found[:, field.body.contains(field.local_coordinates(point))] = 0.0
    middle = len(DEPTHS) // 2
    last, before = found[: middle + 1].max(axis=0), found[middle:].max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where((before > last) & (last > 0.0), step / np.log(before / last), np.inf)
    return Tail(np.maximum(share * last, found[0]), scale)


def _length(field: IndexField, scale, inward, path) -> np.ndarray:
    """Effective length of the air beyond [m]: min(s / ln(A1 / A0), D, w)."""
    return np.minimum(np.minimum(scale, extent(field, inward)), np.maximum(path, 0.0))


def contrast_in(field: IndexField, points: np.ndarray) -> np.ndarray:
    """Contrast at points (n, 3) of a uniform grid, linear between its samples; beyond a face, its value at the face."""
    assert isinstance(field.samples, UniformGrid)
    return Corners(field.samples, field.local_coordinates(points)).value()


def _contrast_and_slope(field: IndexField, points: np.ndarray, along: np.ndarray) -> list[np.ndarray]:
    """The contrast, and grad m . along, at points of a uniform grid, both (n, 3), as by `Corners`."""
    assert isinstance(field.samples, UniformGrid)
    local = field.local_coordinates(points)
    if field.geometry == "axisymmetric":
        radius = np.where(local[:, 0] > 0.0, local[:, 0], 1.0)
        along = np.stack([np.sum(points[:, :2] * along[:, :2], axis=1) / radius, along[:, 2]], axis=1)
    else:
        along = along[:, 1:] if field.geometry == "planar" else along
    corners = Corners(field.samples, local)
    slopes = [corners.slope(axis) * way for axis, way in enumerate(along.T)]
    return [corners.value(), np.sum(slopes, axis=0)]


class Corners:
    """Samples at the corners of the cells of points along a grid's axes, which are read once for value and slopes."""

    def __init__(self, grid: UniformGrid, local: np.ndarray):
        """Find the cells; points beyond a face are moved to it."""
        self.grid, self.cells, self.shares = grid, [], []
        self.strides = np.array(grid.samples.strides) // grid.samples.itemsize
        self.flat = grid.samples.ravel(order="K")  # in memory order, like the strides
        self.start = np.zeros(len(local), dtype=np.int64)
        for axis, (column, count) in enumerate(zip(local.T, grid.shape, strict=True)):
            place = np.clip((column - grid.origin[axis]) / grid.spacing[axis], 0.0, count - 1.0)
            cell = np.minimum(place.astype(np.int64), count - 2)
            self.start += self.strides[axis] * cell
            self.cells.append(cell)
            self.shares.append(place - cell)
        self.corners = {c: self._sample(self.start, c) for c in product((0, 1), repeat=len(self.shares))}

    def value(self) -> np.ndarray:
        """Samples linear between nodes."""
        return self._across(None, list(self.corners.values()))

    def slope(self, axis: int) -> np.ndarray:
        """Difference along an axis over one cell about the points, within the box, over the cell [1/m].

        That is a mean of the differences in the point's own cell and in the one nearest to it.
        """
        cell, share, last = self.cells[axis], self.shares[axis], self.grid.shape[axis] - 2
        low, high = (self._across(axis, [self.corners[c] for c in self.corners if c[axis] == k]) for k in (0, 1))
        own = high - low
        is_low = share < 0.5
        beside = cell + np.where(is_low, -1, 2)  # the node next to the cell
        start = self.start + self.strides[axis] * (np.clip(beside, 0, last + 1) - cell)
        node = self._across(axis, [self._sample(start, c) for c in self.corners if c[axis] == 0])
        near = np.where(is_low, low - node, node - high)
        near = np.where((beside < 0) | (beside > last + 1), own, near)
        return np.asarray(_between(own, near, np.abs(share - 0.5)) / self.grid.spacing[axis])

    def _across(self, axis: int | None, values: list[np.ndarray]) -> np.ndarray:
        """Values at the corners of a cell's face across an axis, or of the cell, linear between them."""
        for share in reversed([share for other, share in enumerate(self.shares) if other != axis]):
            values = [_between(low, high, share) for low, high in zip(values[::2], values[1::2], strict=True)]
        return values[0]  # the last axis varied first

    def _sample(self, start: np.ndarray, corner: tuple[int, ...]) -> np.ndarray:
        return np.asarray(self.flat[start + int(self.strides @ corner)], np.float64)


def _between(low: np.ndarray, high: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return low + share (high - low), in one new array."""
    found: np.ndarray = high - low
    found *= share
    found += low
    return found


def extent(field: IndexField, direction: np.ndarray) -> np.ndarray:
    """Length of the box along lines through its middle [m], at most its diagonal; directions (n, 3)."""
    low, high = field.box
    middle = np.zeros(3)
    ends = np.isfinite(high - low)
    middle[ends] = 0.5 * (low[ends] + high[ends])
    leave = box_span(field, np.broadcast_to(middle, direction.shape), direction).leave
    return np.minimum(2.0 * leave, box_size(field))
