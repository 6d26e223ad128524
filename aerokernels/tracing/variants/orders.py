"""The next order's change and thinned sums of a grid's samples, on each ray's crossings with planes of nodes.

Along the axis that a ray follows most, every order has nearly the sum over the planes of nodes: the next order changes
splines within the planes. Thinned sums (jumps.py) are of the same values. Splines of order 1, 3, 5 have not-a-knot
ends; a node's coefficient falls by 0.27 or 0.43 a node, so that only samples about the points are needed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import comb

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...medium.mesh_samples import MeshSamples
from .paths import Contrast, Paths, Rays, shortest_cell

THINNED = (2, 3, 4)


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where k planes of nodes across an `axis` of the grid (`space` of x, y, z) are crossed by the paths of n rays.

    `share` of the lengths, and `weight`, the length that each stands for [m] (0 where a path ends before), have shape
    (n, k), `points` [m] (n, k, 3), and `place` within the planes [nodes] (n, k, 2).
    """

    rows: np.ndarray
    paths: Paths
    axis: int
    space: int
    plane: np.ndarray
    share: np.ndarray
    weight: np.ndarray
    points: np.ndarray
    place: np.ndarray


def crossings(field: IndexField, paths: Paths) -> Iterator[Crossings]:
    """Yield crossings of rays with planes of nodes, for each axis those of rays that follow it most; none along r."""
    grid = field.samples
    begin, end = (
        (field.local_coordinates(points) - grid.origin) / grid.spacing for points in (paths.first, paths.last)
    )
    way = np.abs(end - begin)
    if field.geometry == "axisymmetric":
        chord = (paths.last - paths.first) / grid.spacing[0]
        way[:, 0] = np.hypot(chord[:, 0], chord[:, 1])
    # Shortest path that is followed [cells]: others are points, but for rounding.
    runs = (paths.length > 0.0) & (way.max(axis=1) > 1e-9)
    follows = np.where(runs, np.argmax(way, axis=1), -1)
    for axis in range(1 if field.geometry == "axisymmetric" else 0, grid.samples.ndim):
        rows = np.flatnonzero(follows == axis)
        if not len(rows):
            continue
        one, a, b = paths.rows(rows), begin[rows, axis], end[rows, axis]
        low, high = np.minimum(a, b)[:, None], np.maximum(a, b)[:, None]
        plane = np.arange(max(int(np.floor(low.min())), 0), min(int(np.ceil(high.max())), grid.shape[axis] - 1) + 1)
        share = np.clip((plane - a[:, None]) / (b - a)[:, None], 0.0, 1.0)
        cells = np.clip(np.minimum(plane + 0.5, high) - np.maximum(plane - 0.5, low), 0.0, None)
        weight = cells * (one.length[:, None] / (high - low))
        points = one.at(share)
        local = (field.local_coordinates(points.reshape(-1, 3)) - grid.origin) / grid.spacing
        others = _others(grid, axis)
        place = np.zeros((*share.shape, 2))
        place[..., : len(others)] = np.clip(local[:, others], 0.0, np.array(grid.shape)[others] - 1.0).reshape(
            *share.shape, -1
        )
        yield Crossings(rows, one, axis, axis + 3 - grid.samples.ndim, plane, share, weight, points, place)


def _others(grid: UniformGrid | MeshSamples, axis: int) -> list[int]:
    return [k for k in range(len(grid.low)) if k != axis]


def values_at(field: IndexField, found: Crossings, order: int) -> tuple[np.ndarray, np.ndarray]:
    """The contrast of a spline within planes at crossings, (n, k), and its change with a shift of the ray."""
    grid = field.samples
    samples = np.moveaxis(grid.samples, found.axis, 0)[found.plane[0] : found.plane[-1] + 1]
    if samples.ndim == 2:
        samples = samples[..., None]
    low, high = found.place.min(axis=(0, 1)), found.place.max(axis=(0, 1))
    surface = Surface(samples, low, high, order, grid.even_first_axis and found.axis > 0)
    plane = np.broadcast_to(found.plane - found.plane[0], found.share.shape)
    value, slope = surface(plane.reshape(-1), found.place.reshape(-1, 2))
    along = np.zeros((len(value), grid.samples.ndim))
    for k, axis in enumerate(_others(grid, found.axis)):
        along[:, axis] = slope[:, k] / grid.spacing[axis]
    return _in_planes(found, value, in_space(field, found.points.reshape(-1, 3), along))


