"""The next order's change and thinned sums of a grid's samples, on each ray's crossings with planes of nodes.

Along the axis that a ray follows most, every order of interpolation has nearly the sum over the planes of nodes. The
next order changes the interpolation within the planes, so that a path's integral is a sum over the planes that it
crosses, of a spline along two axes. The sum over every j-th plane less the sum over all, on which `jumps.py` builds, is
made of the same values.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...medium.mesh_samples import MeshSamples
from .paths import Paths
from .rays import Rays
from .splines import Surface, for_next_order, in_space

THINNED = (2, 3, 4)
# Shortest path that is followed [cells]: others are points, but for rounding.
LEAST_WAY = 1e-9
# Order of the polynomials that a thinned sum's ends leave out.
SMOOTH = 4


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where the paths of some rays cross planes of nodes.

    Attributes:
        rows: The rays, shape (n,).
        paths: Their paths.
        axis: The grid's axis across the planes.
        space: The same axis of x, y and z.
        plane: Numbers of the planes, shape (k,).
        share: Where the paths cross them, as shares of their lengths, shape (n, k).
        weight: Length of the path that each crossing stands for [m], shape (n, k); 0 where a path ends before.
        points: The crossings [m], shape (n, k, 3).
        place: Places within the planes [nodes], shape (n, k, 2), 0 along a second axis that the grid has not.
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
    """Yield the crossings of rays with planes of nodes, for each axis those of the rays that follow it most.

    Rays that mostly run along r have none.
    """
    grid = field.samples
    begin, end = (
        (field.local_coordinates(points) - grid.origin) / grid.spacing for points in (paths.first, paths.last)
    )
    way = np.abs(end - begin)
    if field.geometry == "axisymmetric":
        chord = (paths.last - paths.first) / grid.spacing[0]
        way[:, 0] = np.hypot(chord[:, 0], chord[:, 1])
    runs = (paths.length > 0.0) & (way.max(axis=1) > LEAST_WAY)
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
    """Return the contrast of a spline within planes at crossings, (n, k), and how sums change with a shift of the ray.

    The second is a gradient [1/m], shape (n, k, 3): a shift along the axis of the planes moves a crossing in its plane.
    """
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


def order_change(field: IndexField, paths: Paths, orders: tuple[int, int]) -> Rays:
    """Return the change from the interpolant of a volume to the next order: `orders` are its own and the next."""
    change, finer = Rays.still(len(paths.length)), for_next_order(field, orders)
    for found in crossings(field, paths):
        value, slope = _own_values(field, found)
        after, slope_after = values_at(finer, found, orders[1])
        _put(change, found, after - value, slope_after - slope, found.weight)
    return change


def thinned_sums(field: IndexField, paths: Paths, order: int) -> tuple[Rays, dict[int, np.ndarray]]:
    """Return the change of sums over every second plane, and the sizes of those over every second, third and fourth.

    A size is the rms change of a ray's sums over every j-th plane, over that of a step at a random place, shape (n,).
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
        _put(sums, found, value, slope, weight * _taper(found, 2) * pattern)
    return sums, {thin: np.sqrt(total) / step_size(thin) for thin, total in square.items()}


def step_size(thin: int) -> float:
    """Return the rms change of a sum over every `thin`-th plane by a step of 1 at a random place [cells]."""
    return float(np.sqrt((thin**2 - 1.0) / 12.0))


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
        taper[:, shift:] += share * box[:, : max(box.shape[1] - shift, 0)]
    return taper
