"""Measure the angle of a shock in a picture, with its standard error."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from .fronts import LEAST_LINES, fit_curve, inner_bands, is_staircase, outer_fronts, slope_error, smoothed
from .picture import Picture, PictureView

HALVES = ("upper", "lower", "both")
# Error by the width of a shock's edge over the change of the angle with half of the smoothing; smoothing that a picture
# without any is compared with [pixels].
EDGE_FACTOR, LEAST_WIDTH = 2.0, 0.5


@dataclass(frozen=True, eq=False)
class ShockAngle:
    """A shock measured in a picture.

    Attributes:
        angle: between the shock and the picture's horizontal [rad], positive.
        standard_error: of the angle, from the scatter of the points, from steps of a staircase of pixels, and from the
            width of the shock's edge [rad]; NaN if it is not known.
        place: position along the horizontal at which the angle holds [m].
        points: the shock on the scan lines that were used, (horizontal, vertical) [m], shape (n, 2).
        curve: coefficients of the fitted height above the axis against the distance from `place`, lowest power first
            [m, 1, 1/m]; with both halves, the mean of the two.
        residual_rms: scatter of the points about the curve [m].
        roll: rotation of the picture [rad], half the difference between the angles of the two halves; NaN with one
            half.
    """

    angle: float
    standard_error: float
    place: float
    points: np.ndarray
    curve: np.ndarray
    residual_rms: float
    roll: float = float("nan")


@checked
def measure_shock_angle(
    picture: PictureView,
    window: tuple[float, float],
    *,
    half: str = "upper",
    degree: int = 1,
    axis: float = 0.0,
    near: tuple[tuple[float, float], tuple[float, float]] | None = None,
    reach: float | None = None,
    level: float = 0.5,
    smoothing: float = 1.0,
) -> ShockAngle:
    """Measure the angle of a shock in a picture.

    Every column of pixels in the window is scanned from undisturbed air toward the axis; the outermost shock is where
    the brightness first departs from the air's (see `fronts.py`). With `near`, a shock inside the flow is measured: the
    strongest band near a given line. A straight line or a parabola is fitted; outliers are left out.

    The standard error is from the scatter of the points. In a synthetic picture with one ray per pixel an ideal shock
    is a staircase, which repeats along the whole window at slopes near simple ratios, such as 1/2 or 2/3: its error is
    then not in the scatter, and is added (see `staircase.py`; recognised up to a noise of a fifth of the shock's change
    of brightness). Pictures with several `rays_per_pixel` have a smaller error.

    A shock's edge is as wide as pixels, smoothing and the field's cells make it. Where the band behind it widens along
    the shock, as in a conical flow, its half height moves and turns the line. This error is added too: it is about
    proportional to the edge's width, and taken as twice the angle's change with half of the smoothing.

    Args:
        picture: a Picture or any of the synthetic pictures; a horizontal knife edge shows slanted shocks best.
        window: range along the horizontal [m].
        half: "upper" or "lower" half of the picture, or "both", which cancels a rotation of the picture.
        degree: 1 for a straight shock, 2 for a curved one: the angle is then that in the middle of the window.
        axis: height of the flow's axis in the picture [m].
        near: two points (horizontal, vertical) [m] of a line near a shock inside the flow; vertical from the axis, as
            in the upper half.
        reach: how far from that line to look [m]; needed with `near`.
        level: share of the band's height that defines its outer edge.
        smoothing: standard deviation of the Gaussian that smooths the picture [pixels]; 0 for none.

    Raises:
        ValueError: the window is outside the picture or too narrow, there is no shock in it, or an argument is out of
            range.
    """
    check_choice(half, "half", HALVES)
    if degree not in (1, 2):
        raise ValueError(f"degree = {degree!r}: give 1 (straight) or 2 (curved)")
    if (near is None) != (reach is None):
        raise ValueError("near and reach belong together: give both, or neither for the outermost shock")
    columns = columns_in(picture, window)

    seen = Picture(_without_body(picture), picture.horizontal, picture.vertical)

    def found_with(width: float) -> ShockAngle:
        brightness = smoothed(seen.intensity, width)
        halves = [
            _in_half(seen, brightness, columns, one, degree=degree, axis=axis, near=near, reach=reach, level=level)
            for one in (HALVES[:2] if half == "both" else (half,))
        ]
        return halves[0] if len(halves) == 1 else _mean_of(*halves)

    found = found_with(smoothing)
    error = math.hypot(found.standard_error, _edge_error(found.angle, found_with, smoothing))
    return replace(found, standard_error=error)


def _without_body(picture: PictureView) -> np.ndarray:
    """Return a picture's brightness with the nearest air's where a body is known to hide the light, shape (ny, nx).

    Its outline would else be a front, and where it is darker than the shock the only one.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt

    blocked = getattr(picture, "blocked", None)
    if blocked is None or not np.any(blocked):
        return picture.intensity
    hidden = binary_dilation(blocked, np.ones((3, 3)))  # pixels on the outline are darker too
    if hidden.all():
        return picture.intensity
    row, column = distance_transform_edt(hidden, return_distances=False, return_indices=True)
    return np.asarray(picture.intensity[row, column])


