"""Evaluate a uniform grid's contrast, without gradient, at a tensor product of coordinates or at points."""

import numpy as np

from aerokernels.medium import spline
from aerokernels.medium.grid import UniformGrid


def contrast_on_axes(grid: UniformGrid, axes: list[np.ndarray]) -> np.ndarray:
    """Return the contrast at every combination of coordinates along the grid's axes [m]; zero outside its box.

    One sparse matrix product for each axis takes a small fraction of the time of `UniformGrid.evaluate`.
    """
    from scipy.sparse import csr_array

    support, stride = spline.SUPPORT[grid.interpolation], spline.STRIDE[grid.interpolation]
    values = grid.coefficients
    inside = np.ones((1,) * len(axes), dtype=bool)
    for number, points in enumerate(axes):
        points = np.asarray(points, dtype=np.float64)
        place = (points - grid.origin[number]) / grid.spacing[number]
        last = grid.shape[number] - 1
        within = (place >= -1e-12 * last) & (place <= last * (1.0 + 1e-12))
        cell = np.clip(np.floor(place).astype(np.int64), 0, last - 1)
        weight, _ = spline.weights(grid.interpolation, np.where(within, place - cell, 0.0))
        column = cell * stride + np.arange(support)[:, None]
        row = np.broadcast_to(np.arange(len(points)), column.shape)
        matrix = csr_array((weight.ravel(), (row.ravel(), column.ravel())), shape=(len(points), values.shape[number]))
        moved = np.moveaxis(values, number, 0)
        product = matrix @ moved.reshape(len(moved), -1)
        values = np.moveaxis(product.reshape((len(points), *moved.shape[1:])), 0, number)
        inside = inside & np.reshape(within, [-1 if axis == number else 1 for axis in range(len(axes))])
    ambient = grid.ambient_index
    index = np.sqrt(np.maximum(ambient**2 + 2.0 * values, 0.0))
    return np.where(inside, 2.0 * values / (index + ambient), 0.0)


def contrast_without_gradient(field, points: np.ndarray) -> np.ndarray:
    """Return the contrast of an index field at points (n, 3), shape (n,), for cubic grids in a sixth of the time."""
    if not field.is_uniform or field.interpolation != "cubic":
        return np.asarray(field.contrast_at(points))
    from scipy.ndimage import map_coordinates

    grid = field.samples
    local = field.local_coordinates(points)
    tolerance = 1e-12 * (grid.high - grid.low)
    inside = np.all((local >= grid.low - tolerance) & (local <= grid.high + tolerance), axis=1)
    last = np.array(grid.shape, dtype=np.float64) - 1.0
    place = np.clip((local[inside] - grid.origin) / grid.spacing, 0.0, last) + 1.0  # one coefficient before the first
    potential = map_coordinates(grid.coefficients, place.T, order=3, prefilter=False, mode="nearest", output=np.float64)
    ambient = grid.ambient_index
    contrast = np.zeros(len(local))
    contrast[inside] = 2.0 * potential / (np.sqrt(np.maximum(ambient**2 + 2.0 * potential, 0.0)) + ambient)
    return contrast
