"""From an echo's waveform to a range: four ways to say when it arrived.

t = 0 is the moment at which the pulse's peak leaves, and range = c t / 2.

| method              | arrival time                                                       | depends on the amplitude |
|---------------------|--------------------------------------------------------------------|--------------------------|
| "leading-edge"      | first rise through a fixed threshold                               | yes: range walk          |
| "constant-fraction" | last rise, before the peak, through `fraction` of the peak         | no                       |
| "centroid"          | centroid of what stands above a tenth of the peak                  | no                       |
| "matched-filter"    | greatest correlation with a template: least variance in white noise | no                       |

A Gaussian pulse of peak V and 1/e half-width tau, arriving at t0, crosses a threshold T at t0 - tau sqrt(ln(V / T)).
All four work between the samples (see `pulse_curve.py`). No offset is removed from the voltage: take the
baseline off first.
"""

from collections.abc import Callable

import numpy as np

from .checks import as_finite_array, as_waveform, check_choice, check_positive
from .pulse_curve import PulseCurve
from .waveform import SPEED_OF_LIGHT

RANGING_METHODS = ("leading-edge", "constant-fraction", "centroid", "matched-filter")
ROUNDING = 1e-13

Template = Callable[[np.ndarray], np.ndarray] | np.ndarray


def estimate_range(
    time,
    voltage,
    method: str,
    *,
    threshold: float | None = None,
    template: Template | None = None,
    fraction: float = 0.5,
) -> float:
    """Range that a rangefinder reads off an echo.

    Args:
        time: Sample times after the pulse's peak left [s], shape (n,), in even steps.
        voltage: Samples [V], shape (n,), without offset.
        method: "leading-edge", "constant-fraction", "centroid" or "matched-filter".
        threshold: Level of the leading-edge discriminator [V]; needed there, not used by the others.
        template: The expected pulse, a function of time [s] with t = 0 at its peak, or samples of it at the
            waveform's own period, whose time zero is the greatest sample. Its amplitude does not matter. Needed by
            "matched-filter". "constant-fraction" and "centroid" subtract the template's own reading, so that an echo
            of the template's shape reads the time of its zero; without a template they give the bare time of the
            crossing or of the centroid. "leading-edge" does not use it: its offset depends on the amplitude, so that
            it is calibrated against a known echo instead.
        fraction: Share of the peak at which "constant-fraction" triggers, between 0 and 1.

    Returns:
        Range [m].

    Raises:
        ValueError: The signal never crosses the threshold (the message says its peak), the record cuts the pulse, an
            argument that the method needs is missing, uneven times, shapes that disagree, an unknown method.
        TypeError: An argument that is not a number.
    """
    check_choice(method, "method", RANGING_METHODS)
    times, volts, period = as_waveform(time, voltage)
    if method == "matched-filter":
        if template is None:
            raise ValueError("method 'matched-filter' needs a template: a function of time, or samples of the pulse")
        place = _best_match(volts, template_curve(template, period), period)
    else:
        place = _arrival(PulseCurve(volts), method, threshold, fraction)
        if template is not None and method != "leading-edge":
            samples, zero = _template_samples(template, volts.size, period)
            place -= _arrival(PulseCurve(samples), method, None, fraction) - zero
    return 0.5 * SPEED_OF_LIGHT * (float(times[0]) + place * period)


def _arrival(curve: PulseCurve, method: str, threshold: float | None, fraction: float) -> float:
    """Place of arrival [samples] by one of the methods that need no template."""
    if method == "leading-edge":
        if threshold is None:
            raise ValueError("method 'leading-edge' needs a threshold [V]")
        return curve.first_rise(check_positive(threshold, "threshold", "V"))
    if method == "centroid":
        return curve.centroid
    share = check_positive(fraction, "fraction")
    if share >= 1.0:
        raise ValueError(f"fraction must lie between 0 and 1, got {fraction!r}")
    return curve.rise_before_peak(share * curve.peak)


def template_curve(template: Template, period: float) -> Callable[[np.ndarray], np.ndarray]:
    """The template as a function of time [s], zero at its peak; 0 outside of given samples.

    Args:
        template: A function, returned as it is, or samples, shape (k,), at the period given.
        period: Sample period [s].

    Raises:
        ValueError: Samples that are not finite, not a list, fewer than four, or without a positive value.
    """
    if callable(template):
        return template
    samples = _checked_samples(template)
    curve = PulseCurve(samples)
    zero, last = int(np.argmax(samples)), samples.size - 1

    def evaluate(time: np.ndarray) -> np.ndarray:
        place = np.asarray(time) / period + zero
        inside = (place >= 0.0) & (place <= last)
        return np.where(inside, curve.spline(np.clip(place, 0.0, last)), 0.0)

    return evaluate


def _checked_samples(template) -> np.ndarray:
    samples = as_finite_array(template, "template")
    if samples.ndim != 1 or samples.size < 4:
        raise ValueError(f"a template needs a list of at least four samples, got shape {samples.shape}")
    if samples.max() <= 0.0:
        raise ValueError(f"a template needs a positive peak, its greatest sample is {samples.max():g}")
    return samples


def _template_samples(template: Template, count: int, period: float) -> tuple[np.ndarray, int]:
    """The template's samples at the waveform's period, and the place of its time zero."""
    if callable(template):
        places = np.arange(-count, count + 1)
        return _checked_samples(template(places * period)), count
    samples = _checked_samples(template)
    return samples, int(np.argmax(samples))


def _best_match(volts: np.ndarray, curve: Callable[[np.ndarray], np.ndarray], period: float) -> float:
    """Place of the template's zero [samples] at which its correlation with the samples is greatest."""
    from scipy.fft import irfft, next_fast_len, rfft
    from scipy.optimize import minimize_scalar

    count = volts.size
    samples = np.asarray(curve(np.arange(-(count - 1), count) * period), dtype=np.float64)
    if samples.shape != (2 * count - 1,) or not np.isfinite(samples).all():
        raise ValueError(f"the template must return one finite value for each time, got shape {samples.shape}")
    # Entry k of "valid" is the sum over i of volts[i] template(i - (count - 1 - k)): turned round, entry j is delay j.
    size = next_fast_len(samples.size, real=True)
    coarse = irfft(rfft(samples, size) * np.conj(rfft(volts, size)), size)[:count][::-1]
    start = int(np.argmax(coarse))
    # Less than this is rounding of the sum.
    least = ROUNDING * float(np.linalg.norm(volts)) * float(np.linalg.norm(samples))
    if coarse[start] <= least:
        raise ValueError("the waveform has no positive correlation with the template anywhere: is a sign turned?")
    places = np.arange(count) - start

    def mismatch(shift: float) -> float:
        # Over its norm: a pulse of few samples has more or less of them near its peak as it moves between the samples.
        expected = curve((places - shift) * period)
        return -float(volts @ expected) / (float(np.linalg.norm(expected)) or 1.0)

    low, high = max(-1.0, -float(start)), min(1.0, float(count - 1 - start))
    found = minimize_scalar(mismatch, bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    return start + float(found.x)
