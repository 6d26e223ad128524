"""How the width of a source blurs a shadowgraph: the mean over the source's image, moved about every pixel.

A source that subtends the angle a moves the shadow of a flow at the distance L by up to a L / 2 either way, so the
picture is folded with the source's shape of the size a L. The shape is laid on the pixels by the area that it covers of
each, and is taken so much wider or narrower that the weights have the shape's own variance along either axis: the blur
is then exact to fourth order in the pixel's size, also where the source's image is smaller than a pixel.
"""

import numpy as np

from ..pupils import Disc, Rectangle

# Halvings of a pixel in the search for the size whose weights have the right variance.
HALVINGS = 50


def blurred(irradiance: np.ndarray, source: str, size: float, pitch: tuple[float, float]) -> np.ndarray:
    """A picture folded with the image of a source.

    Args:
        irradiance: The picture, shape (ny, nx).
        source: "disc", "square", or "slit", which has a width along the picture's horizontal and none along its
            vertical.
        size: Width of the source's image, or a disc's diameter [m].
        pitch: Distance of the pixels along the horizontal and the vertical [m].
    """
    from scipy.ndimage import convolve, convolve1d

    lines = [_fitted(source, 0.5 * size, step) for step in pitch]
    if source != "disc":
        across = convolve1d(irradiance, _weights("square", *lines[0]), axis=1, mode="nearest")
        if source == "slit":
            return np.asarray(across)
        return np.asarray(convolve1d(across, _weights("square", *lines[1]), axis=0, mode="nearest"))
    edges = [_edges(half) / half for half, _ in ((half / step, step) for half, step in lines)]
    disc = Disc(1.0).coverage(edges[0], edges[1]) * np.multiply.outer(np.diff(edges[1]), np.diff(edges[0]))
    return np.asarray(convolve(irradiance, disc / disc.sum(), mode="nearest"))


def _fitted(source: str, half: float, step: float) -> tuple[float, float]:
    """Half the size that the source's image is drawn with along an axis of pixels [m], and their distance [m]."""
    wanted = half**2 / (4.0 if source == "disc" else 3.0)
    low, high = max(half - step, 1e-6 * step), half + step
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        weights = _weights(source, middle, step)
        place = step * (np.arange(len(weights)) - len(weights) // 2)
        low, high = (middle, high) if float(weights @ place**2) < wanted else (low, middle)
    return 0.5 * (low + high), step


def _weights(source: str, half: float, step: float) -> np.ndarray:
    """Shares of the source's light that fall on the pixels of one axis, the middle one at its centre; they sum to 1."""
    edges = _edges(half / step) * step
    shape = Disc(half) if source == "disc" else Rectangle(2.0 * half, 2.0 * half)
    weights = shape.coverage(edges, np.array([-half, half]))[0]
    return np.asarray(weights / weights.sum())


def _edges(half: float) -> np.ndarray:
    """Edges of the pixels about a centre that a half width reaches, in pixels."""
    count = int(np.ceil(half - 0.5 + 1e-9)) if half > 0.5 else 0
    return np.arange(-count - 0.5, count + 1.0)
