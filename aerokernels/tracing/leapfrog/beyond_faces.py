"""Continue a field beyond the faces that its rays run along, so that a cosine transform finds no kink there.

A cosine transform takes values as even about each face. Where they have a slope there, that is a kink, whose high
frequencies count as structure in all of the air near the face. The rays never meet what is behind the face, so that
values may be continued there in any way: about the value at the face they are odd, faded out over a few cells, which
keeps the slope.
"""

import numpy as np

from ...medium.grid import UniformGrid
from ...process.threads import in_threads, slabs
from ..step_bound import potential_at_nodes

# Cells behind a face in which values fade to that at the face, which has no slope at the new end.
WIDTH = 4
# A face is left as it is where its slopes are no more than this share of its second differences, as on a plane of
# symmetry, or of the greatest value: an even continuation then has the weaker kink.
AS_ON_SYMMETRY, NO_SLOPE = 0.5, 1e-6


def continued(grid: UniformGrid, axes: list[int], kind: np.dtype) -> tuple[np.ndarray, tuple[slice, ...]]:
    """Continue the potential over the ambient index beyond a grid's faces across some axes.

    Args:
        grid: The grid; about its first axis values may be even.
        axes: The axes.
        kind: Type of the values.

    Returns:
        The values with those behind the faces, and the slices that take the grid's own from them.
    """
    least = NO_SLOPE * float(np.abs(grid.potential_of(np.array(grid.extremes))).max()) / grid.ambient_index
    inner, shape = [slice(0, count) for count in grid.shape], list(grid.shape)
    for axis in axes:
        is_even = axis == 0 and grid.even_first_axis
        first = 0 if is_even or not _has_slope(grid, axis, (0, 1, 2), least) else WIDTH
        last = WIDTH if _has_slope(grid, axis, (-1, -2, -3), least) else 0
        inner[axis] = slice(first, first + grid.shape[axis])
        shape[axis] += first + last
    whole = np.empty(shape, kind)
    own = whole[tuple(inner)]

    def fill(rows: slice) -> None:
        own[rows] = potential_at_nodes(grid, rows)

    in_threads(fill, slabs(len(own), own.size))
    for number, axis in enumerate(axes):
        # What is behind the faces across the next axes is not there yet.
        part = whole[
            tuple(slice(None) if at not in axes[number:] or at == axis else inner[at] for at in range(whole.ndim))
        ]
        rows = np.moveaxis(part, axis, 0)
        _fill(rows[: inner[axis].stop], inner[axis].start)
        _fill(rows[inner[axis].start :][::-1], len(rows) - inner[axis].stop)
    return whole, tuple(inner)


def _has_slope(grid: UniformGrid, axis: int, layers: tuple[int, int, int], least: float) -> bool:
    """Whether the potential has slopes at a face across an axis, by the layers of nodes there."""
    if grid.shape[axis] <= WIDTH:
        return False
    rows = [potential_at_nodes(grid, (slice(None),) * axis + (layer,)) for layer in layers]
    slope = np.abs(1.5 * rows[0] - 2.0 * rows[1] + 0.5 * rows[2]).max()
    second = np.abs(rows[0] - 2.0 * rows[1] + rows[2]).max()
    return bool(slope > max(AS_ON_SYMMETRY * second, least))


def _fill(rows: np.ndarray, count: int) -> None:
    """Fill the first `count` rows, behind a face, from those that follow."""
    for node in range(1, count + 1):
        part = node / count
        faded = rows.dtype.type((1.0 - part) ** 2 * (1.0 + 2.0 * part))
        rows[count - node] = rows[count] + faded * (rows[count] - rows[count + node])
