"""Convert the waveform of an echo to a range = c t / 2 after the pulse's peak left, by one of four arrival times t.

| method              | arrival time                                                        | depends on the amplitude |
|---------------------|---------------------------------------------------------------------|--------------------------|
| "leading-edge"      | first rise through a fixed threshold                                | yes: range walk          |
| "constant-fraction" | last rise, before the peak, through `fraction` of the peak          | if the peak is cut off   |
| "centroid"          | centroid of the part above a tenth of the peak                      | if the peak is cut off   |
| "matched-filter"    | greatest correlation with a template: least variance in white noise | if the peak is cut off   |
"""

import math
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import (
    Waveform,
    as_finite_array,
    as_waveform,
    check_choice,
    check_positive,
    warn_caller,
)
from aerokernels.lidar.parts import RANGING_METHODS
from aerokernels.lidar.pulse_curve import CENTROID_FLOOR, PLATEAU, PulseCurve, Shape, best_delay, shaped_curve
from aerokernels.lidar.pulses import SPEED_OF_LIGHT

Template = Shape | np.ndarray


class CoarseSamplingWarning(UserWarning):
    """A record has too few samples across its pulse for the ranging method."""


class SaturatedRecordWarning(UserWarning):
    """A record's peak is cut off, and the ranging method depends on the peak."""


@checked
def estimate_range(
    time: Numbers,
    voltage: Numbers,
    method: str,
    *,
    threshold: float | None = None,
    template: Template | None = None,
    fraction: float = 0.5,
) -> float:
    """Return the range that a rangefinder reads from an echo.

    Args:
        time: Sample times after the pulse's peak left [s], shape (n,), in even steps.
        voltage: Samples [V], shape (n,), without offset.
        method: "leading-edge", "constant-fraction", "centroid" or "matched-filter".
        threshold: Level of the leading-edge discriminator [V]; the other methods do not use it.
        template: The expected pulse, a function of time [s] with t = 0 at its peak, or samples of it at the
            waveform's own period, whose time zero is the greatest sample. Its amplitude does not matter. Needed by
            "matched-filter". "constant-fraction" and "centroid" subtract the template's own reading, so that an echo
            of the template's shape reads the time of its zero; without a template they give the bare time of the
            crossing or of the centroid. "leading-edge" subtracts nothing: its offset depends on the amplitude, so
            calibrate it against a known echo instead. All methods use a template function to interpolate a record that
            has few samples across its pulse.
        fraction: Fraction of the peak at which "constant-fraction" triggers, between 0 and 1.

    Returns:
        Range [m].

    Warns:
        CoarseSamplingWarning: Fewer than five samples across the pulse, and no function as template.
        SaturatedRecordWarning: A peak that is cut off, with any method but "leading-edge".

    Raises:
        ValueError: The signal never crosses the threshold (the message states its peak), the record cuts the pulse, an
            argument that the method needs is missing, uneven times, shapes that disagree, an unknown method.
        TypeError: An argument that is not a number.

    Examples:
        >>> import numpy as np
        >>> time = np.arange(0.0, 40e-9, 1e-10)
        >>> voltage = np.exp(-(((time - 10e-9) / 6e-9) ** 2))
        >>> round(estimate_range(time, voltage, "centroid"), 3)
        1.499
    """
    waveform = as_waveform(time, voltage)
    reading = Reading(method, threshold, template, fraction)
    distance = reading.range_of(waveform)
    reading.warn(*waveform[1:])
    return distance


