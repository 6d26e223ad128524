"""Comparisons of waveforms by hand: noise, widths, the vertex of a correlation, lags, and when pulses are the same."""

import math

import numpy as np
import pytest

from aerokernels import compare_waveforms
from aerokernels.compare import (
    WaveformComparison,
    _edge,
    _noise,
    _same_widths,
    _vertex,
    _widths,
    correlation_by_lag,
    pearson_correlation,
)

TIME = np.arange(200) * 0.5e-9


def bell(place: float, width: float = 12.0, count: int = 200) -> np.ndarray:
    """A Gaussian of 1/e half-width [samples]."""
    return np.exp(-(((np.arange(count) - place) / width) ** 2))


def test_noise_is_the_median_of_fourth_differences():
    """1, -4, 6, -4, 1 have the squared sum 70; 1.4826 medians are a standard deviation."""
    values = np.random.default_rng(1).normal(size=40)
    fourth = [v[0] - 4 * v[1] + 6 * v[2] - 4 * v[3] + v[4] for v in np.lib.stride_tricks.sliding_window_view(values, 5)]
    assert _noise(values) == pytest.approx(1.4826 * float(np.median(np.abs(fourth))) / math.sqrt(70.0))
    cubic = np.polyval([1e-3, -0.2, 1.0, 3.0], np.arange(40.0))
    assert _noise(cubic) < 1e-12
    assert _noise(np.random.default_rng(2).normal(size=20_000)) == pytest.approx(1.0, rel=0.05, abs=0.0)


def test_the_vertex_of_a_parabola():
    place = np.arange(9.0)
    found = _vertex(5.0 - 0.3 * (place - 4.3) ** 2)
    assert found == (pytest.approx(4.3), pytest.approx(5.0))
    for values, top in (
        (np.array([3.0, 2.0, 1.0]), (0.0, 3.0)),
        (np.array([1.0, 2.0, 3.0]), (2.0, 3.0)),
        (np.array([1.0, np.nan, 3.0, 2.0]), (2.0, 3.0)),
        (np.array([1.0, 3.0, np.nan, 2.0]), (1.0, 3.0)),
        (np.array([2.0, 2.0, 2.0]), (0.0, 2.0)),
    ):
        assert _vertex(values) == top
    beside = _vertex(np.array([np.nan, 2.0, 3.0, 2.5, np.nan]))
    assert beside == (pytest.approx(2.0 + 0.25 / 1.5), pytest.approx(3.0 + 0.0625 / 1.5 / 2.0))


def test_widths_of_a_bell():
    """2 tau sqrt(ln(1 / share)) at a quarter, a half and three quarters; none of what the record cuts."""
    found = _widths(3.0 * bell(90.2))
    np.testing.assert_allclose(
        found, [24.0 * math.sqrt(math.log(1.0 / share)) for share in (0.25, 0.5, 0.75)], rtol=1e-4
    )
    cut = _widths(bell(90.2)[:100])
    assert [math.isnan(one) for one in cut] == [True, True, False]
    part = _widths(bell(90.2)[:104])
    assert [math.isnan(one) for one in part] == [True, False, False]
    before = _widths(bell(90.2)[77:])
    assert [math.isnan(one) for one in before] == [True, False, False]
    assert np.isnan(_widths(np.arange(20.0))).all()
    assert _edge(2.0 * bell(90.2), 1.0) == pytest.approx(90.2 - 12.0 * math.sqrt(math.log(2.0)), abs=1e-4)
    assert math.isnan(_edge(bell(90.2), 1.1))


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.01])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_widths_are_the_same_to_a_hundredth_or_five_standard_errors(noise: float, which: int):
    """Noise over the slope at both crossings, and that of the peak times the share: added as squares."""
    model = bell(90.2)
    shares = np.array([0.25, 0.5, 0.75])
    off = 12.0 * np.sqrt(np.log(1.0 / shares))
    widths = 2.0 * off
    slope = shares * 2.0 * off / 144.0
    error = noise * np.hypot(math.sqrt(2.0) / slope, shares * 2.0 / slope)
    limit = np.maximum(0.01 * widths, 5.0 * error)
    for factor, same in ((0.999, True), (-0.999, True), (1.003, False), (-1.003, False)):
        other = widths.copy()
        other[which] += factor * limit[which]
        assert _same_widths(other, widths, noise, model) is same
    unknown = widths.copy()
    unknown[which] = np.nan
    assert _same_widths(unknown, widths, noise, model) is True and _same_widths(widths, unknown, noise, model) is True
    assert _same_widths(widths, np.full(3, np.nan), noise, model) is None


def test_too_much_noise_tells_nothing_of_widths():
    widths = np.array([20.0, 15.0, 10.0])
    assert _same_widths(widths, widths, 0.0499, bell(90.0)) is True
    assert _same_widths(widths, widths, 0.0501, bell(90.0)) is None


