"""Continue a field beyond the faces that its rays run along, so that a cosine transform finds no kink there.

A cosine transform takes values as even about each face. Where they have a slope there, that is a kink, whose high
frequencies count as structure in all of the air near the face. The rays never meet what is behind the face, so that
values may be continued there in any way: about the value at the face they are odd, faded out over a few cells, which
keeps the slope.
"""

import numpy as np

from ...medium.grid import UniformGrid

# Cells behind a face in which values fade to that at the face, which has no slope at the new end.
WIDTH = 4
# A face is left as it is where its slopes are no more than this share of its second differences, as on a plane of
# symmetry, or of the greatest value: an even continuation then has the weaker kink.
AS_ON_SYMMETRY, NO_SLOPE = 0.5, 1e-6


def continued(values: np.ndarray, grid: UniformGrid, axes: list[int]) -> tuple[np.ndarray, tuple[slice, ...]]:
    """Continue a grid's values beyond its faces across some axes.

    Args:
        values: One for each node.
        grid: The grid, for the symmetry of its first axis, about which values are even.
        axes: The axes.

    Returns:
        The values with those behind the faces, and the slices that take the grid's own from them.
    """
    least = NO_SLOPE * float(max(values.max(initial=0.0), -values.min(initial=0.0)))
    inner, shape = [slice(0, count) for count in grid.shape], list(grid.shape)
    for axis in axes:
        is_even = axis == 0 and grid.even_first_axis
        first = 0 if is_even or not _has_slope(values, axis, least) else WIDTH
        last = WIDTH if _has_slope(np.flip(values, axis), axis, least) else 0
        inner[axis] = slice(first, first + grid.shape[axis])
        shape[axis] += first + last
    if shape == list(grid.shape):
        return values, tuple(inner)
    whole = np.empty(shape, values.dtype)
    whole[tuple(inner)] = values
    for number, axis in enumerate(axes):
        # What is behind the faces across the next axes is not there yet.
        part = whole[
            tuple(slice(None) if at not in axes[number:] or at == axis else inner[at] for at in range(whole.ndim))
        ]
        rows = np.moveaxis(part, axis, 0)
        _fill(rows[: inner[axis].stop], inner[axis].start)
        _fill(rows[inner[axis].start :][::-1], len(rows) - inner[axis].stop)
    return whole, tuple(inner)


def _has_slope(values: np.ndarray, axis: int, least: float) -> bool:
    """Whether values have slopes at the first face across an axis."""
    if values.shape[axis] <= WIDTH:
        return False
    rows = np.moveaxis(values, axis, 0)
    slope = np.abs(1.5 * rows[0] - 2.0 * rows[1] + 0.5 * rows[2]).max()
    second = np.abs(rows[0] - 2.0 * rows[1] + rows[2]).max()
    return bool(slope > max(AS_ON_SYMMETRY * second, least))


def _fill(rows: np.ndarray, count: int) -> None:
    """Fill the first `count` rows, behind a face, from those that follow."""
    for node in range(1, count + 1):
        part = node / count
        faded = rows.dtype.type((1.0 - part) ** 2 * (1.0 + 2.0 * part))
        rows[count - node] = rows[count] + faded * (rows[count] - rows[count + node])
