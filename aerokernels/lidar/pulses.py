"""Define the shapes of a laser pulse in time, each of peak 1 at t = 0, the moment at which the pulse's peak leaves.

| shape    | formula, t from the peak                                        | width at half height | integral       |
|----------|-----------------------------------------------------------------|----------------------|----------------|
| Gaussian | exp(-(t / tau)^2)                                               | 1.6651 tau           | sqrt(pi) tau   |
| HELIOS   | u^2 exp(-u) e^2 / 4, u = t / tau + 2 (0 before u = 0)           | 3.3947 tau           | e^2 / 2 tau    |
| sampled  | the spline through given samples, not below 0; 0 outside of them | the samples'         | the spline's   |

The HELIOS pulse is (t / tau)^2 exp(-t / tau) with t = 0 shifted to its peak at 2 tau, from T. Carlsson,
O. Steinvall, D. Letalick, Signature simulation and signal analysis for 3-D laser radar, FOI-R-0163-SE (2001), which the
lidar simulator HELIOS adopted.

A Gaussian pulse has FWHM = 2 sqrt(ln 2) tau and the energy P0 tau sqrt(pi). An echo is a sum of many delayed pulses.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import as_finite_array, check_positive
from aerokernels.lidar.pulse_curve import PulseCurve

SPEED_OF_LIGHT = 299_792_458.0  # in vacuum [m/s], exact
LEAST_SAMPLES = 4


class PulseShape(Protocol):
    """The shape of a pulse: a function of time [s] with the peak 1 at t = 0, and three properties.

    Attributes:
        support: Times [s] before and after which the shape is negligible, below 1e-12 of the peak.
        timescale: Time [s] over which the shape changes; eight samples per timescale resolve the shape.
        duration: Integral of the shape [s]: energy over peak power.
    """

    @property
    def support(self) -> tuple[float, float]: ...  # noqa: D102

    @property
    def timescale(self) -> float: ...  # noqa: D102

    @property
    def duration(self) -> float: ...  # noqa: D102

    def __call__(self, time: Numbers) -> np.ndarray: ...  # noqa: D102


@dataclass(frozen=True)
class _OfTau:
    """A pulse with one time constant [s]."""

    tau: float

    def __post_init__(self):
        """Check tau."""
        check_positive(self.tau, "pulse_tau", "s")

    @property
    def timescale(self) -> float:
        """Tau [s]."""
        return self.tau


@checked
@dataclass(frozen=True)
class GaussianPulse(_OfTau):
    """exp(-(t / tau)^2).

    Attributes:
        tau: 1/e half-width [s].

    Raises:
        ValueError: It is not positive and finite.
    """

    @property
    def support(self) -> tuple[float, float]:
        """Times [s] at which 2e-16 of the peak is left."""
        return -6.0 * self.tau, 6.0 * self.tau

    @property
    def duration(self) -> float:
        """Energy over peak power [s]."""
        return math.sqrt(math.pi) * self.tau

    @checked
    def __call__(self, time: Numbers) -> np.ndarray:
        """Return the shape at times [s] after the peak."""
        found = np.array(np.asarray(time, dtype=np.float64) / self.tau)
        for step in (np.square, np.negative, np.exp):  # in place: an echo evaluates millions of these
            step(found, out=found)
        return found


@checked
@dataclass(frozen=True)
class HeliosPulse(_OfTau):
    """(t / tau)^2 exp(-t / tau), with t = 0 shifted to the peak.

    Attributes:
        tau: Time constant [s].

    Raises:
        ValueError: It is not positive and finite.
    """

    @property
    def support(self) -> tuple[float, float]:
        """Times [s] before which the pulse is 0, and after which less than 2e-13 of the peak is left."""
        return -2.0 * self.tau, 34.0 * self.tau

    @property
    def duration(self) -> float:
        """Energy over peak power [s]."""
        return 0.5 * math.e**2 * self.tau

    @checked
    def __call__(self, time: Numbers) -> np.ndarray:
        """Return the shape at times [s] after the peak."""
        u = np.maximum(np.asarray(time, dtype=np.float64) / self.tau + 2.0, 0.0)
        return 0.25 * np.square(u) * np.exp(2.0 - u)


class SampledPulse:
    """The curve through samples of a recorded pulse.

    Args:
        samples: Relative power, not negative, shape (n,), n at least 4, with its peak inside.
        period: Time between two samples [s].

    Raises:
        ValueError: Too few samples, negative or not finite ones, a peak at an end of the record, or a period that is
            not positive.
    """

    @checked
    def __init__(self, samples: Numbers, period: float):
        """Check, fit the curve and find its peak."""
        values = as_finite_array(samples, "pulse samples")
        if values.ndim != 1 or values.size < LEAST_SAMPLES:
            raise ValueError(f"a sampled pulse needs a list of at least {LEAST_SAMPLES} samples, got {values.shape}")
        if values.min() < 0.0:
            raise ValueError(
                f"a pulse has no negative power: sample {int(np.argmin(values))} is {values.min():g}; subtract the "
                "record's offset and cut its noise to 0"
            )
        self.period = check_positive(period, "pulse sample period", "s")
        self._curve = PulseCurve(values)
        try:
            _ = self._curve.peak
        except ValueError as fault:
            raise ValueError(f"pulse samples: {fault}") from None

    @property
    def support(self) -> tuple[float, float]:
        """Times of the first and the last sample [s]."""
        before = self._curve.peak_position
        return -before * self.period, (self._curve.samples.size - 1 - before) * self.period

    @property
    def timescale(self) -> float:
        """The sample period [s], since the curve may change from one sample to the next."""
        return self.period

    @cached_property
    def duration(self) -> float:
        """Energy over peak power [s], by the trapezium rule on 256ths of the period: clipping at 0 makes kinks."""
        time = np.linspace(*self.support, 256 * (self._curve.samples.size - 1) + 1)
        return float(np.trapezoid(self(time), x=time))

    @checked
    def __call__(self, time: Numbers) -> np.ndarray:
        """Return the shape at times [s] after the peak."""
        position = np.asarray(time, dtype=np.float64) / self.period + self._curve.peak_position
        return np.maximum(self._curve.at(position) / self._curve.peak, 0.0)


def as_pulse(pulse: PulseShape | float) -> PulseShape:
    """Return a pulse shape unchanged; a number is the tau [s] of a Gaussian.

    Raises:
        ValueError: A number that is not positive and finite.
        TypeError: Neither a number nor a pulse shape.
    """
    if isinstance(pulse, type):
        raise TypeError(f"pulse_tau must be a time [s] or the shape of a pulse, got the class {pulse.__name__}")
    return pulse if callable(pulse) else GaussianPulse(check_positive(pulse, "pulse_tau", "s"))


# Greatest number of (time, point) pairs in memory at a time: 16 MiB of float64.
_BLOCK = 1 << 21  # speed only
# Greatest number of pulses that replace many, and the error of the replacement relative to the sum of the peaks.
MOST_PULSES, INTERPOLATED = 32, 1e-17


@checked
def pulse_tau_from_fwhm(fwhm: float) -> float:
    """Return the 1/e half-width tau [s] of a Gaussian pulse of full width at half maximum `fwhm` [s].

    Raises:
        ValueError: `fwhm` is not positive and finite.
    """
    return check_positive(fwhm, "fwhm", "s") / (2.0 * math.sqrt(math.log(2.0)))


@checked
def fwhm_from_pulse_tau(pulse_tau: float) -> float:
    """Return the full width at half maximum [s] of a Gaussian pulse of 1/e half-width `pulse_tau` [s].

    Raises:
        ValueError: `pulse_tau` is not positive and finite.
    """
    return check_positive(pulse_tau, "pulse_tau", "s") * 2.0 * math.sqrt(math.log(2.0))


@checked
def pulse_energy(peak_power: float, pulse_tau: float) -> float:
    """Return the energy [J] of a Gaussian pulse of peak power [W] and 1/e half-width [s].

    Raises:
        ValueError: One of them is not positive and finite.
    """
    return (
        check_positive(peak_power, "peak_power", "W") * check_positive(pulse_tau, "pulse_tau", "s") * math.sqrt(math.pi)
    )


@checked
def gaussian_pulse(time: Numbers, pulse_tau: float) -> np.ndarray:
    """Return a Gaussian pulse of peak 1 at t = 0, of the shape of `time` [s].

    Raises:
        ValueError: `pulse_tau` is not positive and finite, or `time` is not finite.
    """
    return np.exp(-np.square(as_finite_array(time, "time") / check_positive(pulse_tau, "pulse_tau", "s")))


def sum_of_pulses(time, delay, peak, pulse: PulseShape | float) -> np.ndarray:
    """Return the sum of delayed pulses, one per point: the right-hand side of eq 12 for given delays and peaks.

    Args:
        time: Times [s], any shape.
        delay: Time of each pulse's peak [s], shape (point_count,).
        peak: Peak power of each pulse [W], shape (point_count,).
        pulse: The pulse's shape; a number is the 1/e half-width of a Gaussian [s].

    Returns:
        Power [W], of the shape of `time`. 0 far from all pulses.

    Raises:
        ValueError: Shapes that disagree, numbers that are not finite, a `pulse` that is not positive.
    """
    times = as_finite_array(time, "time")
    delays, peaks = as_finite_array(delay, "delay"), as_finite_array(peak, "peak")
    shape = as_pulse(pulse)
    if delays.ndim != 1 or delays.shape != peaks.shape:
        raise ValueError(f"delay and peak must be lists of one length, got shapes {delays.shape} and {peaks.shape}")
    flat = times.ravel()
    power = np.zeros(flat.size)
    if delays.size:
        before, after = shape.support
        first, last = float(delays.min()), float(delays.max())
        positive = bool((peaks >= 0.0).all())
        if isinstance(shape, GaussianPulse):
            delays, peaks = fewer_gaussians(delays, peaks, shape.tau)
        # Pulses are summed over this many supports, so that a record cut at the support has no step at its ends.
        near = np.flatnonzero((flat > first + 1.5 * before) & (flat < last + 1.5 * after))
        rows = max(1, _BLOCK // delays.size)  # speed only
        for start in range(0, near.size, rows):
            block = near[start : start + rows]
            power[block] = shape(flat[block, None] - delays) @ peaks
        if positive:  # pulses that replace many have peaks of either sign, and rounding could make the sum negative
            np.maximum(power, 0.0, out=power)
    return power.reshape(times.shape)


def fewer_gaussians(delay: np.ndarray, peak: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray]:
    r"""Replace many Gaussian pulses by a few with the same sum to rounding, if they are close together.

    A pulse is a smooth function of its delay, so the polynomial through the pulses at k Chebyshev points represents it.
    Over a half range of R tau the error is at most 2.2 sqrt(2^k / k!) (R / 2)^k of the peak, since a Gaussian's k-th
    derivative is at most 1.09 sqrt(2^k k!) / tau^k (H. Cramer's bound of Hermite's functions).

    Args:
        delay: Time of each pulse's peak [s], shape (n,).
        peak: Peak of each pulse, shape (n,).
        tau: 1/e half-width [s].

    Returns:
        Delays [s] and peaks of the few pulses; unchanged if a few do not suffice.
    """
    middle, half = 0.5 * (delay.min() + delay.max()), 0.5 * float(np.ptp(delay))
    for count in range(2, min(delay.size // 4, MOST_PULSES) + 1):  # a sum that suffices is exact: speed only
        error = 2.2 * math.exp(0.5 * (count * math.log(2.0) - math.lgamma(count + 1.0))) * (0.5 * half / tau) ** count
        if error < INTERPOLATED:
            break
    else:
        return delay, peak
    from numpy.polynomial.chebyshev import chebvander

    node = np.cos(math.pi * (np.arange(count) + 0.5) / count)
    moment = peak @ chebvander((delay - middle) / half if half > 0.0 else np.zeros(delay.size), count - 1)
    moment[1:] *= 2.0
    return middle + half * node, chebvander(node, count - 1) @ moment / count
