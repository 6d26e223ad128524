"""Represent a sampled pulse of known shape by a smooth curve that uses the shape between the samples.

If there are few samples across the pulse, no interpolation of the samples alone is accurate, because the pulse's
content above half the sample rate is lost. (For a Gaussian with two samples across its width at half height, 10 ns, the
crossing of half the height has an error of up to 24 mm with the quintic spline, and of 15 mm with the best series for
band-limited records.) With a known shape s it is

    v(t) = A s(t - t0) + remainder,    A and t0 by least squares,

and only the remainder, noise and a small difference of shapes, is interpolated by the spline.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from aerokernels.echo.pulse_curve import PulseCurve

# Samples across the pulse from which the spline through them is accurate to 1e-6 of the peak.
ENOUGH_SAMPLES = 16
GREATEST_FACTOR = 32
ROUNDING = 1e-13
# Positions at which a match is evaluated in one call, and the tolerated relative error of the polynomial through them.
POINTS, SAME = 12, 1e-12

Shape = Callable[[np.ndarray], np.ndarray]


def shaped_curve(volts: np.ndarray, shape: Shape | None, period: float) -> PulseCurve:
    """Return the curve of a pulse, with more points than samples if there are few samples across the pulse.

    Args:
        volts: Samples, shape (n,).
        shape: The pulse as a function of time [s], of any amplitude and time zero; None: not known.
        period: Sample period [s].
    """
    factor = _upsampling_factor(volts)
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


def _upsampling_factor(volts: np.ndarray) -> int:
    """Return the factor by which samples must be finer to have enough of them across the pulse at the greatest one."""
    top = int(np.argmax(volts))
    below = np.flatnonzero(volts < 0.5 * volts[top])
    first = int(below[below < top].max(initial=-1))
    last = int(below[below > top].min(initial=volts.size))
    return min(GREATEST_FACTOR, math.ceil(ENOUGH_SAMPLES / max(last - first - 1, 1)))


def best_match(volts: np.ndarray, curve: Shape, period: float) -> tuple[float, float]:
    """Return the delay at which a pulse correlates best with the samples, and its amplitude there.

    Returns:
        Position of the pulse's time zero [samples], and the factor by which the pulse fits best.

    Raises:
        ValueError: As for `best_delay`, which has the same arguments.
    """
    start, offset = _best_delay(volts, curve, period)
    expected = curve((np.arange(volts.size) - start - offset) * period)
    return start + offset, float(volts @ expected) / (float(expected @ expected) or 1.0)


def best_delay(volts: np.ndarray, curve: Shape, period: float) -> float:
    """Return the delay at which a pulse correlates best with the samples.

    Args:
        volts: Samples, shape (n,).
        curve: The pulse as a function of time [s].
        period: Sample period [s].

    Returns:
        Position of the pulse's time zero [samples].

    Raises:
        ValueError: A pulse that is not finite, or no positive correlation anywhere.
    """
    return sum(_best_delay(volts, curve, period))


def _best_delay(volts: np.ndarray, curve: Shape, period: float) -> tuple[int, float]:
    """Return the sample nearest to the best delay, and the delay's difference from it [samples]."""
    from scipy.fft import irfft, next_fast_len, rfft

    count = volts.size
    transform_of = getattr(curve, "transform", None) or partial(template_transform, curve)
    transform, norm = transform_of(count, period)
    # Entry k of "valid" is the sum over i of volts[i] template(i - (count - 1 - k)): reversed, entry j is delay j.
    size = next_fast_len(2 * count - 1, real=True)
    coarse = irfft(transform * np.conj(rfft(volts, size)), size)[:count][::-1]
    start = int(np.argmax(coarse))
    # A correlation below this is rounding of the sum.
    least = ROUNDING * float(np.linalg.norm(volts)) * norm
    if np.ptp(volts) <= ROUNDING * float(np.abs(volts).max()):
        raise ValueError(f"there is no pulse: the record is {volts[0]:g} V throughout")
    if coarse[start] <= least:
        raise ValueError("the waveform has no positive correlation with the template anywhere: is a sign inverted?")
    places = np.arange(count) - start
    shifted = getattr(curve, "shifted", None) or partial(shifted_samples, curve)

    def match(shifts: np.ndarray) -> np.ndarray:
        # Normalised: the norm of a pulse of few samples changes with its position between the samples.
        expected, norm = shifted(places, shifts, period)
        return np.asarray(expected @ volts / np.where(norm > 0.0, norm, 1.0))

    low, high = max(-1.0, -float(start)), min(1.0, float(count - 1 - start))
    return start, greatest_within(match, low, high)


def shifted_samples(
    curve: Shape, places: np.ndarray, shifts: np.ndarray, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return a pulse at the positions of samples, shape (n,), moved by each of some shifts [samples], shape (s,).

    Returns:
        Its samples, shape (s, n), and the norm of each row, shape (s,).
    """
    expected = curve((places - shifts[:, None]).ravel() * period).reshape(shifts.size, places.size)
    return expected, np.sqrt(np.einsum("si,si->s", expected, expected))


def greatest_within(values: Callable[[np.ndarray], np.ndarray], low: float, high: float) -> float:
    """Return the position of a smooth function's maximum between two positions, from a polynomial at Chebyshev points.

    The function is evaluated at all points in one call. If the polynomial does not reproduce the function at the
    maximum, as for a pulse of about one sample, the function itself is searched.

    Args:
        values: The function of positions, shape (n,) for (n,).
        low: Lower end.
        high: Upper end.
    """
    from numpy.polynomial import chebyshev

    angle = np.pi * (np.arange(POINTS) + 0.5) / POINTS
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    found = values(middle + half * np.cos(angle))
    order = np.arange(POINTS)
    coefficients = 2.0 / POINTS * np.cos(order[:, None] * angle) @ found
    coefficients[0] *= 0.5
    size = float(np.abs(found).max())
    # Leave out negligible orders, so that rounding makes no roots.
    trimmed = chebyshev.chebtrim(coefficients, ROUNDING * size)
    if len(trimmed) < POINTS - 1 and np.isfinite(trimmed).all():
        roots = chebyshev.chebroots(chebyshev.chebder(trimmed)) if len(trimmed) > 2 else np.zeros(0)
        inner = roots.real[(np.abs(roots.imag) < 1e-6) & (np.abs(roots.real) < 1.0)]
        candidates = np.concatenate([inner, [-1.0, 1.0]])
        heights = chebyshev.chebval(candidates, trimmed)
        best = int(np.argmax(heights))
        position = middle + half * float(candidates[best])
        if abs(float(values(np.array([position]))[0]) - heights[best]) <= SAME * size:
            return position
    from scipy.optimize import minimize_scalar

    search = {"bounds": (low, high), "method": "bounded", "options": {"xatol": 1e-10}}
    return float(minimize_scalar(lambda position: -float(values(np.array([position]))[0]), **search).x)


def template_transform(curve: Shape, count: int, period: float) -> tuple[np.ndarray, float]:
    """Return the Fourier transform of a pulse at all delays of a record of `count` samples, and the samples' norm.

    Raises:
        ValueError: A pulse that is not finite.
    """
    from scipy.fft import next_fast_len, rfft

    samples = np.asarray(curve(np.arange(-(count - 1), count) * period), dtype=np.float64)
    if samples.shape != (2 * count - 1,) or not np.isfinite(samples).all():
        raise ValueError(f"the template must return one finite value for each time, got shape {samples.shape}")
    return rfft(samples, next_fast_len(samples.size, real=True)), float(np.linalg.norm(samples))
