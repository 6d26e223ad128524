"""The next order's change and thinned sums of samples on planar and axisymmetric grids."""

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from .paths import Contrast, Paths, shortest_cell
from .planes import THINNED
from .rays import Rays
from .splines import Surface

# Pieces of a path for each cell of the grid.
PIECES = 1.5
# Least number of nodes that are left along an axis of which every fourth is taken.
LEAST_LEFT = 5


def in_space(field: IndexField, points: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return gradients along the grid's two axes, (m, 2), as vectors in space, (m, 3)."""
    if field.geometry == "planar":
        return np.concatenate([np.zeros((len(points), 1)), slope], axis=1)
    radius = np.hypot(points[:, 0], points[:, 1])
    outward = points[:, :2] / np.where(radius > 0.0, radius, 1.0)[:, None]
    return np.concatenate([outward * slope[:, :1], slope[:, 1:]], axis=1)


def spline_of(field: IndexField, local: np.ndarray, order: int, axis: int = 0, step: int = 1) -> Contrast:
    """Return the spline through a grid's samples, or every `step`-th of them along an axis, near local points (m, 2)."""
    grid: UniformGrid = field.samples
    samples = grid.samples[:: step if axis == 0 else 1, :: step if axis == 1 else 1]
    spacing = grid.spacing * np.where(np.arange(2) == axis, step, 1)
    place = (local - grid.origin) / spacing
    surface = Surface(samples[None], place.min(axis=0), place.max(axis=0), order, grid.even_first_axis)

    def contrast(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        here = np.clip((field.local_coordinates(points) - grid.origin) / spacing, 0.0, np.array(samples.shape) - 1.0)
        value, slope = surface(np.zeros(len(points), np.int64), here)
        return value, in_space(field, points, slope / spacing)

    return contrast


def surface_changes(field: IndexField, paths: Paths, orders: tuple[int, int]) -> tuple[Rays, Rays, dict[int, float]]:
    """Return the change by the next order, the thinned sum's change by two, and the rms changes by two, three and four.

    Args:
        field: A planar or axisymmetric field on a uniform grid.
        paths: The rays' paths.
        orders: The interpolant's order, and the next.
    """
    grid, cell = field.samples, shortest_cell(field, paths) / PIECES
    count = len(paths.length)
    if not (paths.length > 0.0).any():
        return Rays.still(count), Rays.still(count), dict.fromkeys(THINNED, 0.0)
    local = field.local_coordinates(paths.at(np.linspace(0.0, 1.0, 33))[paths.length > 0.0].reshape(-1, 3))
    local = np.clip(
        np.concatenate([local, local.min(axis=0)[None] - grid.spacing, local.max(axis=0)[None] + grid.spacing]),
        grid.low,
        grid.high,
    )
    base, after = (spline_of(field, local, order) for order in orders)

    def change(one: Contrast, other: Contrast, high: np.ndarray) -> Contrast:
        def contrast(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            (value, slope), (before, slope_before) = other(points), one(points)
            there = (field.local_coordinates(points) <= high).all(axis=1)
            return np.where(there, value - before, 0.0), np.where(there[:, None], slope - slope_before, 0.0)

        return contrast

    order = paths.integral(change(base, after, np.full(2, np.inf)), cell)
    axis = _followed(field, paths)
    shape = np.array(grid.shape)
    if (shape[axis] - 1) // max(THINNED) + 1 < LEAST_LEFT:
        return order, Rays.still(count), {}
    last = np.min([(shape[axis] - 1) // thin * thin for thin in THINNED])
    high = np.where(np.arange(2) == axis, grid.origin + last * grid.spacing, np.inf)
    thinned = {
        thin: paths.integral(change(base, spline_of(field, local, orders[0], axis, thin), high), cell)
        for thin in THINNED
    }
    # A step is half a cell off by two, a whole one by three to either side: sizes as those of sums by two.
    return order, thinned[2], {thin: float(np.sqrt(np.mean(one.opd**2))) * 2.0 / thin for thin, one in thinned.items()}


def _followed(field: IndexField, paths: Paths) -> int:
    """Return the grid's axis along which the paths run most of their way."""
    points = paths.at(np.linspace(0.02, 0.98, 25))[paths.length > 0.0]
    local = field.local_coordinates(points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
    return int(np.argmax(np.abs(np.diff(local, axis=1)).sum(axis=(0, 1)) / field.samples.spacing))
