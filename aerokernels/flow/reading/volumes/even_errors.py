"""Estimate the error of values at the corners of uniform cells, on rows of cells along z.

Beside a captured shock these values are means of neighbours, and the row is judged like the cells of any mesh: by the
difference between a linear function with each cell's average and the means at the cell's corners. Where the flow is
smooth this difference is of second order but the values are of fourth order: there the change of the difference from
cell to cell along the row counts.
"""

import numpy as np

from aerokernels.flow.reading.volumes.measuring_lines import LINES, VolumeResampling, unresolved

SIDES = np.array([[-0.5, 0.5]])


def estimated_error(average: np.ndarray, smooth: np.ndarray, step: np.ndarray) -> VolumeResampling:
    """Return the error of columns along z through the spline that keeps averages over uniform cells.

    Args:
        average: Averages over the cells [kg/m3], [x, y, z].
        smooth: Cells that neither contain a captured shock nor touch a cell that does, likewise.
        step: Size of the cells along each axis [m].
    """
    i, j = (_some(n) for n in average.shape[:2])
    # [row in x, its side, row in y, its side, z]; cells beyond the edge are extrapolated linearly from the last two
    near = _with_sides(_with_sides(average, i, 0), j, 2)
    near = np.concatenate(
        [2.0 * near[..., :1] - near[..., 1:2], near, 2.0 * near[..., -1:] - near[..., -2:-1]], axis=-1
    )
    deficit = _deficits(near)
    free = smooth[i][:, j]
    change = np.zeros(deficit.shape)
    if deficit.shape[-1] > 2:
        change[..., 1:-1] = np.diff(deficit, 2, axis=-1)
        change[..., 0], change[..., -1] = change[..., 1], change[..., -2]
    lacks = np.where(free, change, deficit).reshape(-1, deficit.shape[-1])
    cell = np.broadcast_to(np.arange(lacks.shape[1]), lacks.shape)
    likely, greatest = unresolved(lacks * step[2], lacks, cell, float(np.ptp(average)))
    return VolumeResampling(
        tuple(float(size) for size in step),  # type: ignore[arg-type]
        *(0.0,) * 7,
        float(np.sqrt(np.mean(lacks**2))),
        float(np.sqrt(np.mean(likely**2))),
        float(greatest.max()),
    )


def _some(count: int) -> np.ndarray:
    """Return the numbers of some rows, evenly spaced among `count`."""
    return np.unique(((np.arange(LINES) + 0.5) / LINES * count).astype(np.int64))


def _with_sides(values: np.ndarray, index: np.ndarray, axis: int) -> np.ndarray:
    """Return some entries along an axis with those before and after each, on a new axis behind it."""
    last = values.shape[axis] - 1
    own = np.take(values, index, axis)
    inward = np.take(values, np.where(index == 0, 1, index - 1), axis)
    onward = np.take(values, np.where(index == last, last - 1, index + 1), axis)
    shape = [-1 if k == axis else 1 for k in range(values.ndim)]
    before = np.where((index == 0).reshape(shape), 2.0 * own - onward, inward)
    after = np.where((index == last).reshape(shape), 2.0 * own - inward, onward)
    return np.stack([before, own, after], axis=axis + 1)


def _deficits(near: np.ndarray) -> np.ndarray:
    """Return the differences of linear functions in cells from means at their corners: see `Linear.deficit`."""
    corner = near
    for axis in (1, 3):
        moved = np.moveaxis(corner, axis, 0)
        corner = np.moveaxis(0.5 * (moved[1:] + moved[:-1]), 0, axis)
    corner = 0.5 * (corner[..., 1:] + corner[..., :-1])
    corner = np.stack([corner[..., :-1], corner[..., 1:]], axis=-1)  # the corners below and above each cell
    own = near[:, 1, :, 1, 1:-1]
    differ = own[:, None, :, None, :, None] - corner
    for axis in (1, 3, 5):
        slope = np.diff(corner.mean(axis=tuple({1, 3, 5} - {axis}), keepdims=True), axis=axis)
        shape = [2 if k == axis else 1 for k in range(6)]
        differ = differ + slope * SIDES.reshape(shape)
    rms = np.sqrt(np.mean(differ**2, axis=(1, 3, 5)))
    return np.copysign(rms, differ.mean(axis=(1, 3, 5)))
