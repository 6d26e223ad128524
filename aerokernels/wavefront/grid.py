"""The square grid of pixels that a wavefront has over its pupil."""

import numpy as np

from ..pupils import Mask, Pupil

PIXEL_COUNT = 128
# A pixel that the pupil covers less of is rounding.
LEAST_COVER = 1e-9


def pupil_grid(pupil: Pupil, pixel_count: int | None) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """The square grid that just holds a pupil.

    Returns:
        x and y of its pixels [m], shape (n,); their side [m]; in each of them mean amplitude and mean intensity,
        both of shape (n, n).

    Raises:
        ValueError: A pixel_count that is not a whole number of at least 2.
    """
    if pixel_count is None:
        pixel_count = PIXEL_COUNT
        if (
            isinstance(pupil, Mask)
            and np.ptp(np.broadcast_to(pupil.pixel, (2,))) == 0.0
            and max(pupil.weights.shape) > 1
        ):
            pixel_count = max(pupil.weights.shape)
    if not isinstance(pixel_count, (int, np.integer)) or pixel_count < 2:
        raise ValueError(f"pixel_count must be a whole number of at least 2, got {pixel_count!r}")
    half = max(pupil.half_extent)
    edges = np.linspace(-half, half, int(pixel_count) + 1)
    weight = pupil.coverage(edges, edges)
    weight[weight < LEAST_COVER * weight.max()] = 0.0
    intensity = np.where(weight > 0.0, pupil.coverage(edges, edges, 2), 0.0)
    return 0.5 * (edges[1:] + edges[:-1]), 2.0 * half / int(pixel_count), weight, intensity
