"""Angles of shocks in point-sampled and noisy pictures: does the standard error cover the error made?

Set-up: straight fronts at 3 to 31 degrees, half of them near simple ratios of pixels (p / q +- 0.004, q up to 6), as
tests/schlieren/test_fronts.py draws them, but each pixel sampled at its middle, or seen as an area; without noise and
with noise of an eighth of the step; smoothed by 0, 1 and 2 pixels; 60 pictures of each kind. Each pair of sampling,
noise and smoothing occurs; of pictures sampled at points without noise, the clean staircases, each smoothing.

Expected: at most 1 of 60 errors is above 3 standard errors, and their rms is one of them at most; that of 60 draws
scatters by 0.09, so 1.27 is three standard deviations above. Of 360 point-sampled
pictures without noise 30 had an error above 3, the greatest 280, before the staircase counted.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from aerokernels.benches import Picture, measure_shock_angle
from aerokernels.benches.fronts import fit_curve, is_staircase, slope_error

from .test_fronts import HORIZONTAL, PITCH, VERTICAL, WINDOW, area_below

COUNT = 60


def slope_of(rng: np.random.Generator, near_ratio: bool) -> float:
    if not near_ratio:
        return math.tan(math.radians(rng.uniform(5.0, 30.0)))
    q = int(rng.integers(1, 7))
    return max(min(int(rng.integers(1, q + 1)) / q, 0.6) + 0.004 * rng.normal(), 0.05)


def picture_of(rng: np.random.Generator, slope: float, at_points: bool, noise: float) -> Picture:
    front = np.maximum(0.002 + rng.uniform(0.0, PITCH) - slope * HORIZONTAL, 0.0)

    def below(height: np.ndarray) -> np.ndarray:
        return (VERTICAL[:, None] < height).astype(float) if at_points else area_below(height)

    band = below(front) - below(0.5 * front)
    seen = 0.5 + 0.3 * (band + band[::-1]) + noise * rng.normal(size=band.shape)
    return Picture(np.clip(seen, 0.0, 1.0), HORIZONTAL, VERTICAL)


@pytest.mark.parametrize(
    ("at_points", "noise", "smoothing"),
    [
        (True, 0.0, 0.0),
        (True, 0.0, 1.0),
        (True, 0.0, 2.0),
        (True, 0.04, 0.0),
        (False, 0.0, 0.0),
        (False, 0.04, 1.0),
        (False, 0.04, 2.0),
    ],
)
def test_the_standard_error_covers_the_error(at_points, noise, smoothing):
    ratios = []
    for number in range(COUNT):
        rng = np.random.default_rng([number, 3])
        slope = slope_of(rng, number % 2 == 1)
        found = measure_shock_angle(picture_of(rng, slope, at_points, noise), WINDOW, smoothing=smoothing)
        ratios.append(abs(found.angle - math.atan(slope)) / found.standard_error)
        assert found.standard_error < math.radians(0.6)
    assert np.sqrt(np.mean(np.square(ratios))) < 1.27
    assert np.count_nonzero(np.array(ratios) > 3.0) <= COUNT // 60


def test_only_pictures_sampled_at_points_are_staircases():
    rng = np.random.default_rng(1)
    place = 100.0 - (0.002 - 0.37 * HORIZONTAL) / PITCH
    for at_points in (True, False):
        lines = picture_of(np.random.default_rng(2), 0.37, at_points, 0.0).intensity[::-1].T
        rows = slice(5, 100)
        assert is_staircase(lines[rows], place[rows]) == at_points
    assert not is_staircase(np.full((9, 40), 0.5), rng.uniform(5.0, 35.0, 9))


def test_the_unseen_slope_of_a_staircase():
    """90 columns at 1/2: nothing changes within 1 / 180. At 1/2 + 1/45 there are four teeth, a quarter of that."""
    assert slope_error(0.5, 90) == pytest.approx(1.0 / 180.0 / math.sqrt(3.0))
    assert slope_error(0.5 + 1.0 / 45.0, 90) == pytest.approx(1.0 / 720.0 / math.sqrt(3.0), rel=0.5)
    assert slope_error(0.0, 90) == pytest.approx(1.0 / 90.0 / math.sqrt(3.0))
    assert slope_error(0.5 * (math.sqrt(5.0) - 1.0), 90) < 1e-3  # the ratio that fractions come least near


def test_the_steps_of_uneven_pixels_are_in_the_error():
    """Pixels twice as wide as high: the slope in pixels counts, and its error is added to that of the scatter."""
    pitch = 1e-4
    horizontal, vertical = 2.0 * pitch * np.arange(60), pitch * np.arange(120)
    front = 4e-3 + 0.26 * horizontal
    picture = SimpleNamespace(
        intensity=np.where(vertical[:, None] < front, 0.9, 0.5), horizontal=horizontal, vertical=vertical
    )
    found = measure_shock_angle(picture, (0.9e-3, 1.09e-2), axis=0.5e-3, smoothing=0.0)
    along, up = found.points.T
    assert len(along) == 50
    curve, covariance, used = fit_curve(along - found.place, up - 0.5e-3, 1, 0.5 * pitch)
    assert used.all() and curve[1] == pytest.approx(found.curve[1])
    steps = 0.5 * slope_error(curve[1] / 0.5, 50)
    assert steps > 0.0
    blurred = measure_shock_angle(picture, (0.9e-3, 1.09e-2), axis=0.5e-3, smoothing=0.5)
    width = 2.0 * abs(blurred.angle - found.angle)
    expected = math.hypot(math.hypot(math.sqrt(covariance[1, 1]), steps) / (1.0 + curve[1] ** 2), width)
    assert found.standard_error == pytest.approx(expected, rel=1e-9)
