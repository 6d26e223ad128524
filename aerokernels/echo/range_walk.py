"""Compute the range walk of a fixed threshold (the dependence of its range on amplitude), and correct ranges by it.

A higher pulse crosses a threshold T earlier. For a Gaussian of peak V and 1/e half-width tau the crossing is
tau sqrt(ln(V / T)) before the peak, so its range is short by c tau sqrt(ln(V / T)) / 2. For any other pulse the curve
is measured: the waveform is scaled to a series of amplitudes, each of which is ranged. A rangefinder takes the
amplitude of an echo from its peak or, if the amplifier saturates, from the time for which the echo is above the
threshold.
"""

from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import as_waveform, check_at_least, check_positive
from .pulse_curve import PulseCurve, peak_height
from .waveform import SPEED_OF_LIGHT

# The curve's points are evenly spaced in sqrt(ln(V / T)), in which the walk of a Gaussian is a straight line.
POINT_COUNT = 128
LEAST_RATIO, GREATEST_RATIO = 1.0005, 1000.0


@dataclass(frozen=True, eq=False)
class RangeWalk:
    """Error of a leading-edge range as a function of the pulse's height, or of its width.

    Attributes:
        threshold: Level of the discriminator [V].
        peak: Peaks of the echo [V], increasing, shape (n,).
        width: Time for which an echo of that peak is above the threshold [s], increasing, shape (n,).
        error: Range by the threshold minus the range by the time of the peak [m], shape (n,); negative, decreasing.
    """

    threshold: float
    peak: np.ndarray
    width: np.ndarray
    error: np.ndarray

    @checked
    def at_peak(self, peak: float) -> float:
        """Return the error [m] of an echo of this peak [V].

        Raises:
            ValueError: The peak is outside the curve.
        """
        volts = _check_inside(peak, self.peak, "peak", "V", ": lower or raise the threshold")
        return self._interpolated(_stretched(self.peak / self.threshold), _stretched(volts / self.threshold))

    @checked
    def at_width(self, width: float) -> float:
        """Return the error [m] of an echo that is above the threshold for this time [s].

        Raises:
            ValueError: The time is outside the curve.
        """
        return self._interpolated(self.width, _check_inside(width, self.width, "width", "s"))

    @checked
    def correct(self, time: Numbers, voltage: Numbers, reading: float, *, peak: float | None = None) -> float:
        """Subtract from a leading-edge range [m] the error of an echo of this waveform's peak.

        Args:
            time: Sample times [s], shape (n,), in even steps.
            voltage: Samples [V], shape (n,).
            reading: The leading-edge range [m].
            peak: Height of the pulse [V], if it is known better than from the samples.

        Raises:
            ValueError: A peak outside the curve, a waveform without a peak.
        """
        _, volts, _ = as_waveform(time, voltage)
        return check_at_least(reading, "reading") - self.at_peak(peak_height(volts) if peak is None else peak)

    def _interpolated(self, nodes: np.ndarray, at: float) -> float:
        from scipy.interpolate import PchipInterpolator

        return float(PchipInterpolator(nodes, self.error)(at))


def _check_inside(value: float, nodes: np.ndarray, name: str, unit: str, remedy: str = "") -> float:
    number = check_positive(value, name, unit)
    if not nodes[0] <= number <= nodes[-1]:
        raise ValueError(
            f"a {name} of {number:g} {unit} is outside the range walk curve, "
            f"{nodes[0]:g} to {nodes[-1]:g} {unit}{remedy}"
        )
    return number


def _stretched(ratio):
    return np.sqrt(np.log(ratio))


@checked
def range_walk(time: Numbers, voltage: Numbers, threshold: float) -> RangeWalk:
    """Compute the range walk curve of a threshold for pulses of one shape.

    Args:
        time: Sample times of a clean pulse [s], shape (n,), in even steps.
        voltage: Its samples [V], shape (n,), of any height.
        threshold: Level of the discriminator [V].

    Returns:
        The curve, for peaks from just above the threshold to 1000 times the threshold; up to lower peaks if the record
        cuts the pulse off before it has fallen to a thousandth.

    Raises:
        ValueError: Uneven times, no pulse, or a pulse that is cut off at half its height.
    """
    _, volts, period = as_waveform(time, voltage)
    level = check_positive(threshold, "threshold", "V")
    curve = PulseCurve(volts)
    ends = max(float(volts[0]), float(volts[-1]), 0.0) / curve.peak
    greatest = min(GREATEST_RATIO, 0.999 / ends) if ends > 0.0 else GREATEST_RATIO
    if greatest < 2.0:
        raise ValueError("the record cuts the pulse off above half its height: begin it earlier or end it later")
    ratios = np.exp(np.square(np.linspace(_stretched(LEAST_RATIO), _stretched(greatest), POINT_COUNT)))
    rises = np.array([curve.first_rise(curve.peak / ratio) for ratio in ratios])
    falls = np.array([curve.fall_after_peak(curve.peak / ratio) for ratio in ratios])
    error = 0.5 * SPEED_OF_LIGHT * period * (rises - curve.peak_position)
    return RangeWalk(level, level * ratios, period * (falls - rises), error)
