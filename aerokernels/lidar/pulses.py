"""Define the shapes of a laser pulse in time, each of peak 1 at t = 0, the moment at which the pulse's peak leaves.

| shape    | formula, t from the peak                                        | width at half height | integral       |
|----------|-----------------------------------------------------------------|----------------------|----------------|
| Gaussian | exp(-(t / tau)^2)                                               | 1.6651 tau           | sqrt(pi) tau   |
| HELIOS   | u^2 exp(-u) e^2 / 4, u = t / tau + 2 (0 before u = 0)           | 3.3947 tau           | e^2 / 2 tau    |
| sampled  | the spline through given samples, not below 0; 0 outside of them | the samples'         | the spline's   |

HELIOS: T. Carlsson, O. Steinvall, D. Letalick, Signature simulation and signal analysis for 3-D laser radar,
FOI-R-0163-SE (2001).
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import as_finite_array, check_positive
from aerokernels.lidar.pulse_curve import PulseCurve

SPEED_OF_LIGHT = 299_792_458.0  # in vacuum [m/s], exact


class PulseShape(Protocol):
    """The shape of a pulse: a function of time [s] with the peak 1 at t = 0, and two properties.

    Attributes:
        support: Times [s] before and after which the shape is negligible, below 1e-12 of the peak.
        timescale: Time [s] over which the shape changes; eight samples per timescale resolve the shape.
    """

    @property
    def support(self) -> tuple[float, float]: ...  # noqa: D102

    @property
    def timescale(self) -> float: ...  # noqa: D102

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
        tau: 1/e half-width [s], positive.
    """

    @property
    def support(self) -> tuple[float, float]:
        """Times [s] at which 2e-16 of the peak is left."""
        return -6.0 * self.tau, 6.0 * self.tau

    @checked
    def __call__(self, time: Numbers) -> np.ndarray:
        """Return the shape at times [s] after the peak."""
        values = np.array(np.asarray(time, dtype=np.float64) / self.tau)
        for step in (np.square, np.negative, np.exp):  # in place: an echo evaluates millions of these
            step(values, out=values)
        return values


@checked
@dataclass(frozen=True)
class HeliosPulse(_OfTau):
    """(t / tau)^2 exp(-t / tau), with t = 0 shifted to the peak.

    Attributes:
        tau: Time constant [s], positive.
    """

    @property
    def support(self) -> tuple[float, float]:
        """Times [s] before which the pulse is 0, and after which less than 2e-13 of the peak is left."""
        return -2.0 * self.tau, 34.0 * self.tau

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
    """

    @checked
    def __init__(self, samples: Numbers, period: float):
        """Check, fit the curve and find its peak."""
        values = as_finite_array(samples, "pulse samples")
        if values.ndim != 1 or values.size < 4:
            raise ValueError(f"a sampled pulse needs a list of at least 4 samples, got {values.shape}")
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

    @checked
    def __call__(self, time: Numbers) -> np.ndarray:
        """Return the shape at times [s] after the peak."""
        position = np.asarray(time, dtype=np.float64) / self.period + self._curve.peak_position
        return np.maximum(self._curve.at(position) / self._curve.peak, 0.0)


def as_pulse(pulse: PulseShape | float) -> PulseShape:
    """Return a pulse shape unchanged; a number is the tau [s] of a Gaussian."""
    if isinstance(pulse, type):
        raise TypeError(f"pulse_tau must be a time [s] or the shape of a pulse, got the class {pulse.__name__}")
    return pulse if callable(pulse) else GaussianPulse(check_positive(pulse, "pulse_tau", "s"))


@checked
def pulse_tau_from_fwhm(fwhm: float) -> float:
    """Return the 1/e half-width tau [s] of a Gaussian pulse of full width at half maximum `fwhm` [s]."""
    return check_positive(fwhm, "fwhm", "s") / (2.0 * math.sqrt(math.log(2.0)))


@checked
def fwhm_from_pulse_tau(pulse_tau: float) -> float:
    """Return the full width at half maximum [s] of a Gaussian pulse of 1/e half-width `pulse_tau` [s]."""
    return check_positive(pulse_tau, "pulse_tau", "s") * 2.0 * math.sqrt(math.log(2.0))


def sum_of_pulses(time, delay, peak, pulse: PulseShape | float) -> np.ndarray:
    """Return the sum of delayed pulses [W], the right-hand side of eq 12, of the shape of `time` [s].

    Args:
        time: Times [s], any shape.
        delay: Time of each pulse's peak [s], shape (point_count,).
        peak: Peak power of each pulse [W], shape (point_count,).
        pulse: The pulse's shape; a number is the 1/e half-width of a Gaussian [s].
    """
    times, delays, peaks = np.asarray(time, dtype=np.float64), np.asarray(delay), np.asarray(peak)
    shape = as_pulse(pulse)
    flat = times.ravel()
    power = np.zeros(flat.size)
    if delays.size:
        before, after = shape.support
        # Pulses are summed over this many supports, so that a record cut at the support has no step at its ends.
        near = np.flatnonzero((flat > delays.min() + 1.5 * before) & (flat < delays.max() + 1.5 * after))
        rows = max(1, (1 << 21) // delays.size)  # 16 MiB at a time: speed only
        for start in range(0, near.size, rows):
            block = near[start : start + rows]
            power[block] = shape(flat[block, None] - delays) @ peaks
    return power.reshape(times.shape)
