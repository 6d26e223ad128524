r"""Compute, for some rays, the bending that straight lines leave out.

A ray that crosses the planes z = const with the slopes s would, bent, be displaced across them by xi(z). With
N = sqrt(1 + s^2), Q = 1 / N - s s^T / N^3 and m the contrast, Fermat's principle gives to first order in m

    Q xi' = \int N grad m dz - (m - m_entry) s / N,        grad across the axis, from where the ray enters the box,

and the optical path difference changes, to second order, by

    \int (N grad m . xi + m s . xi' / N + 1/2 xi' . Q xi') dz,        continued from the box to the stop with the last
    xi'.

Along an axis this is [xi' . xi] - 1/2 \int theta^2 dz. The neglected terms are of third order, below the box's length
squared times the second derivatives of m. The gradients are those of the spline, from a window of the samples around
each crossing, so that only samples near the rays are read.
"""

from collections.abc import Callable

import numpy as np

from ..medium import spline
from .line_integrals import LineIntegrals
from .plane_values import basis_rows, to_coefficients

WINDOW = 20  # nodes along each axis of the window: the spline's inverse has fallen to 1e-5 at its ends
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
    value, gradient = at_planes(lines, samples, contrast)
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


def _sum_to(values: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return integrals from the entry to each plane, shape (n, plane_count, 2)."""
    parts = values * step[..., None]
    return np.cumsum(parts, axis=1) - 0.5 * parts


def at_planes(lines: LineIntegrals, samples: np.ndarray, contrast: Contrast) -> tuple[np.ndarray, np.ndarray]:
    """Return the contrast where rays cross the planes of a volume, and its gradient across them [1/m].

    Shapes (n, plane_count) and (n, plane_count, 2).
    """
    others = [k for k in range(3) if k != lines.axis]
    place = lines.crossings()
    moved = np.moveaxis(samples, lines.axis, 2)
    planes = np.arange(moved.shape[2])[None, :, None, None]
    inverse = [to_coefficients(moved.shape[a], lines.interpolation, False, lines.mesh.cell_averages) for a in range(2)]
    value = np.empty(place.shape[:2])
    gradient = np.empty(place.shape)
    for first in range(0, len(place), AT_ONCE):
        rays = slice(first, first + AT_ONCE)
        index, rows, slope = zip(
            *[_window_rows(place[rays, :, a], lines.interpolation, inverse[a]) for a in range(2)],
            strict=True,
        )
        seen = contrast(np.asarray(moved[index[0][:, :, :, None], index[1][:, :, None, :], planes], np.float64))
        across = np.einsum("nkij,nkj->nki", seen, rows[1])
        value[rays] = np.einsum("nki,nki->nk", across, rows[0])
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
