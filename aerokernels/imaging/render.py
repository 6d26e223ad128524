"""Render the picture of a scene from point spread functions at nodes over it; through.py has the formula.

The nodes of a row are processed together. The scene's own spline coefficients are blurred, which gives the coefficients
of the blurred scene: so no spline is affected by the edge of a patch.
"""

import numpy as np

from ..process.threads import in_threads
from .spreads import SpreadGrid

# Variation of the shift over the picture that counts as none, and the greatest one followed from node to pixel
# [pixels].
SAME_SHIFT, GREATEST_CHANGE = 1e-6, 64.0
# Pixels by which a scene is continued beyond its border: the border's effect on spline coefficients decreases by a
# factor of 0.27 per pixel.
BORDER = 28
# Neighbours that a cubic needs on either side; array elements of the patches transformed together.
NEIGHBOURS, TOGETHER = 2, 1 << 18
# Pixels and their weights.
Hat = tuple[np.ndarray, np.ndarray]


def render(scene: np.ndarray, grid: SpreadGrid, shift: np.ndarray, through: np.ndarray) -> np.ndarray:
    """Return the picture of a scene, from the kernels at nodes and the shift of each pixel along x and y [pixels].

    The scene is (rows, columns) or (rows, columns, colours), at least as large as the picture; `through` is the share
    of the light that reaches each pixel.
    """
    if scene.ndim == 3:
        return np.stack([render(colour, grid, shift, through) for colour in np.moveaxis(scene, 2, 0)], axis=2)
    shape, picture = through.shape, np.zeros(through.shape)
    view = _View(scene, grid, shift)
    across = [hat(grid.columns, column, shape[1]) for column in range(len(grid.columns))]

    def add(row: int) -> None:
        pixels, up = hat(grid.rows, row, shape[0])
        for column, light in view.lights(row, pixels, across):
            place, weight = across[column]
            picture[pixels[0] : pixels[-1] + 1, place[0] : place[-1] + 1] += up[:, None] * weight * light

    # Every second row of nodes affects separate pixels, so that threads do not add to the same ones.
    for first in (0, 1):
        in_threads(add, range(first, len(grid.rows), 2))
    return picture * through


def hat(nodes: np.ndarray, index: int, count: int) -> Hat:
    """Return the pixels between the neighbours of a node and its weight there, constant beyond the outermost nodes."""
    pixels = np.arange(count)
    weight = np.interp(pixels, nodes, np.eye(len(nodes))[index])
    lit = weight > 0.0
    return pixels[lit], weight[lit]


class _View:
    """A scene prepared for rendering."""

    def __init__(self, scene: np.ndarray, grid: SpreadGrid, shift: np.ndarray):
        """Prepare a scene for all nodes."""
        from scipy.ndimage import spline_filter

        self.grid, self.shift = grid, shift
        # Where the shift is constant nothing is interpolated.
        self.still = float(np.ptp(shift.reshape(-1, 2), axis=0).max()) <= SAME_SHIFT
        # The scene, or its spline's coefficients, with a border that continues its edge; pixels to the picture's edge.
        ground = np.pad(scene, BORDER, mode="edge")
        self.ground = ground if self.still else spline_filter(ground, order=3, mode="mirror")
        self.edge = [(n - m) // 2 + BORDER for n, m in zip(scene.shape, shift.shape, strict=False)]
        # The kernels without rows and columns that are dark in all of them, and how many there are before the middle.
        lit = np.any(grid.kernel, axis=(0, 1))
        rows, columns = (np.flatnonzero(np.any(lit, axis=axis)) for axis in (1, 0))
        self.kernel = grid.kernel[..., rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        self.lead = [grid.kernel.shape[-1] // 2 - int(one[0]) for one in (rows, columns)]

    def lights(self, row: int, pixels: np.ndarray, across: list[Hat]):
        """Yield for each node of a row its number, and the scene blurred by its kernel at its pixels."""
        width = max(len(place) for place, _ in across)
        first = np.array([place[0] for place, _ in across])
        columns = np.minimum(first[:, None] + np.arange(width), self.shift.shape[1] - 1)
        node = self.shift[self.grid.rows[row], self.grid.columns]
        if self.still:
            guard, moved = 0, None
        else:
            # Nodes first, as a view: `_seen` copies the positions.
            near = np.take(self.shift[pixels[0] : pixels[-1] + 1], columns, axis=1)
            moved = np.moveaxis(near - node[:, None], 0, 1)
            moved = np.clip(moved, -GREATEST_CHANGE, GREATEST_CHANGE)
            guard = int(np.ceil(np.abs(moved).max())) + NEIGHBOURS
        size = self.kernel.shape[2:]
        counts = [n + 2 * guard + k - 1 for n, k in zip((len(pixels), width), size, strict=True)]
        stride = max(1, TOGETHER // (counts[0] * counts[1]))  # speed only
        for begin in range(0, len(across), stride):
            part = slice(begin, begin + stride)
            offset = self.grid.offset[row, part]
            spread = self._spread(
                self.kernel[row, part],
                pixels[0] - guard - self.lead[0] + self.edge[0] + offset[:, 0],
                first[part] - guard - self.lead[1] + self.edge[1] + offset[:, 1],
                counts,
            )
            light = spread if moved is None else _seen(spread, moved[part], guard)
            for number, one in enumerate(light):
                yield begin + number, one[:, : len(across[begin + number][0])]

    def _spread(self, kernel: np.ndarray, top: np.ndarray, left: np.ndarray, counts: list[int]) -> np.ndarray:
        """Correlate patches of the ground, from these rows and columns on, with kernels: shape (n, rows, columns)."""
        from scipy.fft import irfft2, next_fast_len, rfft2

        rows, columns = (
            np.clip(start[:, None] + np.arange(count), 0, most - 1)
            for start, count, most in zip((top, left), counts, self.ground.shape, strict=True)
        )
        patch = self.ground[rows[:, :, None], columns[:, None, :]]
        size = tuple(next_fast_len(count, real=True) for count in counts)
        transform = rfft2(patch, size)
        transform *= rfft2(kernel, size).conj()
        height, width = (n - k + 1 for n, k in zip(counts, kernel.shape[1:], strict=True))
        return np.asarray(irfft2(transform, size, overwrite_x=True)[:, :height, :width])


def _seen(coefficients: np.ndarray, moved: np.ndarray, guard: int) -> np.ndarray:
    """Evaluate splines with coefficients (n, rows + 2 guard, columns + 2 guard) at pixels moved by (x, y)."""
    from scipy.ndimage import map_coordinates

    count, rows, columns, _ = moved.shape
    height = coefficients.shape[1]
    # The patches are stacked vertically: no position is so near to the edge of its patch that the next one affects it.
    place = np.empty((2, count, rows, columns))
    place[0] = moved[..., 1] + (guard + height * np.arange(count)[:, None] + np.arange(rows))[..., None]
    place[1] = moved[..., 0] + (guard + np.arange(columns))
    stacked = coefficients.reshape(count * height, -1)
    return np.asarray(map_coordinates(stacked, place, order=3, mode="nearest", prefilter=False))
