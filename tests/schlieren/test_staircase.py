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

import numpy as np
import pytest

from aerokernels.benches import Picture, measure_shock_angle
from tests.slow import first_of

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
    first_of(
        [
            (True, 0.0, 0.0),
            (False, 0.04, 1.0),
            (True, 0.0, 1.0),
            (True, 0.0, 2.0),
            (True, 0.04, 0.0),
            (False, 0.0, 0.0),
            (False, 0.04, 2.0),
        ],
    ),
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
