"""Locate a shock on the scan lines of a picture with sub-pixel accuracy.

A scan line starts in undisturbed air. The front is where its brightness first departs from the air's: the outer half
height of the first band. A band inside a flow is the extremum near a line that the caller gives.
"""

import math

import numpy as np

LEAST_LINES = 8
# Share of the scan lines that must agree on one curve: a picture in which fewer do shows no clear shock there.
LEAST_AGREEING = 0.5
# Number of trial curves: through three points each, one in eight is free of outliers if half of all points are
# outliers.
TRIAL_COUNT = 300
# Share of each scan line, from its outer end, that is assumed undisturbed.
UNDISTURBED_SHARE = 0.05


def smoothed(intensity: np.ndarray, smoothing: float) -> np.ndarray:
    """Return the picture smoothed by a Gaussian of standard deviation `smoothing` [pixels]."""
    from scipy.ndimage import gaussian_filter

    if not (np.isfinite(smoothing) and smoothing >= 0.0):
        raise ValueError(f"smoothing = {smoothing}: give the standard deviation of a Gaussian in pixels, 0 for none")
    return gaussian_filter(intensity, smoothing) if smoothing > 0.0 else intensity


def outer_fronts(lines: np.ndarray, level: float) -> np.ndarray:
    """Return where each scan line (line_count, n) departs from the undisturbed brightness [samples], (line_count,).

    `level` is the share of the first band's height that defines the front. NaN if there is none, or if the line starts
    inside the band.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level}: give a share of the band's height between 0 and 1")
    undisturbed = lines[:, : max(3, round(UNDISTURBED_SHARE * lines.shape[1]))]
    background = float(np.median(undisturbed))
    noise = 1.4826 * float(np.median(np.abs(undisturbed - background)))
    change = lines - background
    least = max(6.0 * noise, 0.03 * float(np.quantile(np.abs(change).max(axis=1), 0.9)), 1e-6)
    return np.array([_outer_front(line, least, max(3.0 * noise, 0.02 * least), level) for line in change])


def _outer_front(change: np.ndarray, least: float, slack: float, level: float) -> float:
    above = np.flatnonzero(np.abs(change) >= least)
    if above.size == 0 or above[0] == 0:
        return np.nan
    first = int(above[0])
    height = change * np.sign(change[first])  # a dark body behind a bright band is not part of it
    # Up to the band's first maximum: the greatest value before the line decreases by more than the slack.
    greatest = np.maximum.accumulate(height[first:])
    down = np.flatnonzero(height[first:] < greatest - slack)
    summit = greatest[down[0]] if down.size else greatest[-1]
    sought = level * summit
    after = int(np.argmax(height >= sought))
    if after == 0:
        return np.nan
    return after - (height[after] - sought) / (height[after] - height[after - 1])


def inner_bands(lines: np.ndarray, guess: np.ndarray, reach: float) -> np.ndarray:
    """Return where the strongest band of each scan line is, within `reach` of a guess [samples], shape (line_count,).

    NaN if there is no maximum or minimum within reach and picture.
    """
    from scipy.signal import find_peaks

    result = np.full(len(lines), np.nan)
    for k, (line, middle) in enumerate(zip(lines, guess, strict=True)):
        low, high = max(int(np.ceil(middle - reach)), 0), min(int(np.floor(middle + reach)), line.size - 1)
        if high - low < 4:
            continue
        part = line[low : high + 1]
        tops = []
        for sign in (1.0, -1.0):
            places, properties = find_peaks(sign * part, prominence=1e-6)
            tops += [(prominence, sign, top) for top, prominence in zip(places, properties["prominences"], strict=True)]
        if tops:
            _, sign, top = max(tops)
            before, at, after = sign * part[top - 1 : top + 2]
            bend = before - 2.0 * at + after
            result[k] = low + top + (0.5 * (before - after) / bend if bend < 0.0 else 0.0)
    return result


def fit_curve(
    along: np.ndarray, across: np.ndarray, degree: int, floor: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit a polynomial of a degree to front points without outliers; `across` is NaN where a scan line has no front.

    Returns coefficients, lowest power first, their covariance, and a mask of the points used. Residuals up to `floor`
    never make an outlier. The errors allow for correlated neighbours: with the residuals' correlation rho from one
    point to the next they grow by sqrt((1 + rho) / (1 - rho)).
    """
    from scipy.optimize import least_squares

    used = np.isfinite(across)
    least = max(LEAST_LINES, math.ceil(LEAST_AGREEING * along.size))
    powers = np.vander(along, degree + 1, increasing=True)
    if used.sum() >= least:
        # Points on another edge must not attract the curve, even if they are together at one end: first the curve that
        # most points are close to, then least absolute deviations of the points that may belong to it.
        scale = np.abs(powers).max(axis=0)
        start, reach = _most_agreed(powers[used] / scale, across[used])
        near = used & (np.abs(np.where(used, across, 0.0) - powers / scale @ start) <= max(4.0 * reach, 2.0 * floor))
        robust = least_squares(
            lambda c: powers[near] / scale @ c - across[near], start, loss="soft_l1", f_scale=0.2 * floor, x_scale=floor
        )
        residual = across - powers / scale @ robust.x
        spread = 1.4826 * float(np.median(np.abs(residual[near])))
        used = np.isfinite(residual) & (np.abs(residual) <= max(4.0 * spread, 2.0 * floor))
    for _ in range(10):
        if used.sum() < least:
            raise ValueError(
                f"{int(used.sum())} of {along.size} scan lines show one front, {least} are needed: move the "
                "window to where the shock is clear and in the picture, or change knife edge, smoothing or sensitivity"
            )
        coefficients = np.linalg.lstsq(powers[used], across[used], rcond=None)[0]
        residual = across - powers @ coefficients
        spread = 1.4826 * float(np.median(np.abs(residual[used])))
        kept = np.isfinite(residual) & (np.abs(residual) <= max(4.0 * spread, floor))
        if (kept == used).all():
            break
        used = kept
    scatter = residual[used]
    variance = float(scatter @ scatter) / (scatter.size - degree - 1)
    rho = float(scatter[1:] @ scatter[:-1] / (scatter @ scatter)) if variance > 0.0 else 0.0
    rho = min(max(rho, 0.0), 0.98)
    inverse = np.linalg.inv(powers[used].T @ powers[used])
    return coefficients, inverse * variance * (1.0 + rho) / (1.0 - rho), used


