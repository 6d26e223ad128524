"""Measure the angle of a shock, or the stand-off distance of a bow shock, in a picture, with its standard error."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from .fronts import LEAST_LINES, fit_curve, inner_bands, is_staircase, outer_fronts, slope_error, smoothed
from .picture import Picture, PictureView


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
    the brightness first departs from the air's. With `near`, a shock inside the flow is measured: the strongest band
    near a given line. A straight line or a parabola is fitted; outliers are left out.

    The standard error is from the scatter of the points; from the staircase that an ideal shock is with one ray per
    pixel, which repeats at slopes such as 1/2; and from the width of the shock's edge, twice the angle's change with
    half of the smoothing.

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
    check_choice(half, "half", ("upper", "lower", "both"))
    if degree not in (1, 2):
        raise ValueError(f"degree = {degree!r}: give 1 (straight) or 2 (curved)")
    if (near is None) != (reach is None):
        raise ValueError("near and reach belong together: give both, or neither for the outermost shock")
    if reach is not None and not (np.isfinite(reach) and reach > 0.0):
        raise ValueError(f"reach = {reach!r}: give a positive length in metres")
    low, high = (float(end) for end in window)
    if not low < high:
        raise ValueError(f"window {window!r}: give from and to along the horizontal in metres, increasing")
    columns = np.flatnonzero((picture.horizontal >= low) & (picture.horizontal <= high))
    if columns.size < LEAST_LINES:
        raise ValueError(
            f"window {low:g} to {high:g} m holds {columns.size} columns of pixels, at least {LEAST_LINES} are needed: "
            f"the picture goes from {picture.horizontal[0]:g} to {picture.horizontal[-1]:g} m"
        )
    seen = Picture(_without_body(picture), picture.horizontal, picture.vertical)

    def found_with(width: float) -> ShockAngle:
        brightness = smoothed(seen.intensity, width)
        halves = [
            _in_half(seen, brightness, columns, one, degree=degree, axis=axis, near=near, reach=reach, level=level)
            for one in (("upper", "lower") if half == "both" else (half,))
        ]
        if len(halves) == 1:
            return halves[0]
        up, down = halves
        return ShockAngle(
            angle=0.5 * (up.angle + down.angle),
            standard_error=0.5 * math.hypot(up.standard_error, down.standard_error),
            place=up.place,
            points=np.concatenate([up.points, down.points]),
            curve=0.5 * (up.curve + down.curve),
            residual_rms=math.sqrt(0.5 * (up.residual_rms**2 + down.residual_rms**2)),
            roll=0.5 * float(np.arctan(up.curve[1]) - np.arctan(down.curve[1])),
        )

    result = found_with(smoothing)
    error = math.hypot(result.standard_error, _edge_error(result.angle, found_with, smoothing))
    return replace(result, standard_error=error)


def _without_body(picture: PictureView) -> np.ndarray:
    """Return a picture's brightness with the nearest air's where a body is known to hide the light, shape (ny, nx)."""
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
    for width in (0.5 * smoothing, 2.0 * smoothing) if smoothing > 0.0 else (0.5,):
        try:
            return 2.0 * abs(found_with(width).angle - angle)
        except ValueError:  # no front with this width, as in noise
            continue
    return math.nan


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
    if near is None or reach is None:
        places = outer_fronts(lines, level)
    else:
        places = inner_bands(lines, (height[0] - _line_through(near, along)) / pitch, reach / pitch)
    middle, result = 0.5 * (along[0] + along[-1]), height[0] - pitch * places
    curve, covariance, used = fit_curve(along - middle, result, degree, 0.5 * pitch)
    scatter = result[used] - np.vander(along[used] - middle, degree + 1, increasing=True) @ curve
    vertical = axis + (result if half == "upper" else -result)
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
        residual_rms=float(np.sqrt(np.mean(scatter**2))),
    )


def _line_through(points, along: np.ndarray) -> np.ndarray:
    """Return the heights of the line through two points at the positions `along` [m]."""
    ends = np.asarray(points, dtype=np.float64)
    if ends.shape != (2, 2) or not np.isfinite(ends).all() or ends[0, 0] == ends[1, 0]:
        raise ValueError(
            f"near {points!r}: give two points (horizontal, vertical) in metres, at different horizontal positions"
        )
    slope = (ends[1, 1] - ends[0, 1]) / (ends[1, 0] - ends[0, 0])
    return ends[0, 1] + slope * (along - ends[0, 0])


@dataclass(frozen=True, eq=False)
class StandOff:
    """A bow shock and the nose behind it, measured in a picture.

    Attributes:
        distance: from the nose to the shock on the flow's axis [m].
        standard_error: from the scatter of the points, and from edges that jump from pixel to pixel [m].
        shock: position of the shock on the axis [m].
        nose: position of the nose on the axis [m].
        shock_points: the shock on the scan lines used, (horizontal, vertical) [m], shape (n, 2).
        nose_points: the body's edge on those lines, shape (m, 2); empty if the nose was given.
    """

    distance: float
    standard_error: float
    shock: float
    nose: float
    shock_points: np.ndarray
    nose_points: np.ndarray


@checked
def measure_stand_off(
    picture: PictureView,
    half_height: float,
    *,
    axis: float = 0.0,
    upstream: str = "right",
    nose: float | None = None,
    level: float = 0.5,
    smoothing: float = 0.5,
) -> StandOff:
    """Measure the stand-off distance of a detached shock in a picture.

    The rows of pixels around the axis are scanned from upstream: the shock is where the brightness first departs from
    the undisturbed air's, the body where it becomes dark permanently. Parabolas through both give their positions on
    the axis. The shock must not be as dark as the body: with a vertical knife edge, choose the side that makes it
    bright.

    Args:
        picture: a Picture or any of the synthetic pictures.
        half_height: rows up to this distance from the axis are used [m]; less than the nose's radius of curvature.
        axis: height of the flow's axis in the picture [m].
        upstream: side from which the flow comes, "right" (as in pictures along x) or "left".
        nose: position of the nose along the horizontal [m], if it is known; None measures it in the picture.
        level: share of the band's height that defines its outer edge.
        smoothing: standard deviation of the Gaussian that smooths the picture [pixels]; 0 for none.

    Raises:
        ValueError: too few rows, no shock or no body on them, a shock as dark as the body, or an argument out of range.
    """
    check_choice(upstream, "upstream", ("right", "left"))
    if not (np.isfinite(half_height) and half_height > 0.0):
        raise ValueError(f"half_height = {half_height}: give a positive length in metres")
    rows = np.flatnonzero(np.abs(picture.vertical - axis) <= half_height)
    if rows.size < LEAST_LINES:
        raise ValueError(
            f"half_height = {half_height:g} m holds {rows.size} rows of pixels, at least {LEAST_LINES} are needed: "
            "raise it or take a finer picture"
        )
    step = -1 if upstream == "right" else 1
    lines = smoothed(picture.intensity, smoothing)[rows, ::step]
    places = outer_fronts(lines, level)
    shock, shock_error, shock_points = _on_axis(picture, rows, axis, step, places, "shock")
    if nose is not None:
        if not np.isfinite(nose):
            raise ValueError(f"nose = {nose}: give a position along the horizontal in metres")
        return StandOff(abs(shock - nose), shock_error, shock, float(nose), shock_points, np.empty((0, 2)))
    dark = 0.2 * float(np.median(lines[:, 0]))
    edges = np.array([_dark_edge(line, dark, place) for line, place in zip(lines, places, strict=True)])
    tip, tip_error, nose_points = _on_axis(picture, rows, axis, step, edges, "body")
    if abs(shock - tip) < 2.0 * float(picture.horizontal[1] - picture.horizontal[0]):
        raise ValueError(
            f"the body at {tip:.4g} m begins where the shock does, at {shock:.4g} m: the shock is as dark as the body; "
            "take the knife edge from the other side, a weaker one, or give the nose"
        )
    return StandOff(abs(shock - tip), math.hypot(shock_error, tip_error), shock, tip, shock_points, nose_points)


def _on_axis(
    picture: PictureView, rows: np.ndarray, axis: float, step: int, places: np.ndarray, what: str
) -> tuple[float, float, np.ndarray]:
    """Return the position on the axis of a parabola through an edge at places on rows, its error, and points used [m].

    About the axis the edge is almost along the pixels: where no shades tell, all rows show the same pixel, and the edge
    may be anywhere within it.
    """
    along, height = picture.horizontal[::step], picture.vertical[rows] - axis
    pitch, known = float(along[1] - along[0]), np.isfinite(places)
    result = along[0] + pitch * places
    try:
        curve, covariance, used = fit_curve(height, result, 2, 0.5 * abs(pitch))
    except ValueError as fault:
        raise ValueError(f"{what}: {fault}") from None
    steps = is_staircase(picture.intensity[rows, ::step][known], places[known])
    error = math.hypot(math.sqrt(covariance[0, 0]), abs(pitch) * math.sqrt(1.0 / 12.0) * steps)
    return float(curve[0]), error, np.stack([result[used], height[used] + axis], axis=1)


def _dark_edge(line: np.ndarray, dark: float, start: float) -> float:
    """Return where a scan line, behind its shock, falls half way from the brightness before to the body's darkness."""
    if not np.isfinite(start):
        return np.nan
    low, dark_pixels = line <= dark, 3  # where it stays dark for so many, the body begins
    run = np.convolve(low, np.ones(dark_pixels), mode="valid") == dark_pixels
    candidates = np.flatnonzero(run[int(np.ceil(start)) + 1 :])
    if candidates.size == 0:
        return np.nan
    first = int(np.ceil(start)) + 1 + int(candidates[0])
    before = line[max(first - 3, 0) : first]
    half = 0.5 * (float(before.max(initial=0.0)) + float(line[first : first + dark_pixels].mean()))
    after = first
    while after > 0 and line[after - 1] < half:
        after -= 1
    if after == 0 or line[after - 1] == line[after]:
        return np.nan
    return after - (half - line[after]) / (line[after - 1] - line[after])
