"""Convert widths and energy of a Gaussian laser pulse, and sum many delayed pulses of any shape (pulses.py).

    p(t) = P0 exp(-(t / tau)^2),   FWHM = 2 sqrt(ln 2) tau,   energy = P0 tau sqrt(pi)

t = 0 is the moment at which the pulse's peak leaves. Times [s], powers [W], energies [J].
"""

import math

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import as_finite_array, check_positive
from .pulses import GaussianPulse, PulseShape, as_pulse

SPEED_OF_LIGHT = 299_792_458.0  # in vacuum [m/s], exact
# Pulses are summed over this many supports, so that a record cut at the support has no step at its ends.
_REACH = 1.5
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
        near = np.flatnonzero((flat > first + _REACH * before) & (flat < last + _REACH * after))
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