def test_the_noise_is_that_of_the_difference_over_the_recorded_peak():
    """What both waveforms share is no noise; what one of them has alone is, and counts against its own peak."""
    shared = 0.08 * np.where(np.arange(200) % 2, 1.0, -1.0) * (np.abs(np.arange(200) - 100) > 60)
    found = compare_waveforms(TIME, bell(100.0) + shared, bell(100.0) + shared)
    assert found.same_pulse is True
    noise = np.where(np.arange(200) % 2, 1.0, -1.0)
    for size, known in ((0.048, True), (0.052, False)):
        recorded = 2.0 * bell(100.0)
        recorded = recorded + size * 2.0 / _noise(noise) * noise * (np.abs(np.arange(200) - 100) > 2)
        found = compare_waveforms(TIME, recorded, bell(100.0))
        assert found.recorded_peak == 2.0 and (found.same_pulse is not None) is known


def test_lags_that_are_tried_and_their_direction():
    """Up to half of the record, or as far as asked, to the next whole sample; eight samples at least overlap."""
    later, first = bell(60.0, 3.0, 100), bell(50.0, 3.0, 100)
    time = np.arange(100) * 2e-9
    assert compare_waveforms(time, later, first).lag == pytest.approx(20e-9, abs=1e-11)
    assert compare_waveforms(time, first, later).lag == pytest.approx(-20e-9, abs=1e-11)
    near = compare_waveforms(time, later, first, greatest_lag=10.1e-9)
    assert near.lag == pytest.approx(12e-9) and near.best_correlation < 0.9
    by_lag = correlation_by_lag(later, first, 6)
    assert near.best_correlation == pytest.approx(by_lag[-1])
    assert compare_waveforms(time, later, first, greatest_lag=20.1e-9).lag == pytest.approx(20e-9, abs=1e-11)
    apart = compare_waveforms(time, bell(92.0, 2.0, 100), bell(12.0, 2.0, 100), greatest_lag=1e-5)
    assert apart.lag == pytest.approx(160e-9, abs=1e-10)
    assert near.correlation == pytest.approx(np.corrcoef(later, first)[0, 1])
    # Where an overlapping part is constant there is no correlation.
    step = np.zeros(30)
    step[20:] = np.arange(10.0)
    other = np.random.default_rng(3).normal(size=30)
    found = correlation_by_lag(step, other, 12)
    assert np.isnan(found[:4]).all() and np.isfinite(found[4:]).all()
    assert compare_waveforms(time, later, first).best_correlation <= 1.0


def test_differences_of_two_pulses():
    """Both conventions of the peak's error, the edge at half of the lower peak, and widths at half of each own peak."""
    recorded, simulated = 1.5 * bell(103.0, 14.0), 2.0 * bell(100.0, 12.0)
    found = compare_waveforms(TIME, recorded, simulated)
    high, low = float(recorded.max()), float(simulated.max())
    assert found.peak_error == pytest.approx((high - low) / low)
    assert found.peak_error_of_recorded == pytest.approx((high - low) / high)
    assert found.edge_level == pytest.approx(0.5 * high)
    edges = [
        place - width * math.sqrt(math.log(peak / found.edge_level))
        for place, width, peak in ((103.0, 14.0, 1.5), (100.0, 12.0, 2.0))
    ]
    assert found.edge_shift == pytest.approx(0.5e-9 * (edges[0] - edges[1]), rel=1e-4, abs=0.0)
    assert found.range_difference == pytest.approx(0.5 * 299_792_458.0 * found.edge_shift)
    assert found.recorded_width == pytest.approx(0.5e-9 * 28.0 * math.sqrt(math.log(2.0)), rel=1e-4, abs=0.0)
    assert found.simulated_width == pytest.approx(0.5e-9 * 24.0 * math.sqrt(math.log(2.0)), rel=1e-4, abs=0.0)
    assert found.same_pulse is False
    assert found.width_range == pytest.approx(0.25 * 299_792_458.0 * (found.recorded_width - found.simulated_width))
    assert WaveformComparison(1, 1, 0, 0, 1, 1, 0, "", "", 1, 0, 0, 3e-9, 1e-9).width_range == pytest.approx(
        0.149896229
    )
    assert pearson_correlation([1.0, 2.0], [5.0, 3.0]) == pytest.approx(-1.0)
    assert pearson_correlation([1e-20, 2e-20, 4e-20], [1e30, 2e30, 4e30]) == pytest.approx(1.0)
    with pytest.raises(ValueError, match="constant"):
        pearson_correlation(0.1 + 0.2 * np.ones(7), np.arange(7.0))
    for wrong in (([1.0], [2.0]), ([1.0, 1.0], [1.0, 2.0]), ([[1.0, 2.0]], [[1.0, 2.0]])):
        with pytest.raises(ValueError, match=r"one length|constant"):
            pearson_correlation(*wrong)
