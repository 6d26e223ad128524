"""Node values of a conical field with a shock on a uniform (r, z) grid, made from exact averages over half cells.

The density jumps at the shock, which cuts cells at any angle. Node values are therefore weighted averages under a
bell-shaped kernel about three cells wide, made from exact averages over half cells: the shock keeps its position and is
spread little more than the interpolant needs to resolve it. Plain cell averages are as accurate only for rays along a
grid axis. A ray at an angle to grid and shock sees a coarser staircase in them, which at least doubles the error of its
direction and costs a third more steps.
"""

import math
from collections.abc import Callable

import numpy as np

from .exact_averages import unit_gauss

# Weights of the seven half cells about a node; variance of the kernel [cells^2]: of these weights and of a half cell.
BELL = np.array([1.0, 6.0, 15.0, 20.0, 15.0, 6.0, 1.0]) / 64.0
VARIANCE = 6.0 / 16.0 + 1.0 / 48.0
# Cells this near the shock, or the tip, are integrated with more Gauss points; those near the tip are also divided
# into TIP_PARTS x TIP_PARTS parts.
SHOCK_BAND, TIP_REACH, TIP_PARTS = 2, 16, 8
BLOCK = 20_000  # speed only


def bell(half: np.ndarray, axis: int, sharpen: bool) -> np.ndarray:
    """Return node values along one axis from averages over half cells, every second of which is centred on a node.

    Args:
        half: The averages; the sixth is centred on the first node, and five follow that of the last node.
        axis: The axis.
        sharpen: Correct for the kernel's second moment: the result is then exact for cubics, otherwise for linear
            functions.
    """
    moved = np.moveaxis(half, axis, 0)
    count = len(moved) - len(BELL) + 1
    wide = sum(weight * moved[k : k + count] for k, weight in enumerate(BELL))[::2]
    result = wide[1:-1]
    if sharpen:
        result = result - 0.5 * VARIANCE * (wide[2:] - 2.0 * wide[1:-1] + wide[:-2])
    return np.moveaxis(result, 0, axis)


def cell_averages(
    contrast: Callable[[np.ndarray], np.ndarray],
    shock_angle: float,
    shape: tuple[int, int],
    low: float,
    step: np.ndarray,
) -> np.ndarray:
    """Return averages of a conical field over the cells centred on the nodes of a grid.

    Args:
        contrast: The field as a function of polar angle [rad]; ahead of the shock it is zero.
        shock_angle: Polar angle of the shock [rad].
        shape: Number of nodes in r, starting at r = 0, and in z.
        low: z of the first node [m].
        step: Spacing in r and z [m].

    Returns:
        Averages over the (r, z) rectangles, shape `shape`; the first cell in r is averaged over its half with r > 0.
    """
    r = step[0] * np.arange(shape[0])
    z = low + step[1] * np.arange(shape[1])
    edges = np.stack([np.maximum(r - 0.5 * step[0], 0.0), r + 0.5 * step[0]])
    near = np.meshgrid(edges[0], z - 0.5 * step[1], indexing="ij")
    far = np.meshgrid(edges[1], z + 0.5 * step[1], indexing="ij")
    # `near` and `far` hold the corners of each cell with the least and the greatest polar angle.
    behind = np.arctan2(near[0], -near[1]) < shock_angle
    band = np.arctan2(far[0] + SHOCK_BAND * step[0], -(far[1] + SHOCK_BAND * step[1])) > shock_angle
    tip = np.hypot(r[:, None] / step[0], z[None, :] / step[1]) < TIP_REACH
    result = np.zeros(shape)
    for chosen, parts, point_count in (
        (behind & ~band & ~tip, 1, 2),
        (behind & band & ~tip, 1, 8),
        (behind & tip, TIP_PARTS, 8),
    ):
        place = np.nonzero(chosen)
        box = np.stack([near[0][place], far[0][place], near[1][place], far[1][place]], axis=1)
        average = np.empty(len(box))
        for row in range(0, len(box), BLOCK // parts**2):
            rows = slice(row, row + BLOCK // parts**2)
            pieces = _divided(box[rows], parts)
            if point_count == 2:
                average[rows] = _gauss(contrast, pieces, point_count)
            else:
                averages = _gauss_to_shock(contrast, shock_angle, pieces, point_count)
                average[rows] = averages.reshape(-1, parts**2).mean(1)
        result[place] = average
    return result


def _divided(box: np.ndarray, parts: int) -> np.ndarray:
    """Return each box (r from, r to, z from, z to) divided into parts x parts equal boxes, in order."""
    share = np.arange(parts + 1) / parts
    r = box[:, :1] + (box[:, 1:2] - box[:, :1]) * share
    z = box[:, 2:3] + (box[:, 3:] - box[:, 2:3]) * share
    pieces = np.empty((len(box), parts, parts, 4))
    pieces[..., 0], pieces[..., 1] = r[:, :-1, None], r[:, 1:, None]
    pieces[..., 2], pieces[..., 3] = z[:, None, :-1], z[:, None, 1:]
    return pieces.reshape(-1, 4)


def _gauss(contrast, box, point_count) -> np.ndarray:
    """Return averages over boxes behind the shock, by a product Gauss rule."""
    share, weight = unit_gauss(point_count)
    r = box[:, :1] + (box[:, 1:2] - box[:, :1]) * share
    z = box[:, 2:3] + (box[:, 3:] - box[:, 2:3]) * share
    value = contrast(np.arctan2(r[:, :, None], -z[:, None, :]))
    return np.einsum("nij,i,j->n", value, weight, weight)


def _gauss_to_shock(contrast, shock_angle, box, point_count) -> np.ndarray:
    """Return averages over boxes that the shock may cut.

    The integral along z ends at the shock, and the integral along r is split where the shock enters and leaves the box.
    The variable along z is the square root of the distance from the shock, because behind a weak shock the density
    rises with that root.
    """
    share, weight = unit_gauss(point_count)
    r_low, r_high, z_low, z_high = box.T
    tangent = math.tan(shock_angle)
    # For r < `first` the shock passes above the box, for r > `last` below the box.
    first = np.clip(-z_high * tangent, r_low, r_high)
    last = np.clip(-z_low * tangent, r_low, r_high)
    total = np.zeros(len(box))
    for start, end in ((r_low, first), (first, last)):
        r = start[:, None] + (end - start)[:, None] * share
        shock = -r / tangent
        near = np.sqrt(np.maximum(shock - np.minimum(z_high[:, None], shock), 0.0))
        far = np.sqrt(np.maximum(shock - z_low[:, None], 0.0))
        root = near[..., None] + (far - near)[..., None] * share
        value = contrast(np.minimum(np.arctan2(r[..., None], root**2 - shock[..., None]), shock_angle))
        along = (far - near) * np.einsum("nij,nij,j->ni", value, 2.0 * root, weight)
        total += (end - start) * (along @ weight)
    return total / ((r_high - r_low) * (z_high - z_low))
