"""Sharpness of the values on a quadrilateral mesh, on an even raster over its box.

The interpolant is bent where its gradient changes from cell to cell. With the gradient g_c in the middle of a cell, by
the differences of its corners across it, which are exact for a linear m, and their mean g_v over the cells about a
vertex, the sharpness of a cell of size h is

    max over its corners of |g_v - g_c| h

A pixel of the raster holds the greatest sharpness of the cells whose centre it holds, and a pixel without one that of
the nearest pixel.
"""

from dataclasses import dataclass

import numpy as np

from ...medium.mesh_samples import MeshSamples

# Greatest number of pixels along an axis.
MOST_PIXELS = 512


@dataclass(frozen=True, eq=False)
class Raster:
    """An even raster over the box of a mesh.

    Attributes:
        sharpness: Sharpness of each pixel, in the unit of the values, shape (m, n).
        low: Lowest corner [m], shape (2,).
        pixel: Sides of a pixel [m], shape (2,).
    """

    sharpness: np.ndarray
    low: np.ndarray
    pixel: np.ndarray

    def at(self, local: np.ndarray) -> np.ndarray:
        """Return the sharpness, shape (n,), at local coordinates (n, 2) [m]; beyond the box that of its edge."""
        place = np.floor((local - self.low) / self.pixel).astype(np.int64)
        row, column = np.clip(place, 0, np.array(self.sharpness.shape) - 1).T
        return np.asarray(self.sharpness[row, column])


def raster_of(samples: MeshSamples) -> Raster:
    """Return the raster of a mesh's values; its pixels are about as large as the cells."""
    from scipy.ndimage import distance_transform_edt

    mesh = samples.mesh
    cells, corners, values = mesh.cells, mesh.corners, samples.values[mesh.cells]
    (a, b), (c, d) = (corners[:, 2] - corners[:, 0]).T, (corners[:, 3] - corners[:, 1]).T
    one, other = values[:, 2] - values[:, 0], values[:, 3] - values[:, 1]
    gradient = np.stack([d * one - b * other, a * other - c * one], axis=1) / (a * d - b * c)[:, None]
    around = np.maximum(np.bincount(cells.ravel(), minlength=len(mesh.vertices)), 1)
    sums = [np.bincount(cells.ravel(), np.repeat(part, 4), len(mesh.vertices)) for part in gradient.T]
    change = np.stack(sums, axis=1)[cells] / around[cells][:, :, None] - gradient[:, None]
    sharp = np.nan_to_num(np.sqrt(np.sum(change**2, axis=2))).max(axis=1) * mesh.cell_size
    low, extent = mesh.box[0], mesh.box[1] - mesh.box[0]
    count = np.clip(np.ceil(extent / float(np.median(mesh.cell_size))).astype(np.int64), 1, MOST_PIXELS)
    raster = Raster(np.full(count, -1.0), low, extent / count)
    row, column = np.clip(np.floor((mesh.cell_centroid - low) / raster.pixel).astype(np.int64), 0, count - 1).T
    np.maximum.at(raster.sharpness, (row, column), sharp)
    nearest = distance_transform_edt(raster.sharpness < 0.0, return_distances=False, return_indices=True)
    return Raster(raster.sharpness[tuple(nearest)], low, raster.pixel)
