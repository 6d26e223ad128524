r"""Bound the error of a slope that is measured from a staircase of pixels, where the scatter does not show it.

In a picture that is sampled at points, an ideal edge of slope s (in pixels) is found at whole pixels only. Near a ratio
p / q its steps repeat after q columns, and the edge may move by 1 / q of a pixel without any change of the picture: a
sawtooth of that height, with n q |s - p / q| teeth in n columns. Fewer teeth than one look like a slope. So the fitted
slope is off by up to

    max over q < n of  1 / (n q) min(1, 1 / (n q |s - p / q|)),      p = the nearest whole number to s q

which is less the more teeth there are. It is taken as a uniform distribution: its standard deviation is the bound over
the square root of 3. (A. Rosenfeld, Digital straight line segments, IEEE Trans. Comput. C-23 (1974) 1264, on which
slopes have one staircase.)
"""

import numpy as np

from .fronts import UNDISTURBED_SHARE

# The greatest step from pixel to pixel as a share of the brightness range around the front, above which the edge is
# taken for a staircase: 1 without noise, where nothing is between the two sides, and less by the noise, which widens
# the range by more than the step. It is 0.75 where pixels see areas.
STAIRCASE_SHARE, SHARE_OF_NOISE = 0.98, 3.0
MOST = 0.25  # of the lines may have something in between by noise
AROUND = 3  # pixels on each side of a front that are compared


def is_staircase(lines: np.ndarray, places: np.ndarray) -> bool:
    """Return whether the fronts of most scan lines jump from one pixel to the next, with nothing in between.

    Args:
        lines: Brightness along the scan lines, not smoothed, shape (line_count, n).
        places: Position of the front on each line [samples], shape (line_count,).
    """
    middle = np.clip(np.rint(places).astype(np.int64), AROUND, max(lines.shape[1] - 1 - AROUND, AROUND))
    around = np.minimum(middle[:, None] + np.arange(-AROUND, AROUND + 1), lines.shape[1] - 1)
    values = np.take_along_axis(lines, around, axis=1)
    steps, extent = np.abs(np.diff(values, axis=1)).max(axis=1), np.ptp(values, axis=1)
    share = steps / np.where(extent > 0.0, extent, np.inf)
    undisturbed = lines[:, : max(3, round(UNDISTURBED_SHARE * lines.shape[1]))]
    noise = 1.4826 * float(np.median(np.abs(undisturbed - np.median(undisturbed))))
    least = STAIRCASE_SHARE - SHARE_OF_NOISE * noise / max(float(np.median(extent)), 1e-300)
    return bool(np.quantile(share, MOST) > least)


def slope_error(slope: float, count: int) -> float:
    """Return the standard deviation of a slope [pixels per pixel] that `count` columns of a staircase leave unseen."""
    period = np.arange(1, max(count, 2))
    teeth = count * np.abs(slope * period - np.rint(slope * period))
    bound = np.max(np.minimum(1.0, 1.0 / np.maximum(teeth, 1e-300)) / (period * count))
    return float(bound / np.sqrt(3.0))
