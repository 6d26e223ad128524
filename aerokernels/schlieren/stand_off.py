"""The stand-off distance of a bow shock, read off a picture with its standard error."""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.checks import check_choice
from .fronts import LEAST_LINES, fit_curve, outer_fronts, smoothed
from .picture import AnyPicture

SIDES = ("right", "left")
# The body begins where the brightness stays below this share of undisturbed air for so many pixels.
DARK_SHARE, DARK_PIXELS = 0.2, 3


@dataclass(frozen=True, eq=False)
class StandOff:
    """A bow shock and the nose behind it, as they were read off a picture.

    Attributes:
        distance: from the nose to the shock on the flow's axis [m].
        standard_error: from the scatter of the points [m].
        shock: place of the shock on the axis [m].
        nose: place of the nose on the axis [m].
        shock_points: the shock on the scan lines used, (horizontal, vertical) [m], shape (n, 2).
        nose_points: the body's edge on them, shape (m, 2); empty where the nose was given.
    """

    distance: float
    standard_error: float
    shock: float
    nose: float
    shock_points: np.ndarray
    nose_points: np.ndarray


def measure_stand_off(
    picture: AnyPicture,
    half_height: float,
    *,
    axis: float = 0.0,
    upstream: str = "right",
    nose: float | None = None,
    level: float = 0.5,
    smoothing: float = 0.5,
) -> StandOff:
    """Read the stand-off distance of a detached shock off a picture.

    The rows of pixels about the axis are scanned from upstream: the shock is where the brightness first leaves that of
    the air, the body where it goes dark for good. Parabolas through both give their places on the axis. The shock must
    not be as dark as the body: with a vertical knife edge, take the side from which it is bright.

    Args:
        picture: a Picture or any of the synthetic pictures.
        half_height: rows up to this distance from the axis are used [m]; less than the nose's radius of curvature.
        axis: height of the flow's axis in the picture [m].
        upstream: side from which the flow comes, "right" (as in pictures along x) or "left".
        nose: place of the nose along the horizontal [m], where it is known; None reads it off the picture.
        level: share of the band's height at which its outer edge is.
        smoothing: standard deviation of the Gaussian that the picture is smoothed with [pixels]; 0 for none.

    Raises:
        ValueError: too few rows, no shock or no body on them, an argument that makes no sense.
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
    lines = smoothed(picture.intensity, smoothing)[rows, ::step]
    along = picture.horizontal[::step]
    pitch = float(along[1] - along[0])
    height = picture.vertical[rows] - axis
    places = outer_fronts(lines, level)
    shock, shock_error, shock_points = _on_axis(height, along[0] + pitch * places, abs(pitch), "shock", axis)
    if nose is not None:
        if not np.isfinite(nose):
            raise ValueError(f"nose = {nose}: give a place along the horizontal in metres")
        return StandOff(abs(shock - nose), shock_error, shock, float(nose), shock_points, np.empty((0, 2)))
    dark = DARK_SHARE * float(np.median(lines[:, 0]))
    edges = np.array([_dark_edge(line, dark, place) for line, place in zip(lines, places, strict=True)])
    tip, tip_error, nose_points = _on_axis(height, along[0] + pitch * edges, abs(pitch), "body", axis)
    return StandOff(
        abs(shock - tip), math.hypot(shock_error, tip_error), shock, tip, shock_points, nose_points
    )  # fmt: skip


def _on_axis(
    height: np.ndarray, found: np.ndarray, pitch: float, what: str, axis: float
) -> tuple[float, float, np.ndarray]:
    """Place on the axis of a curve through points, its standard error, and the points used."""
    try:
        curve, covariance, used = fit_curve(height, found, 2, 0.5 * pitch)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None
    points = np.stack([found[used], height[used] + axis], axis=1)
    return float(curve[0]), math.sqrt(covariance[0, 0]), points


def _dark_edge(line: np.ndarray, dark: float, start: float) -> float:
    """Where a scan line, behind its shock, falls to the body's darkness: half way down from what lies before it."""
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
