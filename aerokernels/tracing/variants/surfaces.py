"""The next order's change of samples on planar and axisymmetric grids, and thinned sums of rays along r."""

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from .paths import Contrast, Paths, shortest_cell
from .planes import THINNED, step_size
from .rays import Rays
from .splines import Surface, for_next_order, in_space

# Pieces of a path for each cell of the grid.
PIECES = 1.5
# Least number of nodes that are left along an axis of which every fourth is taken.
LEAST_LEFT = 5


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


def order_change(field: IndexField, paths: Paths, orders: tuple[int, int]) -> Rays:
    """Return the change from the interpolant to the next order: `orders` are its own and the next."""
    if not (paths.length > 0.0).any():
        return Rays.still(len(paths.length))
    after = spline_of(for_next_order(field, orders), _about(field, paths), orders[1])
    return paths.integral(
        _change(field, field.evaluate, after, np.full(2, np.inf)), shortest_cell(field, paths) / PIECES
    )


def thinned_along_r(field: IndexField, paths: Paths, order: int) -> tuple[Rays, dict[int, np.ndarray]]:
    """As `planes.thinned_sums`, of rays that mostly run along r, through rows of nodes."""
    grid, count = field.samples, len(paths.length)
    chord = np.abs(paths.last - paths.first)
    along = (np.hypot(chord[:, 0], chord[:, 1]) / grid.spacing[0] > chord[:, 2] / grid.spacing[1]) & (
        paths.length > 0.0
    )
    rows = np.flatnonzero(along)
    if field.geometry != "axisymmetric" or not len(rows) or (grid.shape[0] - 1) // max(THINNED) + 1 < LEAST_LEFT:
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
    sums.opd[rows], sums.direction[rows], sums.position[rows] = (
        thinned[2].opd,
        thinned[2].direction,
        thinned[2].position,
    )
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