@dataclass(frozen=True, eq=False)
class Reading:
    """How ranges are read from records of one kind, by the arguments of `estimate_range`.

    `shape`, the pulse as a function of time [s], interpolates the samples; None: the template, if it is a function.
    """

    method: str
    threshold: float | None = None
    template: Template | None = None
    fraction: float = 0.5
    shape: Shape | None = None

    def __post_init__(self):
        """Check method, template, threshold and fraction."""
        check_choice(self.method, "method", RANGING_METHODS)
        if isinstance(self.template, type):
            name = self.template.__name__
            raise TypeError(f"template must be a function of time [s], or samples, got the class {name}")
        if self.method == "leading-edge" and self.threshold is not None:
            check_positive(self.threshold, "threshold", "V")
        if self.method == "constant-fraction" and check_positive(self.fraction, "fraction") >= 1.0:
            raise ValueError(f"fraction must lie between 0 and 1, got {self.fraction!r}")

    def range(self, time, voltage) -> float:
        """Return the range [m] of samples [V] at times [s], without a warning; raises as `estimate_range`."""
        return self.range_of(as_waveform(time, voltage))

    def range_of(self, waveform: Waveform, curve: PulseCurve | None = None) -> float:
        """Return the range [m] of a waveform from `as_waveform`; `curve` is its `shaped_curve`, if there already."""
        times, volts, period = waveform
        return 0.5 * SPEED_OF_LIGHT * (float(times[0]) + self._arrival(volts, period, curve) * period)

    def warn(self, volts: np.ndarray, period: float) -> None:
        """Warn of a peak that is cut off, or of too few samples across the pulse."""
        template, method = self.template, self.method
        if method != "leading-edge":
            cut = _cut_samples(volts, None if template is None else template_curve(template, period), period)
            if cut.stop > cut.start:
                warn_caller(
                    f"the {cut.stop - cut.start} samples at the record's peak are equal or level, as if an amplifier "
                    f"or digitiser saturated at {float(np.median(volts[cut])):.4g} V: if the pulse goes on above them, "
                    f"method {method!r} misreads it; attenuate the signal, raise the digitiser's range, or take "
                    "'leading-edge'",
                    SaturatedRecordWarning,
                )
                return
        if callable(template):
            return
        curve, across = PulseCurve(volts), math.inf
        with suppress(ValueError):  # a record that cuts the pulse
            across = curve.fall_after_peak(0.5 * curve.peak) - curve.rise_before_peak(0.5 * curve.peak)
        if across < 5.0:  # the spline is off by up to 3e-4 of a Gaussian's width
            warn_caller(
                f"the record has {across:.2g} samples across its pulse, too few for method {method!r}: sample faster, "
                "or give the pulse's shape as template (a function of time)",
                CoarseSamplingWarning,
            )

    def _arrival(self, volts: np.ndarray, period: float, curve: PulseCurve | None = None) -> float:
        """Position of arrival [samples]."""
        template = self.template
        if self.method == "matched-filter":
            if template is None:
                raise ValueError("method 'matched-filter' needs a template: a function of time, or the pulse's samples")
            shape = template_curve(template, period)
            delay = best_delay(volts, shape, period)
            _check_whole(shape, delay, volts.size, period)
            return delay
        if curve is None:
            curve = shaped_curve(volts, self.shape or (template if callable(template) else None), period)
        arrival = self._arrival_on(curve) / curve.upsampling
        if template is None or self.method == "leading-edge":
            return arrival
        samples, zero, upsampling = _template_samples(template, volts.size, period, curve.upsampling)
        return arrival - (self._arrival_on(PulseCurve(samples, is_whole=True)) - zero) / upsampling

    def _arrival_on(self, curve: PulseCurve) -> float:
        """Position of arrival on a curve [its samples] by one of the methods that need no template."""
        if self.method == "leading-edge":
            if self.threshold is None:
                raise ValueError("method 'leading-edge' needs a threshold [V]")
            return curve.first_rise(self.threshold)
        if self.method == "centroid":
            return curve.centroid
        return curve.rise_before_peak(self.fraction * curve.peak)


def _check_whole(template: Shape, delay: float, count: int, period: float) -> None:
    """Check that the record does not cut the matched pulse: a part of a pulse matches best elsewhere."""
    peak, first, last = np.abs(template((np.array([delay, 0.0, count - 1.0]) - delay) * period))
    for height, when, remedy in ((first, "begins", "begin earlier"), (last, "ends", "end later")):
        if height >= CENTROID_FLOOR * peak:
            raise ValueError(f"the record {when} within the pulse that matches best: let it {remedy}")


