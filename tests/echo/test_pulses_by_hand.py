"""Curves through pulses, their match and their errors by hand: polynomials that splines keep, and plain searches."""

import math

import numpy as np
import pytest

from aerokernels.echo.pulse_curve import PulseCurve, _highest, _horner, _root_of, peak_height
from aerokernels.echo.sampling_error import (
    CoarseSamplingWarning,
    _powers,
    edge_powers,
    half_widths,
    sampling_error,
    warn_of_sampling,
)
from aerokernels.echo.shaped_curve import (
    best_delay,
    best_match,
    greatest_within,
    shaped_curve,
    shifted_samples,
    template_transform,
)

LIGHT = 299_792_458.0


def arch(position: np.ndarray, peak: float = 11.3, width: float = 6.0) -> np.ndarray:
    """2 - ((t - peak) / width)^2, which splines of any degree above one keep."""
    return 2.0 - ((position - peak) / width) ** 2


@pytest.mark.parametrize("count", [5, 6, 24])
@pytest.mark.parametrize("place", [0.3, 0.5, 0.8])
def test_a_parabolas_peak_edges_and_centroid(count: int, place: float):
    """Of cubic splines and quintic ones; its part above a tenth of the peak is symmetric about it."""
    peak = count // 2 - 1 + place
    width = 0.45 * count / math.sqrt(2.0)
    curve = PulseCurve(arch(np.arange(count), peak, width))
    assert curve.peak_position == pytest.approx(peak, abs=1e-9) and curve.peak == pytest.approx(2.0, abs=1e-12)
    for level in (0.9, 1.4, 1.95):
        off = width * math.sqrt(2.0 - level)
        if peak - off > 0.0 and peak + off < count - 1:
            assert curve.rise_before_peak(level) == pytest.approx(peak - off, abs=1e-9)
            assert curve.fall_after_peak(level) == pytest.approx(peak + off, abs=1e-9)
            assert curve.first_rise(level) == pytest.approx(peak - off, abs=1e-9)
    off = width * math.sqrt(2.0 - 0.2)
    if peak - off > 0.0 and peak + off < count - 1:
        assert curve.centroid == pytest.approx(peak, abs=1e-9)
    at = curve.at(np.array([-0.01, 0.0, 1.7, count - 1.0, count - 0.99]))
    np.testing.assert_allclose(at, [0.0, *arch(np.array([0.0, 1.7, count - 1.0]), peak, width), 0.0], atol=1e-9)
    np.testing.assert_allclose(curve.slope, -2.0 * (np.arange(count) - peak) / width**2, atol=1e-9)
    together = PulseCurve.of_each([arch(np.arange(count), peak, width), np.full(count, np.nan), curve.samples])
    assert together[1] is None and together[0].peak_position == curve.peak_position
    assert PulseCurve.of_each([np.ones(3)]) == [None]


@pytest.mark.parametrize("skew", [0.0, 0.004, -0.006])
def test_a_centroid_is_the_moment_of_what_is_above_a_tenth(skew: float):
    """A quintic that the spline keeps, by ten thousand trapezia between its crossings."""
    position = np.arange(30.0)
    shape = lambda t: 3.0 - ((t - 13.3) / 7.0) ** 2 * (1.0 + skew * (t - 13.3)) - 1e-7 * (t - 13.0) ** 5  # noqa: E731
    curve = PulseCurve(shape(position))
    fine = np.linspace(0.0, 29.0, 2_900_001)
    value = shape(fine)
    peak = value.max()
    lit = np.flatnonzero(value >= 0.1 * peak)
    part = slice(lit[0], lit[-1] + 1)
    assert lit[0] > 0 and lit[-1] < len(fine) - 1
    expected = np.trapezoid(fine[part] * value[part], fine[part]) / np.trapezoid(value[part], fine[part])
    assert curve.centroid == pytest.approx(expected, abs=1e-5)


def test_records_that_cut_a_pulse():
    """A whole one begins and ends within itself; a record that does so has no centroid."""
    cut = arch(np.arange(12.0), 5.4, 8.0)
    whole = PulseCurve(cut, is_whole=True)
    fine = np.linspace(0.0, 11.0, 1_100_001)
    value = arch(fine, 5.4, 8.0)
    assert whole.centroid == pytest.approx(np.trapezoid(fine * value, fine) / np.trapezoid(value, fine), abs=1e-6)
    with pytest.raises(ValueError, match="starts above"):
        _ = PulseCurve(cut).centroid
    late = PulseCurve(arch(np.arange(16.0), 12.4, 8.0))
    with pytest.raises(ValueError, match="record ends above"):
        _ = late.centroid
    assert late.fall_after_peak(1.0) == 15.0
    with pytest.raises(ValueError, match="first"):
        _ = PulseCurve(np.array([3.0, 2.0, 1.0, 0.5, 0.2, 0.1])).peak_position
    with pytest.raises(ValueError, match="last"):
        _ = PulseCurve(np.array([0.1, 0.2, 0.5, 1.0, 2.0, 3.0])).peak_position
    with pytest.raises(ValueError, match="no pulse"):
        _ = PulseCurve(-np.array([0.1, 0.2, 0.5, 1.0, 2.0, 3.0])).peak_position


