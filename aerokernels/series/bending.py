r"""Estimate, for some rays, the bending that straight lines leave out and the interpolation error of the spline.

A ray that crosses the planes z = const with the slopes s would, bent, be displaced across them by xi(z). With
N = sqrt(1 + s^2), Q = 1 / N - s s^T / N^3 and m the contrast, Fermat's principle gives to first order in m

    Q xi' = \int N grad m dz - (m - m_entry) s / N,        grad across the axis, from where the ray enters the box,

and the optical path difference changes, to second order, by

    \int (N grad m . xi + m s . xi' / N + 1/2 xi' . Q xi') dz,        continued from the box to the stop with the last
    xi'.

Along an axis this is [xi' . xi] - 1/2 \int theta^2 dz. The neglected terms are of third order, below the box's length
squared times the second derivatives of m. The gradients are those of the spline, from a window of the samples around
each crossing, so that an estimate reads only the samples near its rays.

The interpolation error is Richardson's, from every second and fourth node (medium/levels.py).
"""

from collections.abc import Callable

import numpy as np

from ..flow import GridMesh
from ..medium import spline
from ..medium.levels import ORDER, richardson_error
from .line_integrals import LineIntegrals
from .plane_values import basis_rows, to_coefficients

WINDOW = 20  # nodes along each axis of the window: the spline's inverse has fallen to 1e-5 at its ends
SAFETY = 3.0  # on the interpolation error, as in tracing/error_budget/budget.py
AT_ONCE = 8  # rays; speed only

Contrast = Callable[[np.ndarray], np.ndarray]


def bending(
    lines: LineIntegrals, samples: np.ndarray, contrast: Contrast, beyond: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the change of optical path differences by bending, and their values on straight lines [m].

    Each has the shape (n,). The values on straight lines are integrated ray by ray through the spline of every plane.

    Args:
        lines: The rays, through a volume.
        samples: Of the density, shape of the mesh.
        contrast: Function that returns the index contrast of densities.
        beyond: Distance of the stop beyond the box, along each ray [m], shape (n,).
    """
    value, gradient = at_planes(lines, samples, contrast, True)
    others = [k for k in range(3) if k != lines.axis]
    along = lines.direction[lines.axis]
    slope = lines.direction[others] / abs(along)
    length = np.sqrt(1.0 + slope @ slope)
    metric = np.eye(2) / length - np.outer(slope, slope) / length**3
    step = lines.path_weights() / length
    straight = (value * lines.path_weights()).sum(axis=1)
    if along < 0.0:
        value, gradient, step = value[:, ::-1], gradient[:, ::-1], step[:, ::-1]
    reached = np.cumsum(np.abs(step), axis=1) > 0.0
    entry = np.take_along_axis(value, np.argmax(reached, axis=1)[:, None], axis=1)
    turned = length * _sum_to(gradient, step) - ((value - entry) * reached)[..., None] * slope / length
    tilt = turned @ np.linalg.inv(metric)  # xi', and Q is symmetric
    shift = _sum_to(tilt, step)
    part = length * np.sum(gradient * shift, axis=-1) + value * (tilt @ slope) / length
    part += 0.5 * np.sum(tilt * turned, axis=-1)
    last = 0.5 * np.sum(tilt[:, -1] * turned[:, -1], axis=-1)
    return np.asarray((part * step).sum(axis=1) + last * beyond / length), straight


def interpolation_error(lines: LineIntegrals, samples: np.ndarray, contrast: Contrast) -> np.ndarray:
    """Return the interpolation error of the integrals of the contrast along the rays [m], shape (n,).

    On grids of fewer than nine nodes along each axis it is their difference from the linear interpolant.
    """
    mesh = lines.mesh
    every = [4 if count >= 9 else 2 if count >= 5 else 1 for count in mesh.shape]
    cut = [slice(0, count - (count - 1) % stride) for count, stride in zip(mesh.shape, every, strict=True)]
    if max(every) < 4:
        other = LineIntegrals(mesh, lines.start, lines.direction, "linear")
        return SAFETY * np.abs(lines(contrast(samples)) - other(contrast(samples)))
    found = []
    for greatest in (1, 2, 4):
        strides = [min(one, greatest) for one in every]
        some = samples[tuple(cut)][tuple(slice(None, None, one) for one in strides)]
        thin = GridMesh("volume", mesh.origin, mesh.spacing * strides, some.shape, mesh.cell_averages)
        level = LineIntegrals(thin, lines.start, lines.direction, lines.interpolation)
        value, _ = at_planes(level, some, contrast, False)
        found.append((value * level.path_weights()).sum(axis=1))
    return SAFETY * np.abs(richardson_error(found[0], found[1], found[2], ORDER[lines.interpolation]))


def _sum_to(values: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return integrals from the entry to each plane, shape (n, plane_count, 2)."""
    parts = values * step[..., None]
    return np.cumsum(parts, axis=1) - 0.5 * parts


def at_planes(
    lines: LineIntegrals, samples: np.ndarray, contrast: Contrast, slopes: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the contrast where rays cross the planes of a volume, and with `slopes` its gradient across them [1/m].

    Shapes (n, plane_count) and (n, plane_count, 2).
    """
    others = [k for k in range(3) if k != lines.axis]
    place = lines.crossings()
    moved = np.moveaxis(samples, lines.axis, 2)
    planes = np.arange(moved.shape[2])[None, :, None, None]
    inverse = [to_coefficients(moved.shape[a], lines.interpolation, False, lines.mesh.cell_averages) for a in range(2)]
    value = np.empty(place.shape[:2])
    gradient = np.empty(place.shape if slopes else (0,))
    for first in range(0, len(place), AT_ONCE):
        rays = slice(first, first + AT_ONCE)
        index, rows, slope = zip(
            *[_window_rows(place[rays, :, a], lines.interpolation, inverse[a]) for a in range(2)],
            strict=True,
        )
        seen = contrast(np.asarray(moved[index[0][:, :, :, None], index[1][:, :, None, :], planes], np.float64))
        across = np.einsum("nkij,nkj->nki", seen, rows[1])
        value[rays] = np.einsum("nki,nki->nk", across, rows[0])
        if slopes:
            first_slope = np.einsum("nki,nki->nk", across, slope[0])
            second_slope = np.einsum("nkij,nki,nkj->nk", seen, rows[0], slope[1], optimize=True)
            gradient[rays] = np.stack([first_slope, second_slope], axis=-1) / lines.mesh.spacing[others]
    return value, gradient


def _window_rows(place: np.ndarray, interpolation: str, inverse: np.ndarray):
    """Return nodes around places along an axis, and their samples' weights in the value and the slope [1/cell].

    Each of shape (*place.shape, width).
    """
    count = inverse.shape[1]
    cell, _ = basis_rows(place.ravel(), count, interpolation)
    rest = np.clip(place.ravel(), 0.0, count - 1.0) - cell
    value, slope = (one.T for one in spline.weights(interpolation, rest))
    width = min(WINDOW, count)
    low = np.clip(cell + 1 - width // 2, 0, count - width)
    nodes = low[:, None] + np.arange(width)
    terms = inverse[(cell[:, None] + np.arange(value.shape[1]))[:, :, None], nodes[:, None, :]]
    shape = (*place.shape, width)
    return nodes.reshape(shape), *(np.einsum("ns,nsw->nw", one, terms).reshape(shape) for one in (value, slope))
