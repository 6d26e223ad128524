"""Square grid of pixels of a wavefront over its pupil."""

import numpy as np

from ..inputs.checks import check_count
from ..process.machine import free_memory
from ..pupils import Mask, Projected, Pupil

PIXEL_COUNT = 128
# A pixel whose covered share is below this share of the greatest one is dropped: it is rounding.
LEAST_COVER = 1e-9
# Memory of a pixel at least [bytes]: a few numbers in double precision while its cover is computed.
PIXEL_MEMORY = 64


def pupil_grid(pupil: Pupil | Projected, pixel_count: int | None) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Return the smallest square grid that holds a pupil.

    Returns:
        Coordinates of the pixels along x and y [m], shape (n,); side of a pixel [m]; mean amplitude and mean intensity
        of each pixel, both of shape (n, n).

    Raises:
        ValueError: `pixel_count` is not a whole number of at least 2, or needs more memory than is free.
    """
    if pixel_count is None:
        pixel_count = PIXEL_COUNT
        if isinstance(pupil, Mask) and np.ptp(pupil.pixel) == 0.0 and max(pupil.weights.shape) > 1:
            pixel_count = max(pupil.weights.shape)
    pixel_count, half = check_count(pixel_count, "pixel_count", 2), max(pupil.half_extent)
    if (memory := PIXEL_MEMORY * pixel_count**2) > free_memory():
        raise ValueError(f"pixel_count = {pixel_count} needs {memory / 2**30:.1f} GiB or more: take a smaller one")
    edges = np.linspace(-half, half, pixel_count + 1)
    weight = pupil.coverage(edges, edges)
    weight[weight < LEAST_COVER * weight.max()] = 0.0
    intensity = np.where(weight > 0.0, pupil.coverage(edges, edges, 2), 0.0)
    return 0.5 * (edges[1:] + edges[:-1]), 2.0 * half / pixel_count, weight, intensity