def template_curve(template: Template, period: float) -> Shape:
    """Return the template as a function of time [s], zero at its greatest sample; 0 outside samples at `period` [s]."""
    if callable(template):
        return template
    samples = _checked_samples(template)
    return partial(_at_time, PulseCurve(samples), int(np.argmax(samples)), period)


def _at_time(curve: PulseCurve, zero: int, period: float, time: np.ndarray) -> np.ndarray:
    return curve.at(np.asarray(time) / period + zero)


def _checked_samples(template) -> np.ndarray:
    samples = as_finite_array(template, "template")
    if samples.ndim != 1 or samples.size < 4:
        raise ValueError(f"a template needs a list of at least four samples, got shape {samples.shape}")
    if samples.max() <= 0.0:
        raise ValueError(f"a template needs a positive peak, its greatest sample is {samples.max():g}")
    return samples


def _template_samples(template: Template, count: int, period: float, upsampling: int) -> tuple[np.ndarray, int, int]:
    """Return the template's samples, the position of its time zero, and the number of samples per waveform period."""
    if callable(template):
        reach = count * upsampling
        times = np.arange(-reach, reach + 1) * (period / upsampling)
        return _checked_samples(template(times)), reach, upsampling
    samples = _checked_samples(template)
    return samples, int(np.argmax(samples)), 1


def _cut_samples(volts: np.ndarray, shape: Shape | None, period: float) -> slice:
    """Return the samples of a record's peak that an amplifier or a digitiser has cut off; none for a whole peak.

    They are equal, or level within the noise beside the pulse over more of its width than a rounded pulse's are. The
    pulse's `shape`, if it is known, may have a flat top of its own.
    """
    top = int(np.argmax(volts))
    level = float(volts[top])
    if not level > 0.0:
        return slice(0, 0)
    equal, above = _run(volts == level, top), _run(volts >= 0.5 * level, top)
    if _length(equal) >= PLATEAU:
        return equal if _length(equal) > _rounded(0.0, above, shape, period) + 1.0 else slice(0, 0)
    width = max(1, _length(above) // 6)  # of the running mean which reduces the noise
    smooth = np.convolve(volts, np.full(width, 1.0 / width), "same")
    top = above.start + int(np.argmax(smooth[above]))
    # A plateau lies within six standard deviations of the noise and is 1.6 times as wide as a rounded pulse there.
    depth = max(1e-3 * level, 6.0 * _noise(smooth, above))
    flat = _run(smooth >= smooth[top] - depth, top)
    wide = 1.6 * _rounded(depth / level, above, shape, period) + 2.0
    return flat if depth < 0.25 * level and _length(flat) > max(wide, PLATEAU) else slice(0, 0)


def _run(these: np.ndarray, place: int) -> slice:
    """Return the neighbours of a sample for which a condition holds without a gap."""
    others = np.flatnonzero(~these)
    before, after = others[others < place], others[others > place]
    return slice(int(before[-1]) + 1 if before.size else 0, int(after[0]) if after.size else these.size)


def _length(part: slice) -> int:
    return int(part.stop - part.start)


def _rounded(depth: float, above: slice, shape: Shape | None, period: float) -> float:
    """Return how many samples of a pulse lie within a share of its peak; it is Gaussian if its shape is not known."""
    if shape is None:
        return _length(above) * math.sqrt(depth / math.log(2.0))
    reach = 2 * _length(above)
    own = np.asarray(shape(np.arange(-reach, reach + 1) * period), dtype=np.float64)
    return float(np.count_nonzero(own >= own.max() * (1.0 - max(depth, 1e-12))))


def _noise(volts: np.ndarray, above: slice) -> float:
    """Return the standard deviation beside the pulse, by the median of deviations; 0 if few samples are beside it."""
    place, reach = np.arange(volts.size), 2 * _length(above)
    beside = volts[(place < above.start - reach) | (place >= above.stop + reach)]
    return 1.4826 * float(np.median(np.abs(beside - np.median(beside)))) if beside.size >= 8 else 0.0