def test_thresholds_between_and_above_the_samples():
    """Between the greatest sample and the curve's peak the crossing is before the peak; above it there is none."""
    curve = PulseCurve(arch(np.arange(24.0), 11.5, 6.0))
    level = 2.0 - 0.5 * (0.5 / 6.0) ** 2
    assert curve.samples.max() < level < curve.peak
    assert curve.first_rise(level) == pytest.approx(11.5 - 0.5 * math.sqrt(0.5), abs=1e-6)
    with pytest.raises(ValueError, match="never crosses"):
        curve.first_rise(2.001)
    with pytest.raises(ValueError, match="starts at"):
        PulseCurve(arch(np.arange(24.0), 3.0, 20.0)).first_rise(1.0)
    two = PulseCurve(np.array([0.0, 0.0, 0.5, 1.0, 0.5, 0.0, 0.0, 1.0, 2.0, 1.0, 0.0, 0.0]))
    assert 2.0 < two.first_rise(0.7) < 3.0 and 6.0 < two.rise_before_peak(0.7) < 7.0


def test_the_height_of_a_peak_that_is_cut_off_is_its_sample():
    """Three equal samples at the top; two are a peak between them, and so are three with the last one lower."""
    plain = np.array([0.0, 0.1, 0.6, 1.0, 1.0, 0.6, 0.1, 0.0])
    assert peak_height(plain) == pytest.approx(PulseCurve(plain).peak) and peak_height(plain) > 1.0
    cut = np.array([0.0, 0.1, 0.6, 1.0, 1.0, 1.0, 0.6, 0.1, 0.0])
    assert peak_height(cut) == 1.0
    for edge in (np.array([1.0, 0.5, 0.2, 0.1, 0.0, 0.0]), np.array([0.0, 0.1, 0.2, 0.5, 0.7, 1.0]), -plain - 1.0):
        assert peak_height(edge) == edge.max()
    assert peak_height(plain, PulseCurve(2.0 * plain)) == pytest.approx(2.0 * PulseCurve(plain).peak)


def test_roots_and_tops_of_polynomials():
    assert _horner([3.0, -2.0, 0.5], 2.0) == 3.0 - 4.0 + 2.0
    assert _root_of([-0.25, 0.0, 1.0], 0.0, 0.9) == pytest.approx(0.5, abs=1e-11)
    assert _root_of([1.0, 1.0], -0.4, 0.5) == -0.4 and _root_of([1.0, -1.0], -0.4, 0.5) == 0.5
    assert _highest([1.0, 0.2, -1.0]) == pytest.approx(0.1, abs=1e-8)


@pytest.mark.parametrize("period", [1.0, 0.5e-9])
@pytest.mark.parametrize("place", [8.2, 14.5, 22.9])
def test_a_pulse_is_matched_where_it_is(period: float, place: float):
    """Delay and height of a Gaussian of three samples, on a fine search of the normalised correlation."""
    draw = np.random.default_rng(3)
    tau = 3.1 * period
    shape = lambda t: np.exp(-((np.asarray(t) / tau) ** 2))  # noqa: E731
    volts = 0.7 * shape((np.arange(32) - place) * period) + 0.05 * draw.normal(size=32)
    trial = np.arange(place - 2.0, place + 2.0, 1e-4)
    rows = shape((np.arange(32) - trial[:, None]) * period)
    score = rows @ volts / np.linalg.norm(rows, axis=1)
    expected = trial[score.argmax()]
    assert best_delay(volts, shape, period) == pytest.approx(expected, abs=1e-4)
    delay, height = best_match(volts, shape, period)
    row = shape((np.arange(32) - delay) * period)
    assert delay == best_delay(volts, shape, period) and height == pytest.approx(row @ volts / (row @ row))
    found, norm = shifted_samples(shape, np.arange(-3.0, 4.0), np.array([0.2, -0.7]), period)
    np.testing.assert_allclose(found[1], shape((np.arange(-3.0, 4.0) + 0.7) * period))
    np.testing.assert_allclose(norm, np.linalg.norm(found, axis=1))
    transform, size = template_transform(shape, 8, period)
    every = shape(np.arange(-7, 8) * period)
    assert size == pytest.approx(np.linalg.norm(every))
    np.testing.assert_allclose(np.fft.irfft(transform, 15), every, atol=1e-12)
    for edge in (0, 31):  # a pulse at an end of the record is looked for within it
        at_end = best_delay(shape((np.arange(32) - edge) * period), shape, period)
        assert at_end == pytest.approx(edge, abs=1e-6) and 0.0 <= at_end <= 31.0
    with pytest.raises(ValueError, match="throughout"):
        best_delay(np.full(32, 0.3), shape, period)
    with pytest.raises(ValueError, match="no positive correlation"):
        best_delay(-volts - 1.0, shape, period)


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 7])
def test_the_greatest_value_between_two_positions(degree: int):
    """Polynomials whose top is inside or at an end; a spike that no polynomial of eleven orders follows."""
    draw = np.random.default_rng(degree)
    for low, high in ((-1.0, 1.0), (0.0, 0.7), (-0.2, 1.0)):
        for _ in range(5):
            factors = draw.normal(size=degree + 1)
            fine = np.linspace(low, high, 200_001)
            values = np.polyval(factors, fine)
            found = greatest_within(lambda x, f=factors: np.polyval(f, x), low, high)
            assert low <= found <= high
            assert np.polyval(factors, found) == pytest.approx(values.max(), abs=1e-7 * np.abs(values).max())
    spike = greatest_within(lambda x: np.exp(-(((np.asarray(x) - 0.31) / 0.2) ** 2)), -1.0, 1.0)
    assert spike == pytest.approx(0.31, abs=1e-5)