def _own_values(field: IndexField, found: Crossings) -> tuple[np.ndarray, np.ndarray]:
    """As `values_at`, by the field's own interpolant."""
    grid = field.samples
    others = _others(grid, found.axis)
    nodes = np.empty((*found.share.shape, grid.samples.ndim))
    nodes[..., found.axis], nodes[..., others] = found.plane, found.place[..., : len(others)]
    value, slope = grid.evaluate((grid.origin + nodes * grid.spacing).reshape(-1, grid.samples.ndim))
    return _in_planes(found, value, in_space(field, found.points.reshape(-1, 3), slope))


def _in_planes(found: Crossings, value: np.ndarray, gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values at crossings and gradients whose part across the planes is by the crossings' shift in them."""
    gradient = gradient.reshape(*found.share.shape, 3)
    chord = found.paths.last - found.paths.first
    gradient[..., found.space] = 0.0
    gradient[..., found.space] = -np.einsum("nki,ni->nk", gradient, chord / chord[:, found.space, None])
    return value.reshape(found.share.shape), gradient


def change_in_planes(field: IndexField, paths: Paths, orders: tuple[int, int]) -> Rays:
    """Return the change from the interpolant of a volume to the next order: `orders` are its own and the next."""
    change, finer = Rays.still(len(paths.length)), for_next_order(field, orders)
    for found in crossings(field, paths):
        value, slope = _own_values(field, found)
        after, slope_after = values_at(finer, found, orders[1])
        change.put(found.rows, found.paths.carried(after - value, slope_after - slope, found.share, found.weight))
    return change


def thinned_sums(field: IndexField, paths: Paths, order: int) -> tuple[Rays, dict[int, np.ndarray]]:
    """The change of sums over every second plane, and sizes of those by 2, 3 and 4: rms over that of a step, (n,).

    Pairs of averages of cells have the sum of their mean: thinned by two, they change by half of what their slopes
    within the planes change from one to the next, times the ray's way along the planes.
    """
    sums, square = Rays.still(len(paths.length)), {thin: np.zeros(len(paths.length)) for thin in THINNED}
    for found in crossings(field, paths):
        value, slope = values_at(field, found, order)
        if field.samples.keeps_averages:
            along = slope[..., found.space]
            value = 0.5 * float(field.samples.spacing[found.axis]) * along
            slope = np.zeros(slope.shape)
        weight = found.weight.max(axis=1, keepdims=True)
        for thin in THINNED:
            taper = weight * _taper(found, thin)
            for first in range(thin):
                pattern = np.where(found.plane % thin == first, thin - 1.0, -1.0)
                square[thin][found.rows] += np.sum(taper * pattern * value, axis=1) ** 2 / thin
        pattern = np.where(found.plane % 2 == 0, 1.0, -1.0)
        sums.put(found.rows, found.paths.carried(value, slope, found.share, weight * _taper(found, 2) * pattern))
    return sums, {thin: np.sqrt(total) / step_size(thin) for thin, total in square.items()}


def step_size(thin: int) -> float:
    """Return the rms change of a sum over every `thin`-th plane by a step of 1 at a random place [cells]."""
    return float(np.sqrt((thin**2 - 1.0) / 12.0))


def _taper(found: Crossings, thin: int) -> np.ndarray:
    """Return weights of planes that begin and end smoothly where a path does, shape (n, k)."""
    kernel = np.ones(1)
    # Order of the polynomials that a thinned sum's ends leave out.
    for _ in range(4):
        kernel = np.convolve(kernel, np.full(thin, 1.0 / thin))
    there = found.weight > 0.49 * found.weight.max(axis=1, keepdims=True)
    left = np.cumsum(there[:, ::-1], axis=1)[:, ::-1]
    box = (there & (left >= len(kernel))).astype(np.float64)
    taper = np.zeros(box.shape)
    for shift, share in enumerate(kernel):
        taper[:, shift:] += share * box[:, : max(box.shape[1] - shift, 0)]
    return taper


# Nodes beyond the points whose samples matter, and nodes that are solved for together.
MARGIN, BLOCK = 16, 256
# Least number of nodes for the fifth order.
LEAST_NODES = 8


def tap_weights(order: int, u: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the weights of order + 1 B-splines at places u in a cell, and their slopes per cell."""
    weights, before = [np.ones_like(u)], list[np.ndarray]()
    for p in range(1, order + 1):
        before, none = weights, np.zeros_like(u)
        low, high = [none, *weights], [*weights, none]
        weights = [((u + p - j) * low[j] + (j + 1 - u) * high[j]) / p for j in range(p + 1)]
    none = np.zeros_like(u)
    if order == 0:
        return weights, [none]
    return weights, [low - high for low, high in zip([none, *before], [*before, none], strict=True)]


def _solved(count: int, order: int) -> np.ndarray:
    """The matrix from samples at `count` nodes to count + order - 1 coefficients."""
    extra = order // 2
    matrix = np.zeros((count + 2 * extra, count + 2 * extra))
    at_node = [float(one) for one in tap_weights(order, np.zeros(()))[0]]
    for node in range(count):
        matrix[node, node : node + order + 1] = at_node[: count + 2 * extra - node]
    change = [(-1.0) ** k * comb(order + 1, k) for k in range(order + 2)]
    for end in range(extra):
        matrix[count + 2 * end, end : end + order + 2] = change
        matrix[count + 2 * end + 1, len(matrix) - end - order - 2 : len(matrix) - end] = change
    solved = np.linalg.inv(matrix)[:, :count]
    return solved


def order_for(order: int, count: int) -> int:
    """Return the order that so many nodes allow."""
    return order if count >= LEAST_NODES else min(order, 3) if count >= 4 else min(count - 1, 1)


def coefficients(samples: np.ndarray, order: int, axis: int) -> np.ndarray:
    """Return the spline's coefficients along an axis, of which there are order_for(order, n) - 1 more than samples."""
    order = order_for(order, samples.shape[axis])
    return samples if order < 2 else _along(samples, axis, lambda count: _solved(count, order))


def for_next_order(field: IndexField, orders: tuple[int, int]) -> IndexField:
    """Return the field through whose nodes the next order goes: where averages of cells are kept, it keeps them too."""
    grid = field.samples
    if not (isinstance(grid, UniformGrid) and grid.keeps_averages):
        return field
    found = np.asarray(grid.samples, np.float64)
    for axis in range(found.ndim):
        mirrored = min(MARGIN, found.shape[0] - 1) if grid.even_first_axis and axis == 0 else 0
        if mirrored:
            found = np.concatenate([found[mirrored:0:-1], found])
        before, after = (order_for(order, found.shape[axis]) for order in orders)
        found = _along(found, axis, partial(_exchanged, before=before, after=after))[mirrored:]
    return replace(field, samples=replace(grid, samples=found))


def _exchanged(count: int, before: int, after: int) -> np.ndarray:
    """The matrix from a spline's values at `count` nodes to those of the spline of another order with its averages."""

    def rows(order: int, places: Sequence[tuple[float, float]]) -> np.ndarray:
        found, node = np.zeros((count, count + 2 * (order // 2))), np.arange(count)
        for place, share in places:
            cell = np.clip(np.floor(node + place).astype(np.int64), 0, count - 2)
            for k, weight in enumerate(tap_weights(order, node + place - cell)[0]):
                found[node, cell + k] += share * weight
        return found

    gauss, share = np.polynomial.legendre.leggauss(3)
    cell = [(0.25 * (one + side), 0.25 * part) for one, part in zip(gauss, share, strict=True) for side in (-1.0, 1.0)]
    averages = [rows(order, cell) @ _solved(count, order) for order in (before, after)]
    return np.asarray(np.linalg.solve(averages[1], averages[0]))


def _along(samples: np.ndarray, axis: int, matrix: Callable[[int], np.ndarray]) -> np.ndarray:
    """Multiply by the matrix for a number of nodes along an axis, by BLOCK nodes at a time where there are more."""
    moved = np.moveaxis(samples, axis, 0)
    count, flat = len(moved), moved.reshape(len(moved), -1)
    whole = matrix(min(count, BLOCK))
    more = len(whole) - whole.shape[1]
    if count <= BLOCK:
        found = whole @ flat
    else:
        found = np.empty((count + more, flat.shape[1]))
        starts = [*range(0, count - BLOCK, BLOCK - 4 * MARGIN), count - BLOCK]
        for start in starts:
            low = 0 if start == 0 else 2 * MARGIN
            high = BLOCK + more if start == count - BLOCK else BLOCK - 2 * MARGIN + more
            found[start + low : start + high] = whole[low:high] @ flat[start : start + BLOCK]
    return np.moveaxis(found.reshape(-1, *moved.shape[1:]), 0, axis)


class Surface:
    """Splines along two axes on each of some planes of samples, near the points of use, mirrored at an even axis."""

    def __init__(self, samples: np.ndarray, low: np.ndarray, high: np.ndarray, order: int, even: bool):
        """Prepare splines of order 1, 3 or 5 through samples (planes, m, n) for places between two corners [nodes]."""
        self.order, self.first = [], []
        for axis in (0, 1):
            count = samples.shape[axis + 1]
            begin, end = int(np.floor(low[axis])) - MARGIN, int(np.ceil(high[axis])) + MARGIN + 1
            begin = max(begin, 1 - count) if even and axis == 0 else max(begin, 0)
            end = min(end, count)
            if end - begin < LEAST_NODES:
                begin, end = max(end - LEAST_NODES, 0), min(max(end, begin + LEAST_NODES), count)
            samples = np.take(samples, np.abs(np.arange(begin, end)), axis=axis + 1)
            self.first.append(begin)
            self.order.append(order_for(order, end - begin))
        table = np.asarray(samples, np.float64)
        for axis in (0, 1):
            table = coefficients(table, order, axis + 1)
        self.table = np.ascontiguousarray(table)
        self.cells = [samples.shape[axis + 1] - 1 for axis in (0, 1)]

    def __call__(self, plane: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return values (m,) and slopes per node (m, 2) at points: their planes (m,), places along both axes (m, 2)."""
        _, rows, columns = self.table.shape
        start = plane * (rows * columns)
        weights, slopes = [], []
        for axis, pitch in ((0, columns), (1, 1)):
            u = place[:, axis] - self.first[axis]
            cell = np.clip(np.floor(u).astype(np.int64), 0, max(self.cells[axis] - 1, 0))
            weight, slope = tap_weights(self.order[axis], u - cell)
            weights.append(weight)
            slopes.append(slope)
            start = start + cell * pitch
        flat = self.table.reshape(-1)
        value, along, across = np.zeros((3, len(place)))
        for i in range(len(weights[0])):
            inner, inner_slope = np.zeros((2, len(place)))
            for j in range(len(weights[1])):
                picked = flat.take(start + (i * columns + j))
                inner += weights[1][j] * picked
                inner_slope += slopes[1][j] * picked
            value += weights[0][i] * inner
            along += slopes[0][i] * inner
            across += weights[0][i] * inner_slope
        return value, np.stack([along, across], axis=1)


def in_space(field: IndexField, points: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return gradients along a grid's own axes, (m, d), as vectors in space at points, both (m, 3)."""
    if field.geometry == "volume":
        return slope
    if field.geometry == "planar":
        return np.concatenate([np.zeros((len(points), 1)), slope], axis=1)
    radius = np.hypot(points[:, 0], points[:, 1])
    outward = points[:, :2] / np.where(radius > 0.0, radius, 1.0)[:, None]
    return np.concatenate([outward * slope[:, :1], slope[:, 1:]], axis=1)


# Pieces of a path for each cell of the grid.
PIECES = 1.5


def spline_of(field: IndexField, local: np.ndarray, order: int, axis: int = 0, step: int = 1) -> Contrast:
    """Return the spline through a grid's samples, or every `step`-th along an axis, near local points (m, 2)."""
    grid = field.samples
    assert isinstance(grid, UniformGrid)
    samples = grid.samples[:: step if axis == 0 else 1, :: step if axis == 1 else 1]
    spacing = grid.spacing * np.where(np.arange(2) == axis, step, 1)
    place = (local - grid.origin) / spacing
    surface = Surface(samples[None], place.min(axis=0), place.max(axis=0), order, grid.even_first_axis)

    def contrast(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        here = np.clip((field.local_coordinates(points) - grid.origin) / spacing, 0.0, np.array(samples.shape) - 1.0)
        value, slope = surface(np.zeros(len(points), np.int64), here)
        return value, in_space(field, points, slope / spacing)

    return contrast


def change_on_two_axes(field: IndexField, paths: Paths, orders: tuple[int, int]) -> Rays:
    """Return the change from the interpolant to the next order: `orders` are its own and the next."""
    if not (paths.length > 0.0).any():
        return Rays.still(len(paths.length))
    after = spline_of(for_next_order(field, orders), _about(field, paths), orders[1])
    return paths.integral(
        _change(field, field.evaluate, after, np.full(2, np.inf)), shortest_cell(field, paths) / PIECES
    )


def thinned_along_r(field: IndexField, paths: Paths, order: int) -> tuple[Rays, dict[int, np.ndarray]]:
    """As `thinned_sums`, of rays that mostly run along r, through rows of nodes."""
    grid, count = field.samples, len(paths.length)
    chord = np.abs(paths.last - paths.first)
    along = (np.hypot(chord[:, 0], chord[:, 1]) / grid.spacing[0] > chord[:, 2] / grid.spacing[1]) & (
        paths.length > 0.0
    )
    rows = np.flatnonzero(along)
    # Least number of nodes that are left along an axis of which every fourth is taken.
    if field.geometry != "axisymmetric" or not len(rows) or (grid.shape[0] - 1) // max(THINNED) + 1 < 5:
        return Rays.still(count), {thin: np.zeros(count) for thin in THINNED}
    some = paths.rows(rows)
    local, cell = _about(field, some), shortest_cell(field, some) / PIECES
    base = spline_of(field, local, order)
    last = np.min([(grid.shape[0] - 1) // thin * thin for thin in THINNED])
    high = np.array([last * grid.spacing[0], np.inf])
    thinned = {
        thin: some.integral(_change(field, base, spline_of(field, local, order, 0, thin), high), cell)
        for thin in THINNED
    }
    sums = Rays.still(count)
    sums.put(rows, thinned[2])
    size = {thin: np.zeros(count) for thin in THINNED}
    for thin, one in thinned.items():
        size[thin][rows] = np.abs(one.opd) / step_size(thin)
    return sums, size


def _change(field: IndexField, one: Contrast, other: Contrast, high: np.ndarray) -> Contrast:
    """Return the change from one contrast to another, below some local coordinates [m]."""

    def contrast(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (value, slope), (before, slope_before) = other(points), one(points)
        there = np.all(field.local_coordinates(points) <= high, axis=1)
        return np.where(there, value - before, 0.0), np.where(there[:, None], slope - slope_before, 0.0)

    return contrast


def _about(field: IndexField, paths: Paths) -> np.ndarray:
    """Return local coordinates [m] whose extremes have all paths between them, shape (m, 2)."""
    grid = field.samples
    local = field.local_coordinates(paths.at(np.linspace(0.0, 1.0, 33))[paths.length > 0.0].reshape(-1, 3))
    ends = np.stack([local.min(axis=0) - grid.spacing, local.max(axis=0) + grid.spacing])
    return np.asarray(np.clip(ends, grid.low, grid.high))
