"""Convert the waveform of an echo to a range, by one of four definitions of its arrival time.

t = 0 is the moment at which the pulse's peak leaves, and range = c t / 2.

| method              | arrival time                                                       | depends on the amplitude |
|---------------------|--------------------------------------------------------------------|--------------------------|
| "leading-edge"      | first rise through a fixed threshold                               | yes: range walk          |
| "constant-fraction" | last rise, before the peak, through `fraction` of the peak         | if the peak is cut off   |
| "centroid"          | centroid of the part above a tenth of the peak                     | if the peak is cut off   |
| "matched-filter"    | greatest correlation with a template: least variance in white noise | if the peak is cut off  |

A Gaussian pulse of peak V and 1/e half-width tau, arriving at t0, crosses a threshold T at t0 - tau sqrt(ln(V / T)).
All four interpolate between the samples: with the spline through them (`pulse_curve.py`) or, if the pulse's shape is
given as a function, with that shape (`shaped_curve`), which is accurate however few samples there are. If there are
too few samples and no shape, a warning states the size of the error (`doubtful_records.py`). No offset is removed from
the voltage: subtract the baseline first.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import Waveform, as_finite_array, as_waveform, check_choice, check_positive
from aerokernels.lidar.doubtful_records import sampling_error, warn_of_sampling, warn_of_saturation
from aerokernels.lidar.parts import RANGING_METHODS
from aerokernels.lidar.pulse_curve import CENTROID_FLOOR, PulseCurve, Shape, best_delay, shaped_curve
from aerokernels.lidar.pulses import SPEED_OF_LIGHT

AMPLITUDE_METHODS = ("leading-edge",)  # methods whose reading depends on the amplitude

Template = Shape | np.ndarray


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
        CoarseSamplingWarning: Too few samples across the pulse for the method; states the resulting error.
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
    """How ranges are read from records of one kind.

    Attributes:
        method: As for `estimate_range`.
        threshold: As for `estimate_range` [V].
        template: As for `estimate_range`.
        fraction: As for `estimate_range`.
        shape: The pulse as a function of time [s], used to interpolate the samples; None: the template, if it is a
            function.

    Raises:
        ValueError: An unknown method.
        TypeError: A template that is a class.
    """

    method: str
    threshold: float | None = None
    template: Template | None = None
    fraction: float = 0.5
    shape: Shape | None = None

    def __post_init__(self):
        """Check method and template."""
        check_choice(self.method, "method", RANGING_METHODS)
        if isinstance(self.template, type):
            name = self.template.__name__
            raise TypeError(f"template must be a function of time [s], or samples, got the class {name}")

    def range(self, time, voltage) -> float:
        """Return the range [m] of samples [V] at times [s], without a warning; raises as `estimate_range`."""
        return self.range_of(as_waveform(time, voltage))

    def range_of(self, waveform: Waveform, curve: PulseCurve | None = None) -> float:
        """Return the range [m] of a waveform from `as_waveform`; `curve` is its `shaped_curve`, if there already."""
        times, volts, period = waveform
        return 0.5 * SPEED_OF_LIGHT * (float(times[0]) + self._arrival(volts, period, curve) * period)

    def sampling_error(self, volts: np.ndarray, period: float) -> float:
        """Greatest error [m] due to the position of a record's pulse between its samples: see doubtful_records.py."""
        template = self.template
        if template is not None and not callable(template):
            template = _checked_samples(template)

        def read(samples: np.ndarray, known: Template | None) -> float:
            return replace(self, template=known, shape=None)._arrival(samples, period)

        return sampling_error(volts, period, read, template, self.method != "leading-edge")

    def warn(self, volts: np.ndarray, period: float) -> float:
        """Warn of a sampling error above the tolerated one or of a peak that is cut off; return the former [m]."""
        error = self.sampling_error(volts, period)
        if self.method not in AMPLITUDE_METHODS:
            shape = self.shape
            if shape is None and self.template is not None:
                shape = template_curve(self.template, period)
            if warn_of_saturation(volts, period, self.method, shape):
                return error
        warn_of_sampling(volts, period, self.method, error, self.template is not None)
        return error

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
            return curve.first_rise(check_positive(self.threshold, "threshold", "V"))
        if self.method == "centroid":
            return curve.centroid
        share = check_positive(self.fraction, "fraction")
        if share >= 1.0:
            raise ValueError(f"fraction must lie between 0 and 1, got {self.fraction!r}")
        return curve.rise_before_peak(share * curve.peak)


def _check_whole(template: Shape, delay: float, count: int, period: float) -> None:
    """Check that the record does not cut the matched pulse: a part of a pulse matches best elsewhere."""
    peak, first, last = np.abs(template((np.array([delay, 0.0, count - 1.0]) - delay) * period))
    for height, when, remedy in ((first, "begins", "begin earlier"), (last, "ends", "end later")):
        if height >= CENTROID_FLOOR * peak:
            raise ValueError(f"the record {when} within the pulse that matches best: let it {remedy}")


@dataclass(frozen=True, eq=False)
class SampledTemplate:
    """A template's samples as a function of time [s], zero at the greatest sample; 0 outside the samples.

    Attributes:
        samples: The samples, shape (k,).
        period: Sample period [s].
        curve: The curve through the samples.
    """

    samples: np.ndarray
    period: float
    curve: PulseCurve

    def __call__(self, time: np.ndarray) -> np.ndarray:
        """Return the template at times [s]."""
        return self.curve.at(np.asarray(time) / self.period + int(np.argmax(self.samples)))


def template_curve(template: Template, period: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the template as a function of time [s], zero at its peak; 0 outside given samples.

    Args:
        template: A function, returned unchanged, or samples, shape (k,), at the period given.
        period: Sample period [s].

    Raises:
        ValueError: Samples that are not finite, not a list, fewer than four, or without a positive value.
    """
    if callable(template):
        return template
    samples = _checked_samples(template)
    return SampledTemplate(samples, period, PulseCurve(samples))


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
