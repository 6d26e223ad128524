"""The next order's change of an interpolant on a quadrilateral mesh, and what it keeps of the cells' averages.

Along an edge from a to b a cubic with the node gradients g differs from the straight line at u by

    u (1 - u) / 2 (g_a - g_b) . (x_b - x_a)

to lowest order; in a cell the changes along both of its directions add. Where the samples keep the averages of cells,
the next order keeps them too: of the change in each cell its mean, a sixth of both changes, is left out.
"""

from dataclasses import replace

import numpy as np

from ...medium import IndexField
from ...medium.mesh_columns import mesh_columns
from ...medium.mesh_samples import MeshSamples
from .paths import Contrast, Paths
from .rays import Rays
from .splines import in_space

# Lines along which averages are compared.
COLUMNS = 64


def next_order(field: IndexField) -> Contrast:
    """Return the change of the contrast by the next order of a mesh's interpolant."""
    samples = field.samples
    assert isinstance(samples, MeshSamples)
    bilinear = samples if samples.interpolation == "bilinear" else replace(samples, interpolation="bilinear")

    def contrast(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        local = field.local_coordinates(points)
        places = samples.mesh.places(local)
        value, slope = np.zeros(len(points)), np.zeros((len(points), 2))
        rows, cell, (xi, eta) = places.rows, places.cell, places.local
        if samples.interpolation != "cells" and len(rows):
            value[rows], slope[rows] = _bent(bilinear, cell, xi, eta)
        if bilinear is not samples:
            (after, slope_after), (before, slope_before) = (one.evaluate(local, places) for one in (bilinear, samples))
            value, slope = value + after - before, slope + slope_after - slope_before
        return value, in_space(field, points, slope)

    return contrast


def _bent(samples: MeshSamples, cell: np.ndarray, xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the change in cells at bilinear coordinates, shape (n,), and its gradient [1/m], shape (n, 2)."""
    vertex, corner = samples.mesh.cells[cell], samples.mesh.corners[cell]
    gradient = samples.gradients[vertex]

    def rise(a: int, b: int) -> np.ndarray:
        return np.asarray(0.5 * np.sum((gradient[:, a] - gradient[:, b]) * (corner[:, b] - corner[:, a]), axis=1))

    low, high, left, right = rise(0, 1), rise(3, 2), rise(0, 3), rise(1, 2)
    along, across = xi * (1.0 - xi), eta * (1.0 - eta)
    by_xi, by_eta = (1.0 - eta) * low + eta * high, (1.0 - xi) * left + xi * right
    value = along * by_xi + across * by_eta
    if samples.averages is not None:
        value = value - (low + high + left + right) / 12.0
    # Derivatives along xi and eta, and the inverse of the cell's Jacobian.
    d_xi = (1.0 - 2.0 * xi) * by_xi + across * (right - left)
    d_eta = along * (high - low) + (1.0 - 2.0 * eta) * by_eta
    one = (1.0 - eta)[:, None] * (corner[:, 1] - corner[:, 0]) + eta[:, None] * (corner[:, 2] - corner[:, 3])
    two = (1.0 - xi)[:, None] * (corner[:, 3] - corner[:, 0]) + xi[:, None] * (corner[:, 2] - corner[:, 1])
    area = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    slope = np.stack([d_xi * two[:, 1] - d_eta * one[:, 1], d_eta * one[:, 0] - d_xi * two[:, 0]], axis=1)
    return value, slope / area[:, None]


def lacking(field: IndexField, paths: Paths) -> Rays:
    """Return what a bilinear interpolant lacks of the cells' averages, along the paths.

    The lack of each cell times the path's length in it is the error of the integral as far as averages define one: they
    do not say where in a cell the gas is. It is large beside a captured shock, and nearly zero elsewhere.
    """
    found = Rays.still(len(paths.length))
    known = None if field.is_uniform else field.samples.lacking_by_cell
    if known is None or not known[1].any():
        return found
    lost = np.zeros(min(COLUMNS, len(paths.length)))
    rows = np.flatnonzero(paths.length[: len(lost)] > 0.0)
    chord = paths.last[rows] - paths.first[rows]
    direction = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    ends = np.stack([np.zeros(len(rows)), paths.length[rows]])
    mesh, lacks = known
    lost[rows] = mesh_columns(mesh, lacks, paths.first[rows], direction, ends)
    # Lines are exact integrals through every cell, which takes long: each stands for those in turn.
    return replace(found, opd=np.resize(lost, len(found.opd)))
