r"""What a mean over the pixels of a map lacks, since each of them was sampled at its centre only.

A pixel on the edge of a pupil counts by the share w of it that lies inside, with the value at the pixel's centre; that
share has its centroid elsewhere, and its value is not that at the centroid. To second order in the pixel's side the
mean over the share is

    f + m_x f_x + m_y f_y + (m_xx f_xx + m_yy f_yy) / 2,

m_x ... the moments of the share about the pixel's centre. With derivatives from the neighbours that are in the pupil,
one-sided at its edge, this is again a sum over the pixels, of other weights: `exact_weights`. They differ from the
shares near the edge only, since second differences of equal moments add up to nothing inside. The difference of a
number by both weights is what its pixels make it off by, up to third order.
"""

import numpy as np

from ..pupils import Pupil

# Parts of a pixel's side that its moments are summed over; fewer of fine maps, whose moments matter less.
PARTS, MOST_CELLS = 4, 1024
# Derivatives from the pixels at these places, in pixels: of first and second order at place 0. Those from both sides,
# then one-sided ones by three pixels and by two.
STENCILS = (
    {-1: (-0.5, 1.0), 0: (0.0, -2.0), 1: (0.5, 1.0)},
    {0: (-1.5, 1.0), 1: (2.0, -2.0), 2: (-0.5, 1.0)},
    {0: (1.5, 1.0), -1: (-2.0, -2.0), -2: (0.5, 1.0)},
    {0: (-1.0, 0.0), 1: (1.0, 0.0)},
    {0: (1.0, 0.0), -1: (-1.0, 0.0)},
)
REACH = 2


def exact_weights(weight: np.ndarray, pixel: float, pupil: Pupil | None) -> np.ndarray:
    """Weights by which a sum over pixels is the mean over the pupil to second order in the pixels' side.

    Args:
        weight: Those by which it is so to first order inside: the pixels' shares of the pupil, 0 outside of it and
            where there is no sample, shape (ny, nx).
        pixel: Side of a pixel [m]; the map's middle is the pupil's centre.
        pupil: The pupil; None takes every pixel to lie wholly within it.

    Returns:
        Weights of the same sum, shape (ny, nx); those of slivers of a pixel may be below 0.
    """
    lit = weight > 0.0
    found = weight.astype(np.float64)
    for axis, (first, second) in enumerate(_moments(weight, pixel, pupil)):
        found += derivative_weights(lit, first, second, axis)
    return found


def _moments(weight: np.ndarray, pixel: float, pupil: Pupil | None) -> list[tuple[np.ndarray, np.ndarray]]:
    """First and second moments of the shares about the pixels' centres, in pixels, along y and along x."""
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
        # A part spreads about its own middle too.
        found.append((scale * first, scale * (second + share / (12.0 * parts**2))))
    return found


def derivative_weights(lit: np.ndarray, first: np.ndarray, second: np.ndarray, axis: int) -> np.ndarray:
    """The weights that a sum of derivatives along an axis, by these moments, gives to the pixels.

    Args:
        lit: Which pixels there are, shape (ny, nx).
        first: Factors of the first derivatives [pixels], of the same shape.
        second: Twice those of the second derivatives.
        axis: The axis.
    """
    lit, first, second = (np.pad(array, REACH) for array in (lit, first, second))
    free, found = lit.copy(), np.zeros(lit.shape)
    for stencil in STENCILS:
        taken = free.copy()
        for place in stencil:
            taken &= np.roll(lit, -place, axis)
        free &= ~taken
        for place, (slope, bend) in stencil.items():
            found += np.roll(np.where(taken, slope * first + 0.5 * bend * second, 0.0), place, axis)
    return found[REACH:-REACH, REACH:-REACH]
