"""Fronts on single scan lines and the curve through them, on lines whose answer is known by hand."""

import math

import numpy as np
import pytest

from aerokernels.schlieren.fronts import LEAST_LINES, fit_curve, inner_bands, outer_fronts, smoothed


def ramp(start: float, height: float, length: int = 60, width: float = 5.0) -> np.ndarray:
    """Undisturbed air of brightness 0.5, and from `start` a rise by `height` within `width` samples, straight."""
    return 0.5 + height * np.clip((np.arange(length) - start) / width, 0.0, 1.0)


@pytest.mark.parametrize("height", [0.3, -0.2])
@pytest.mark.parametrize("level", [0.25, 0.5, 0.8])
def test_a_front_is_where_a_straight_rise_has_its_share(height, level):
    """Between samples a straight rise is interpolated exactly."""
    lines = np.stack([ramp(start, height) for start in (20.0, 20.4, 31.7)])
    np.testing.assert_allclose(outer_fronts(lines, level), np.array([20.0, 20.4, 31.7]) + 5.0 * level, atol=1e-12)


def test_the_first_band_counts():
    """A second band twice as high behind the first, and a dark body behind that, do not move the front."""
    line = ramp(20.0, 0.1)
    line[27:30] = 0.5
    line[35:] = 0.8
    line[45:] = 0.0
    assert outer_fronts(line[None], 0.5)[0] == pytest.approx(22.5, abs=1e-12)


def test_lines_without_a_front_have_none():
    """Even lines, and one that starts within the band; a change below 3 % of the strongest is none; noise is none."""
    faint = ramp(20.0, 0.0089)
    inside = ramp(-10.0, 0.3)
    lines = np.stack([ramp(20.0, 0.3), ramp(20.0, 0.3), ramp(20.0, 0.3), np.full(60, 0.5), inside, faint])
    np.testing.assert_array_equal(np.isnan(outer_fronts(lines, 0.5)), [False, False, False, True, True, True])
    lines[-1] = ramp(20.0, 0.0091)
    assert outer_fronts(lines, 0.5)[-1] == pytest.approx(22.5, abs=1e-9)
    # Noise in the undisturbed air: a band of six of its standard deviations counts, 1.4826 of the median of 0.01.
    for height, found in ((0.088, False), (0.090, True)):
        lines = np.stack([ramp(20.0, height) + np.where(np.arange(60) < 15, off, 0.0) for off in (-0.01, 0.0, 0.01)])
        assert bool(np.isfinite(outer_fronts(lines, 0.5)).any()) is found


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_band_within_reach_is_the_top_of_its_parabola(sign):
    """Three points of a parabola give its top exactly; the strongest of two bands within reach, none outside it."""
    place = np.arange(80.0)
    bands = np.maximum(0.3 - 0.02 * (place - 30.3) ** 2, 0.0) + np.maximum(0.2 - 0.02 * (place - 41.8) ** 2, 0.0)
    line = 0.5 + sign * bands
    found = inner_bands(np.stack([line] * 4), np.array([30.0, 34.0, 42.0, 60.0]), 8.0)
    np.testing.assert_allclose(found[:3], [30.3, 30.3, 41.8], atol=1e-9)
    assert np.isnan(found[3])
    assert np.isnan(inner_bands(line[None], np.array([30.0]), 1.4)[0])
    assert inner_bands(line[None], np.array([31.0]), 2.0)[0] == pytest.approx(30.3, abs=1e-9)
    assert np.isnan(inner_bands(line[None], np.array([-9.0]), 8.0)[0])


def test_a_curve_and_its_covariance_are_those_of_least_squares():
    """Points that lie on a parabola but for given residuals; those far off and missing ones are left out.

    Residuals that alternate do not correlate: the plain covariance. Such as come in pairs of equal ones have
    rho = sum r_i r_i+1 / sum r_i^2, and the covariance grows by (1 + rho) / (1 - rho).
    """
    along = np.linspace(-2.0, 3.0, 41)
    for pattern in (np.tile([1.0, -1.0], 21)[:41], np.tile([1.0, 1.0, 1.0, -1.0, -1.0, -1.0], 7)[:41]):
        across = 1.0 + 2.0 * along - 0.5 * along**2 + 0.01 * pattern
        across[[5, 17]] = np.nan, 9.0
        left = np.delete(np.arange(41), [5, 17])
        powers = np.vander(along[left], 3, increasing=True)
        expected, *_ = np.linalg.lstsq(powers, across[left], rcond=None)
        rest = across[left] - powers @ expected
        rho = min(max(float(rest[1:] @ rest[:-1] / (rest @ rest)), 0.0), 0.98)
        covariance = np.linalg.inv(powers.T @ powers) * (rest @ rest) / (len(left) - 3) * (1.0 + rho) / (1.0 - rho)
        coefficients, found, used = fit_curve(along, across, 2, 0.1)
        np.testing.assert_array_equal(np.flatnonzero(used), left)
        np.testing.assert_allclose(coefficients, expected, rtol=1e-9)
        np.testing.assert_allclose(found, covariance, rtol=1e-9)


def test_half_of_the_lines_and_eight_must_agree():
    """Of 40 points 20 on the line are enough, 19 are not; of 9 eight are, of 7 none."""
    along = np.arange(40.0)
    across = 2.0 + 0.5 * along
    scattered = 100.0 + 37.0 * (np.arange(40) * 7 % 11)
    for good in (20, 19):
        points = np.where(np.arange(40) % 2 == 0, across, scattered)
        points[0 if good == 19 else 1] = np.nan
        if good == 20:
            assert fit_curve(along, points, 1, 0.1)[0] == pytest.approx([2.0, 0.5], abs=1e-9)
        else:
            with pytest.raises(ValueError, match="of 40 scan lines show one front, 20 are needed"):
                fit_curve(along, points, 1, 0.1)
    assert fit_curve(along[:LEAST_LINES], across[:LEAST_LINES], 1, 0.1)[2].sum() == 8
    with pytest.raises(ValueError, match="7 of 7 scan lines show one front, 8 are needed"):
        fit_curve(along[:7], across[:7], 1, 0.1)


def test_smoothing_is_a_gaussian_of_its_width():
    """A single bright pixel becomes a spot of that standard deviation; 0 leaves the picture as it is."""
    picture = np.zeros((41, 41))
    picture[20, 20] = 1.0
    assert smoothed(picture, 0.0) is picture
    place = np.arange(41) - 20.0
    spot = smoothed(picture, 2.0)
    assert spot.sum() == pytest.approx(1.0, abs=1e-6)
    assert math.sqrt(spot.sum(axis=0) @ place**2) == pytest.approx(2.0, rel=1e-3)


def test_a_twentieth_of_a_line_is_taken_to_be_undisturbed():
    """A front at 4 % of the line: nine of its first ten samples are air, and the front is found there."""
    line = ramp(8.5, 0.3, length=200)
    np.testing.assert_allclose(outer_fronts(np.stack([line] * 3), 0.5), 11.0, atol=1e-12)
