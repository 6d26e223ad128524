r"""Weights of pixels by which a sum over a map is the mean over the pupil to second order in the pixels' side.

A map has one sample at each pixel's centre. A pixel on the edge of a pupil counts by the share w of it that is inside,
with the value at the pixel's centre; but the centroid of that share is elsewhere. To second order in the pixel's side
the mean of a function f over the share is

    f + m_x f_x + m_y f_y + (m_xx f_xx + m_yy f_yy) / 2,

with m_x ... the moments of the share about the pixel's centre. With derivatives taken from the neighbours inside the
pupil, one-sided at its edge, this is again a sum over the pixels, with other weights: `exact_weights`. They differ from
the shares near the edge only, since inside the second differences of equal moments cancel. The difference between a
quantity with either weights is its error due to the pixels, up to third order.
"""

import numpy as np

from ..pupils import Projected, Pupil
from .stencils import derivative_weights

# Subdivisions of a pixel's side over which its moments are summed; fewer for fine maps, whose moments matter less.
PARTS, MOST_CELLS = 4, 1024
# Error over the second-order deficit of the shares: the third order is left out.
SAFETY = 2.0


def exact_weights(weight: np.ndarray, pixel: float, pupil: Pupil | Projected | None) -> np.ndarray:
    """Return weights by which a sum over pixels is the mean over the pupil to second order in the pixels' side.

    Args:
        weight: The pixels' shares of the pupil, 0 outside of it and where there is no sample, shape (ny, nx): weights
            that are exact to first order inside the pupil.
        pixel: Side of a pixel [m]; the map's middle is the pupil's centre.
        pupil: The pupil; None means that every pixel is wholly inside it.

    Returns:
        Weights with the same sum, shape (ny, nx); those of slivers of a pixel may be negative.
    """
    lit = weight > 0.0
    found = weight.astype(np.float64)
    for axis, (first, second) in enumerate(_moments(weight, pixel, pupil)):
        found += derivative_weights(lit, first, second, axis)
    return found


def _moments(weight: np.ndarray, pixel: float, pupil: Pupil | Projected | None) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return first and second moments of the shares about the pixels' centres, in pixels, along y and along x."""
    inside = weight / 12.0
    if pupil is None:
        return [(np.zeros_like(inside), inside)] * 2
    parts = max(2, min(PARTS, MOST_CELLS // max(weight.shape)))
    rows, columns = weight.shape
    edges = [pixel / parts * (np.arange(count * parts + 1) - 0.5 * count * parts) for count in (columns, rows)]
    shares = pupil.coverage(*edges).reshape(rows, parts, columns, parts)
    share = shares.sum(axis=(1, 3))
    scale = np.divide(weight, share, out=np.zeros_like(share), where=share > 0.0)
    place = (np.arange(parts) - 0.5 * (parts - 1)) / parts
    found = []
    for along in (shares.sum(axis=3), shares.sum(axis=1).transpose(0, 2, 1)):
        first, second = (np.einsum("rpc,p->rc", along, moment) for moment in (place, place**2))
        # Plus the second moment of a subdivision about its own middle.
        found.append((scale * first, scale * (second + share / (12.0 * parts**2))))
    return found