@pytest.mark.parametrize("tau", [1.1, 1.9, 8.0])
def test_a_curve_of_a_known_shape_is_that_shape(tau: float):
    """Few samples: sixteen or more points across the pulse's width, on the shape; many, or no shape: the samples'."""
    shape = lambda t: np.exp(-((np.asarray(t) / (tau * 1e-9)) ** 2))  # noqa: E731
    volts = 0.6 * shape((np.arange(40) - 19.3) * 1e-9)
    curve = shaped_curve(volts, shape, 1e-9)
    across = int((volts >= 0.5 * volts.max()).sum())
    factor = min(32, math.ceil(16 / across))
    assert curve.upsampling == factor
    np.testing.assert_allclose(
        curve.samples, 0.6 * shape((np.arange(39 * factor + 1) / factor - 19.3) * 1e-9), atol=1e-9
    )
    plain = PulseCurve(volts)
    assert shaped_curve(volts, None, 1e-9, plain) is plain
    assert shaped_curve(-volts - 0.1 * np.arange(40), shape, 1e-9).upsampling == 1
    other = 0.6 * shape((np.arange(40) - 19.3) * 1e-9) + 0.01 * np.arange(40)
    with_slope = shaped_curve(other, shape, 1e-9)
    np.testing.assert_allclose(with_slope.samples[:: with_slope.upsampling], other, atol=1e-9)


def powered(count: int, peak: float, before: float, after: float, powers: tuple[float, float]) -> np.ndarray:
    """2^(-|t / half width|^p) on either side of the peak."""
    position = np.arange(count) - peak
    side, power = np.where(position < 0.0, before, after), np.where(position < 0.0, *powers)
    return np.exp2(-(np.abs(position / side) ** power))


def test_half_widths_and_powers_of_edges():
    """Those that the record was made with: from the widths at a fifth and four fifths, and near the top."""
    volts = powered(400, 180.0, 20.0, 30.0, (2.0, 2.0))
    curve = PulseCurve(volts)
    assert half_widths(curve) == pytest.approx((20.0, 30.0), rel=1e-2, abs=0.0)
    assert half_widths(PulseCurve(volts[:185])) is None or half_widths(PulseCurve(volts[:185]))[1] == pytest.approx(
        4.0, abs=1.1
    )
    assert half_widths(PulseCurve(volts[170:])) is None
    for powers in ((2.0, 2.0), (3.0, 5.0), (4.0, 2.0)):
        curve = PulseCurve(powered(600, 250.0, 40.0, 60.0, powers))
        assert _powers(curve, 0.2, 0.8) == pytest.approx(powers, rel=0.02, abs=0.0)
        assert edge_powers(curve, 40.0, 60.0) == pytest.approx(powers, rel=0.02, abs=0.0)
    corner = PulseCurve(powered(600, 250.0, 40.0, 60.0, (1.0, 2.0)))
    assert edge_powers(corner, 40.0, 60.0) == pytest.approx((1.0, 2.0))
    square = PulseCurve(np.clip(8.0 - np.abs(np.arange(600) - 250.0) * 0.2, 0.0, 1.0))
    assert max(_powers(square, 0.2, 0.8)) <= 16.0
    # Noise beside the pulse, above two thousandths of the peak: Gaussian on either side.
    for noise, steep in ((0.0015, True), (0.003, False)):
        volts = powered(900, 450.0, 20.0, 30.0, (4.0, 4.0))
        volts[:200] += noise * np.where(np.arange(200) % 2, 1.0, -1.0)
        volts[700:] += noise * np.where(np.arange(200) % 2, 1.0, -1.0)
        found = edge_powers(PulseCurve(volts), 20.0, 30.0)
        assert (found != (2.0, 2.0)) is steep