def _edge_error(angle: float, found_with: Callable[[float], ShockAngle], smoothing: float) -> float:
    """Return the error of an angle by the width of the shock's edge in the picture [rad]; NaN if it is not known."""
    for width in (0.5 * smoothing, 2.0 * smoothing) if smoothing > 0.0 else (LEAST_WIDTH,):
        try:
            return EDGE_FACTOR * abs(found_with(width).angle - angle)
        except ValueError:  # no front with this width, as in noise
            continue
    return math.nan


def _mean_of(up: ShockAngle, down: ShockAngle) -> ShockAngle:
    return ShockAngle(
        angle=0.5 * (up.angle + down.angle),
        standard_error=0.5 * math.hypot(up.standard_error, down.standard_error),
        place=up.place,
        points=np.concatenate([up.points, down.points]),
        curve=0.5 * (up.curve + down.curve),
        residual_rms=math.sqrt(0.5 * (up.residual_rms**2 + down.residual_rms**2)),
        roll=0.5 * float(np.arctan(up.curve[1]) - np.arctan(down.curve[1])),
    )


def _in_half(
    picture: Picture,
    brightness: np.ndarray,
    columns: np.ndarray,
    half: str,
    *,
    degree: int,
    axis: float,
    near: tuple[tuple[float, float], tuple[float, float]] | None,
    reach: float | None,
    level: float,
) -> ShockAngle:
    """Measure the shock in one half of a picture whose brightness was smoothed; the error is that of its points."""
    rows = np.flatnonzero(picture.vertical > axis if half == "upper" else picture.vertical < axis)
    if rows.size < 2 * LEAST_LINES:
        raise ValueError(
            f"axis = {axis:g} m leaves {rows.size} rows of pixels in the {half} half: is it in the picture?"
        )
    inwards = rows[::-1] if half == "upper" else rows
    scanned = np.ix_(inwards, columns)
    lines = brightness[scanned].T
    height = np.abs(picture.vertical[inwards] - axis)  # decreases from a line's start to its end
    pitch = float(height[0] - height[1])
    along = picture.horizontal[columns]
    if near is None:
        places = outer_fronts(lines, level)
    else:
        places = inner_bands(lines, (height[0] - _line_through(near, along)) / pitch, _checked_reach(reach) / pitch)
    middle, found = 0.5 * (along[0] + along[-1]), height[0] - pitch * places
    curve, covariance, used = fit_curve(along - middle, found, degree, 0.5 * pitch)
    rest = found[used] - np.vander(along[used] - middle, degree + 1, increasing=True) @ curve
    vertical = axis + (found if half == "upper" else -found)
    steps = 0.0
    if near is None and is_staircase(picture.intensity[scanned].T[used], places[used]):
        pixel_slope = pitch / float(along[1] - along[0])
        steps = pixel_slope * slope_error(curve[1] / pixel_slope, along.size)
    return ShockAngle(
        angle=abs(math.atan(curve[1])),
        standard_error=math.hypot(math.sqrt(covariance[1, 1]), steps) / (1.0 + curve[1] ** 2),
        place=float(middle),
        points=np.stack([along[used], vertical[used]], axis=1),
        curve=curve,
        residual_rms=float(np.sqrt(np.mean(rest**2))),
    )


def columns_in(picture: PictureView, window: tuple[float, float]) -> np.ndarray:
    """Return the indices of the pixel columns in a window [m].

    Raises:
        ValueError: the window does not increase, or has too few columns.
    """
    low, high = (float(end) for end in window)
    if not low < high:
        raise ValueError(f"window {window!r}: give from and to along the horizontal in metres, increasing")
    columns = np.flatnonzero((picture.horizontal >= low) & (picture.horizontal <= high))
    if columns.size < LEAST_LINES:
        raise ValueError(
            f"window {low:g} to {high:g} m holds {columns.size} columns of pixels, at least {LEAST_LINES} are needed: "
            f"the picture goes from {picture.horizontal[0]:g} to {picture.horizontal[-1]:g} m"
        )
    return columns


def _line_through(points, along: np.ndarray) -> np.ndarray:
    """Return the heights of the line through two points at the positions `along` [m]."""
    ends = np.asarray(points, dtype=np.float64)
    if ends.shape != (2, 2) or not np.isfinite(ends).all() or ends[0, 0] == ends[1, 0]:
        raise ValueError(
            f"near {points!r}: give two points (horizontal, vertical) in metres, at different horizontal positions"
        )
    slope = (ends[1, 1] - ends[0, 1]) / (ends[1, 0] - ends[0, 0])
    return ends[0, 1] + slope * (along - ends[0, 0])


def _checked_reach(reach: float | None) -> float:
    if reach is None or not (np.isfinite(reach) and reach > 0.0):
        raise ValueError(f"reach = {reach!r}: give a positive length in metres")
    return float(reach)
