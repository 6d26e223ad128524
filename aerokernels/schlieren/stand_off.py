"""Measure the stand-off distance of a bow shock in a picture, with its standard error."""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from .fronts import LEAST_LINES, fit_curve, is_staircase, outer_fronts, smoothed
from .picture import PictureView

SIDES = ("right", "left")
# The body begins where the brightness stays below this share of the undisturbed air's for so many pixels.
DARK_SHARE, DARK_PIXELS = 0.2, 3
# Least distance of body and shock [pixels]: nearer ones are one edge, of a shock that is as dark as the body.
LEAST_APART = 2.0


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
    check_choice(upstream, "upstream", SIDES)
    if not (np.isfinite(half_height) and half_height > 0.0):
        raise ValueError(f"half_height = {half_height}: give a positive length in metres")
    rows = np.flatnonzero(np.abs(picture.vertical - axis) <= half_height)
    if rows.size < LEAST_LINES:
        raise ValueError(
            f"half_height = {half_height:g} m holds {rows.size} rows of pixels, at least {LEAST_LINES} are needed: "
            "raise it or take a finer picture"
        )
    step = -1 if upstream == "right" else 1
    plain = picture.intensity[rows, ::step]
    lines = smoothed(picture.intensity, smoothing)[rows, ::step]
    along = picture.horizontal[::step]
    pitch = float(along[1] - along[0])
    height = picture.vertical[rows] - axis
    places = outer_fronts(lines, level)
    shock, shock_error, shock_points = _on_axis(height, along[0] + pitch * places, abs(pitch), "shock", axis)
    shock_error = math.hypot(shock_error, abs(pitch) * _within_pixel(plain, places))
    if nose is not None:
        if not np.isfinite(nose):
            raise ValueError(f"nose = {nose}: give a position along the horizontal in metres")
        return StandOff(abs(shock - nose), shock_error, shock, float(nose), shock_points, np.empty((0, 2)))
    dark = DARK_SHARE * float(np.median(lines[:, 0]))
    edges = np.array([_dark_edge(line, dark, place) for line, place in zip(lines, places, strict=True)])
    tip, tip_error, nose_points = _on_axis(height, along[0] + pitch * edges, abs(pitch), "body", axis)
    tip_error = math.hypot(tip_error, abs(pitch) * _within_pixel(plain, edges))
    if abs(shock - tip) < LEAST_APART * abs(pitch):
        raise ValueError(
            f"the body at {tip:.4g} m begins where the shock does, at {shock:.4g} m: the shock is as dark as the body; "
            "take the knife edge from the other side, a weaker one, or give the nose"
        )
    return StandOff(abs(shock - tip), math.hypot(shock_error, tip_error), shock, tip, shock_points, nose_points)


def _within_pixel(lines: np.ndarray, places: np.ndarray) -> float:
    """Return the standard deviation of an edge that may be anywhere within a pixel [pixels]; 0 if shades tell where.

    About the axis the edge is almost along the pixels, so that all rows show the same pixel and scatter tells nothing.
    """
    known = np.isfinite(places)
    return math.sqrt(1.0 / 12.0) if is_staircase(lines[known], places[known]) else 0.0


def _on_axis(
    height: np.ndarray, found: np.ndarray, pitch: float, what: str, axis: float
) -> tuple[float, float, np.ndarray]:
    """Return the position on the axis of a curve through points, its standard error, and the points used."""
    try:
        curve, covariance, used = fit_curve(height, found, 2, 0.5 * pitch)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None
    points = np.stack([found[used], height[used] + axis], axis=1)
    return float(curve[0]), math.sqrt(covariance[0, 0]), points


def _dark_edge(line: np.ndarray, dark: float, start: float) -> float:
    """Return where a scan line, behind its shock, falls half way from the brightness before to the body's darkness."""
    if not np.isfinite(start):
        return np.nan
    low = line <= dark
    run = np.convolve(low, np.ones(DARK_PIXELS), mode="valid") == DARK_PIXELS
    candidates = np.flatnonzero(run[int(np.ceil(start)) + 1 :])
    if candidates.size == 0:
        return np.nan
    first = int(np.ceil(start)) + 1 + int(candidates[0])
    before = line[max(first - 3, 0) : first]
    half = 0.5 * (float(before.max(initial=0.0)) + float(line[first : first + DARK_PIXELS].mean()))
    after = first
    while after > 0 and line[after - 1] < half:
        after -= 1
    if after == 0 or line[after - 1] == line[after]:
        return np.nan
    return after - (half - line[after]) / (line[after - 1] - line[after])