@pytest.mark.parametrize("tau", [1.3, 2.0])
def test_the_sampling_error_is_the_worst_of_eight_phases(tau: float):
    """Of a known shape: one and a half times the greatest error of the reading between two samples, as a length."""
    period = 2e-9
    template = lambda t: 3.0 * np.exp(-((np.asarray(t) / (tau * period)) ** 2))  # noqa: E731
    volts = 0.5 * template((np.arange(64) - 30.2) * period)
    before, after = half_widths(PulseCurve(volts))

    def read(samples, known):
        return float(
            np.arange(len(samples)) @ np.maximum(samples, 0.0) ** 2 / (np.maximum(samples, 0.0) ** 2).sum()
        ) + 0.1 * float(samples.max())

    reach = int(8.0 * (before + after)) + 16
    whole = np.arange(-reach, reach + 1)
    height = PulseCurve(volts).peak
    found = sampling_error(volts, period, read, template, True)
    errors = []
    for phase in np.arange(8) / 8.0:
        pulse = height / 3.0 * template((whole - phase) * period)
        errors.append(abs(read(pulse, template) - reach - phase))
    assert found == pytest.approx(1.5 * 0.5 * LIGHT * period * max(errors), rel=1e-9, abs=0.0)
    bare = sampling_error(volts, period, read, template, False)
    fine = height / 3.0 * template(np.arange(-reach * 32, reach * 32 + 1) / 32.0 * period)
    truth = read(fine, None) / 32.0 - reach
    errors = [
        abs(read(height / 3.0 * template((whole - p) * period), template) - reach - p - truth)
        for p in np.arange(8) / 8.0
    ]
    assert bare == pytest.approx(1.5 * 0.5 * LIGHT * period * max(errors), rel=1e-9, abs=0.0)
    assert sampling_error(np.exp(-(((np.arange(200) - 99.7) / 9.0) ** 2)), period, read, template, True) == 0.0
    assert math.isnan(sampling_error(volts[31:], period, read, template, True))


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize(("before", "after"), [(1.1, 1.6), (1.9, 1.2)])
def test_without_a_shape_the_test_pulse_is_as_wide_as_the_record_looks(sampled: bool, before: float, after: float):
    """A Gaussian on either side, narrowed until its samples look no wider than the record at any of eight phases."""
    period = 1e-9
    volts = 0.8 * powered(48, 20.3, before, after, (2.0, 2.0))
    curve = PulseCurve(volts)
    first, second = half_widths(curve)
    reach = int(8.0 * (first + second)) + 16
    whole = np.arange(-reach, reach + 1.0)

    def pulse(position: np.ndarray, narrower: float) -> np.ndarray:
        side = np.where(position < 0.0, first, second)
        return curve.peak * 0.5 ** ((position / narrower / side) ** 2)

    def read(samples: np.ndarray, known) -> float:
        square = np.maximum(samples, 0.0) ** 3
        return float(np.arange(len(samples)) @ square / square.sum())

    widest = max(sum(half_widths(PulseCurve(pulse(whole - k / 8.0, 1.0)))) for k in range(8))
    narrower = min(1.0, (first + second) / widest)
    assert narrower < 0.999
    template = volts if sampled else None
    fine = pulse(np.arange(-32 * reach, 32 * reach + 1) / 32.0, narrower)
    truth = 0.0 if sampled else read(fine, None) / 32.0 - reach
    errors = [abs(read(pulse(whole - k / 8.0, narrower), None) - reach - k / 8.0 - truth) for k in range(8)]
    found = sampling_error(volts, period, read, template, True)
    assert found == pytest.approx(1.5 * 0.5 * LIGHT * period * max(errors), rel=1e-9, abs=0.0)


def test_a_sampling_error_above_three_ten_thousandths_of_the_width_is_warned_of():
    volts = np.exp(-(((np.arange(64) - 30.2) / 4.0) ** 2))
    width = sum(half_widths(PulseCurve(volts)))
    limit = 3e-4 * 0.5 * LIGHT * 1e-9 * width
    with pytest.warns(CoarseSamplingWarning, match="too few for method 'centroid'"):
        warn_of_sampling(volts, 1e-9, "centroid", 1.001 * limit, False)
    warn_of_sampling(volts, 1e-9, "centroid", 0.999 * limit, False)
    warn_of_sampling(volts, 1e-9, "centroid", math.nan, False)
