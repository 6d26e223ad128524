"""Represent a sampled pulse by a smooth curve, to find crossings, peak and centroid between the samples.

The curve is the quintic spline through the samples; for a Gaussian of 1/e half-width tau its error is of order
(period / tau)^6, 2e-6 of the peak with six samples per tau. With few samples a known shape s is fitted first, and only
the remainder v(t) - A s(t - t0) is interpolated. Positions are counted in samples from the start of the record.
"""

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

# The centroid is that of the part above this fraction of the peak; below it there is mostly noise.
CENTROID_FLOOR = 0.1
# This many equal samples at the top mean that the peak is cut off, not that it is between two samples.
PLATEAU = 3


class PulseCurve:
    """The curve through the samples of a pulse, shape (n,); a pulse that the samples do not hold is a ValueError.

    `is_whole` says that the pulse is 0 beyond the samples, as for a template: the samples may then begin and end
    within the pulse. `upsampling` is the number of samples per sample of the record that the curve represents.
    """

    def __init__(self, samples: np.ndarray, is_whole: bool = False, upsampling: int = 1):
        """Fit the spline."""
        from scipy.interpolate import make_interp_spline

        self.samples, self.is_whole, self.upsampling = samples, is_whole, upsampling
        count = len(samples)
        self.spline: BSpline = make_interp_spline(np.arange(count), samples, k=min(5, 2 * ((count - 2) // 2) + 1))

    @cached_property
    def peak_position(self) -> float:
        """Position of the curve's maximum next to the greatest sample."""
        from scipy.optimize import brentq, minimize_scalar

        top = int(np.argmax(self.samples))
        if self.samples[top] <= 0.0:
            raise ValueError(
                f"there is no pulse: the greatest sample is {self.samples[top]:g} V; is the sign inverted?"
            )
        if top in (0, self.samples.size - 1):
            where = "first" if top == 0 else "last"
            raise ValueError(f"the greatest sample is the record's {where}: record from before the pulse to after it")
        slope = self.spline.derivative()
        low, high = (top, top + 1) if slope(top) > 0.0 else (top - 1, top)
        if slope(low) > 0.0 > slope(high):
            place = float(brentq(slope, low, high, xtol=1e-12))
        else:
            options = {"bounds": (low, high), "method": "bounded", "options": {"xatol": 1e-10}}
            place = float(minimize_scalar(lambda position: -self.spline(position), **options).x)
        return place if self.spline(place) > self.samples[top] else float(top)

    @cached_property
    def peak(self) -> float:
        """Greatest value of the curve."""
        return float(self.spline(self.peak_position))

    def _root(self, level: float, low: float, high: float) -> float:
        """Position at which the curve crosses a level, between two positions on either side of the level."""
        from scipy.interpolate import BSpline
        from scipy.optimize import brentq

        lowered = BSpline(self.spline.t, self.spline.c - level, self.spline.k)
        below, above = lowered(np.array([low, high]))
        if below * above >= 0.0:  # a sample at the level, by rounding on the wrong side
            return float(low if abs(below) < abs(above) else high)
        return float(brentq(lowered, low, high, xtol=1e-12))

    def first_rise(self, level: float) -> float:
        """Return the first position at which the curve rises through `level`."""
        if self.samples[0] >= level:
            raise ValueError(
                f"the record starts at {self.samples[0]:g} V, above the threshold of {level:g} V already: "
                "begin the record earlier, remove its offset, or raise the threshold"
            )
        above = self.samples >= level
        if above.any():
            after = int(np.argmax(above))
            return self._root(level, after - 1, after)
        if self.samples.max() <= 0.0 or self.peak < level:
            top = max(float(self.samples.max()), self.peak if self.samples.max() > 0.0 else -np.inf)
            raise ValueError(
                f"the signal never crosses the threshold: its peak is {top:g} V, the threshold {level:g} V; "
                "lower the threshold or raise the gain"
            )
        # The peak is between two samples.
        return self._root(level, np.ceil(self.peak_position) - 1.0, self.peak_position)

    def rise_before_peak(self, level: float) -> float:
        """Return the last position before the peak at which the curve rises through `level` (below the peak)."""
        before = np.flatnonzero(self.samples[: int(np.ceil(self.peak_position))] < level)
        if before.size == 0:
            raise ValueError(
                f"the record starts above {level:g} V, within the pulse: begin it earlier or remove its offset"
            )
        return self._root(level, before[-1], min(before[-1] + 1.0, self.peak_position))

    def fall_after_peak(self, level: float) -> float:
        """Return the first position after the peak at which the curve falls through `level`; else the record's end."""
        start = int(np.floor(self.peak_position)) + 1
        after = np.flatnonzero(self.samples[start:] < level)
        if after.size == 0:
            return float(self.samples.size - 1)
        low = start + int(after[0])
        return self._root(level, max(low - 1.0, self.peak_position), low)

    @cached_property
    def centroid(self) -> float:
        """Centroid of the part of the curve above `CENTROID_FLOOR` of the peak."""
        level = CENTROID_FLOOR * self.peak
        low = 0.0 if self.is_whole and self.samples[0] >= level else self.rise_before_peak(level)
        high = self.fall_after_peak(level)
        if high == self.samples.size - 1 and self.samples[-1] >= level and not self.is_whole:
            raise ValueError(f"the record ends above {level:g} V, within the pulse: end it later or remove its offset")
        area = self.spline.antiderivative(1)
        moment = area.antiderivative(1)
        # Integrate by parts, with positions counted from the peak, so that long records lose no digits.
        lever = (high - self.peak_position) * area(high) - (low - self.peak_position) * area(low)
        return self.peak_position + float((lever - (moment(high) - moment(low))) / (area(high) - area(low)))

    def at(self, position: np.ndarray) -> np.ndarray:
        """Return the curve at positions of any shape; 0 outside the samples."""
        last = self.samples.size - 1
        inside = (position >= 0.0) & (position <= last)
        return np.where(inside, self.spline(np.clip(position, 0.0, last)), 0.0)

    @property
    def slope(self) -> np.ndarray:
        """Derivative at the samples [unit per sample], shape (n,)."""
        return np.asarray(self.spline.derivative()(np.arange(self.samples.size)))


def peak_height(samples: np.ndarray) -> float:
    """Return the greatest value of the curve through the samples; the greatest sample if it is at an end or level."""
    top = int(np.argmax(samples))
    cut_off = bool((samples[top : top + PLATEAU] == samples[top]).all()) and top + PLATEAU <= samples.size
    if samples[top] <= 0.0 or top in (0, samples.size - 1) or cut_off:
        return float(samples[top])
    return PulseCurve(samples).peak


ROUNDING = 1e-13
# Positions at which a match is evaluated in one call, and the tolerated relative error of the polynomial through them.
POINTS, SAME = 12, 1e-12

Shape = Callable[[np.ndarray], np.ndarray]


def shaped_curve(volts: np.ndarray, shape: Shape | None, period: float) -> PulseCurve:
    """Return the curve of samples (n,) of a `shape` of any amplitude and time zero, denser where samples are few."""
    top = int(np.argmax(volts))
    below = np.flatnonzero(volts < 0.5 * volts[top])
    across = int(below[below > top].min(initial=volts.size)) - int(below[below < top].max(initial=-1)) - 1
    # With 16 samples across the pulse the spline through them is accurate to 1e-6 of the peak.
    factor = min(32, math.ceil(16 / max(across, 1)))
    if shape is None or factor == 1:
        return PulseCurve(volts)
    try:
        delay, height = best_match(volts, shape, period)
    except ValueError:  # no pulse of that shape
        return PulseCurve(volts)
    samples = np.arange(volts.size)
    dense = np.arange((volts.size - 1) * factor + 1) / factor
    remainder = PulseCurve(volts - height * shape((samples - delay) * period)).spline
    return PulseCurve(height * shape((dense - delay) * period) + remainder(dense), upsampling=factor)


def best_match(volts: np.ndarray, curve: Shape, period: float) -> tuple[float, float]:
    """Return the delay [samples] at which a pulse correlates best with the samples, and its amplitude there."""
    start, offset = _best_delay(volts, curve, period)
    expected = curve((np.arange(volts.size) - start - offset) * period)
    return start + offset, float(volts @ expected) / (float(expected @ expected) or 1.0)


def best_delay(volts: np.ndarray, curve: Shape, period: float) -> float:
    """Return the position [samples] of the time zero of a pulse, a function of time [s], that correlates best."""
    return sum(_best_delay(volts, curve, period))


def _best_delay(volts: np.ndarray, curve: Shape, period: float) -> tuple[int, float]:
    """Return the sample nearest to the best delay, and the delay's difference from it [samples]."""
    from scipy.fft import irfft, next_fast_len, rfft

    count = volts.size
    samples = np.asarray(curve(np.arange(-(count - 1), count) * period), dtype=np.float64)
    if samples.shape != (2 * count - 1,) or not np.isfinite(samples).all():
        raise ValueError(f"the template must return one finite value for each time, got shape {samples.shape}")
    # Entry k of "valid" is the sum over i of volts[i] template(i - (count - 1 - k)): reversed, entry j is delay j.
    size = next_fast_len(2 * count - 1, real=True)
    coarse = irfft(rfft(samples, size) * np.conj(rfft(volts, size)), size)[:count][::-1]
    start = int(np.argmax(coarse))
    # A correlation below this is rounding of the sum.
    least = ROUNDING * float(np.linalg.norm(volts) * np.linalg.norm(samples))
    if np.ptp(volts) <= ROUNDING * float(np.abs(volts).max()):
        raise ValueError(f"there is no pulse: the record is {volts[0]:g} V throughout")
    if coarse[start] <= least:
        raise ValueError("the waveform has no positive correlation with the template anywhere: is a sign inverted?")
    places = np.arange(count) - start

    def match(shifts: np.ndarray) -> np.ndarray:
        # Normalised: the norm of a pulse of few samples changes with its position between the samples.
        expected = curve((places - shifts[:, None]).ravel() * period).reshape(shifts.size, places.size)
        norm = np.sqrt(np.einsum("si,si->s", expected, expected))
        return np.asarray(expected @ volts / np.where(norm > 0.0, norm, 1.0))

    low, high = max(-1.0, -float(start)), min(1.0, float(count - 1 - start))
    return start, greatest_within(match, low, high)


def greatest_within(values: Callable[[np.ndarray], np.ndarray], low: float, high: float) -> float:
    """Return the position of a smooth function's maximum between two positions, from a polynomial at Chebyshev points.

    The function is evaluated at all points in one call. If the polynomial does not reproduce the function at the
    maximum, as for a pulse of about one sample, the function itself is searched.
    """
    from numpy.polynomial import chebyshev

    angle = np.pi * (np.arange(POINTS) + 0.5) / POINTS
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    heights = values(middle + half * np.cos(angle))
    order = np.arange(POINTS)
    coefficients = 2.0 / POINTS * np.cos(order[:, None] * angle) @ heights
    coefficients[0] *= 0.5
    size = float(np.abs(heights).max())
    # Leave out negligible orders, so that rounding makes no roots.
    trimmed = chebyshev.chebtrim(coefficients, ROUNDING * size)
    if len(trimmed) < POINTS - 1 and np.isfinite(trimmed).all():
        roots = chebyshev.chebroots(chebyshev.chebder(trimmed)) if len(trimmed) > 2 else np.zeros(0)
        inner = roots.real[(np.abs(roots.imag) < 1e-6) & (np.abs(roots.real) < 1.0)]
        candidates = np.concatenate([inner, [-1.0, 1.0]])
        curve = chebyshev.chebval(candidates, trimmed)
        best = int(np.argmax(curve))
        position = middle + half * float(candidates[best])
        if abs(float(values(np.array([position]))[0]) - curve[best]) <= SAME * size:
            return position
    from scipy.optimize import minimize_scalar

    search = {"bounds": (low, high), "method": "bounded", "options": {"xatol": 1e-10}}
    return float(minimize_scalar(lambda position: -float(values(np.array([position]))[0]), **search).x)