def _most_agreed(powers: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the curve through a few points that `LEAST_AGREEING` of all points are closest to, and their distance.

    P. Rousseeuw, Least median of squares regression, J. Am. Stat. Assoc. 79 (1984).
    """
    count, size = powers.shape
    random = np.random.default_rng(0)
    draws = random.random((TRIAL_COUNT, count)).argpartition(size, axis=1)[:, :size]
    corners = powers[draws]
    draws = draws[np.linalg.cond(corners) < 1e8]
    curves = np.linalg.solve(powers[draws], across[draws][..., None])[..., 0]
    distance = np.quantile(np.abs(across - curves @ powers.T), LEAST_AGREEING, axis=1)
    best = int(np.argmin(distance))
    return curves[best], float(distance[best])


# The greatest step from pixel to pixel as a share of the brightness range around the front, above which the edge is
# taken for a staircase: 1 without noise, where nothing is between the two sides, and less by the noise, which widens
# the range by more than the step. It is 0.75 where pixels see areas.
STAIRCASE_SHARE, SHARE_OF_NOISE = 0.98, 3.0
MOST = 0.25  # of the lines may have something in between by noise
AROUND = 3  # pixels on each side of a front that are compared


def is_staircase(lines: np.ndarray, places: np.ndarray) -> bool:
    """Return whether the fronts of most scan lines, not smoothed, jump from one pixel to the next."""
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
