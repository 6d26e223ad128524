"""Blur of a shadowgraph by the width of its source: convolution with the source's image.

A source that subtends the angle a moves the shadow of a flow at the distance L by up to a L / 2 to either side, so the
picture is convolved with the source's shape, scaled to the size a L. The weight of each pixel is the area that the
shape covers of it. The shape's size is adjusted such that the weights have the shape's own variance along both axes:
the blur is then exact to fourth order in the pixel's size, also if the source's image is smaller than a pixel.
"""

import numpy as np

from ..pupils import Pupil, Rectangle
from .source_shape import light_in, shape_of

# Bisections in the search for the size whose weights have the right variance; cells across a shape that give its
# variance.
HALVINGS, CELLS = 50, 1024


def blurred(irradiance: np.ndarray, source: str | Pupil, size: float, pitch: tuple[float, float]) -> np.ndarray:
    """Convolve a picture with the image of a source.

    Args:
        irradiance: The picture, shape (ny, nx).
        source: A shape as in source_shape.py, its first axis along the picture's horizontal; a slit has no width along
            the vertical.
        size: Width of the source's image along the horizontal [m]; negative if it is inverted.
        pitch: Spacing of the pixels along the horizontal and the vertical [m].
    """
    from scipy.ndimage import convolve, convolve1d

    shape = shape_of(source)
    if shape is None:
        slit = Rectangle(2.0, 2.0)
        edges, _ = _fitted(slit, 0, 0.5 * abs(size), pitch[0])
        weights = light_in(slit, edges, np.array([-1.0, 1.0]))[0]
        return np.asarray(convolve1d(irradiance, weights / weights.sum(), axis=1, mode="nearest"))
    scale = abs(size) / (2.0 * shape.half_extent[0])
    drawn = [_fitted(shape, axis, scale * shape.half_extent[axis], pitch[axis]) for axis in (0, 1)]
    if isinstance(shape, Rectangle):  # separable
        across, along = (light / light.sum() for _, light in drawn)
        picture = convolve1d(irradiance, across, axis=1, mode="nearest")
        return np.asarray(convolve1d(picture, along, axis=0, mode="nearest"))
    weights = light_in(shape, drawn[0][0], drawn[1][0])
    if size < 0.0:
        weights = weights[::-1, ::-1]
    return np.asarray(convolve(irradiance, weights / weights.sum(), mode="nearest"))


def _fitted(shape: Pupil, axis: int, half: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges of pixels along an axis of a shape, in its units, and the light between them.

    The shape is scaled such that this light has the shape's own mean square distance from its centre.

    Args:
        shape: The shape.
        axis: 0 for its first axis, 1 for its second.
        half: Half the size of the source's image [m].
        step: Spacing of the pixels [m].
    """
    reach = shape.half_extent[axis]
    fine = np.linspace(-reach, reach, CELLS + 1)
    light = _along(shape, axis, fine)
    cell = fine[1] - fine[0]
    square = float(light @ ((0.5 * (fine[1:] + fine[:-1])) ** 2 + cell**2 / 12.0) / light.sum())
    wanted = square * (half / reach) ** 2
    low, high = max(half - step, 1e-6 * step), half + step
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        edges = _edges(middle / step) * step
        weights = _along(shape, axis, edges * reach / middle)
        place = 0.5 * (edges[1:] + edges[:-1])
        low, high = (middle, high) if float(weights @ place**2) < wanted * weights.sum() else (low, middle)
    return edges * reach / middle, weights


def _along(shape: Pupil, axis: int, edges: np.ndarray) -> np.ndarray:
    """Return the light of a shape between positions along one of its axes."""
    reach = shape.half_extent[1 - axis]
    ends = np.array([-reach, reach])
    return np.ravel(light_in(shape, edges, ends) if axis == 0 else light_in(shape, ends, edges))


def _edges(half: float) -> np.ndarray:
    """Return the edges of the pixels that a half width about a centre reaches, in pixels."""
    count = int(np.ceil(half - 0.5 + 1e-9)) if half > 0.5 else 0
    return np.arange(-count - 0.5, count + 1.0)
