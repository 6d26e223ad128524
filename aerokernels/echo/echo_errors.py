r"""What the numbers of an echo may be off by.

    Strehl ratio   S: the most that a phase error of rms e over the pupil changes (strehl_errors.py; it is concave in S,
                   so that the mean of it over points of the target is at most that of the mean S); to that the
                   interpolation over the target, and what half of the rays over the pupil change
    peak power     P is proportional to the return factor: P x (error of the factor) / factor; and what the samples'
                   place under the pulse changes
    peak voltage   the same, the noise's standard deviation, and half a code of the digitiser
    range          systematic: what the peak's error does to the reading (the walk of a fixed threshold, read off the
                   waveform scaled by 1 +- that share), what the samples' place under the pulse does, and e itself as a
                   length; random: the standard deviation of the range between noisy records

A number's error is the root sum of squares of its parts. Return factors "bucket" and "none" do not hang on phases.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..quantities import root_sum_square
from ..strehl_errors import strehl_error
from .result import EchoResult
from .uncertainty import EchoErrors, RangeUncertainty

# The sum over the beam's points is that good (target_points.py).
QUADRATURE = 1e-7
# Shares of a sample by which the echo is moved to see what the samples' place does.
SHIFTS = (0.25, 0.5, 0.75)
# Noisy records that the random error is read off where the scene asks for none.
TRIAL_COUNT = 32


@dataclass(frozen=True)
class EchoProbe:
    """What the errors of one echo are measured with; all of it is called when they are asked for.

    Attributes:
        phase_error: Rms phase error of rays over the receiver's pupil [rad].
        pupil_error: Change of the Strehl ratio of the view straight ahead when half of the pupil's rays are left out.
        read_scaled: Ranges by method [m] of the waveform without noise times a factor.
        read_shifted: What the vacuum's echo reads when it comes a share of a sample later: relative changes of its
            peak power and voltage, and the errors of its ranges by method [m].
        random_errors: Standard deviation of the range by method [m], and how many records it was read off.
        code_step: Voltage between two codes of the digitiser [V], 0 without one.
        wavelength: Wavelength [m].
        factor_of_phase: Whether the return factor is a Strehl ratio.
    """

    phase_error: Callable[[], float]
    pupil_error: Callable[[], float]
    read_scaled: Callable[[float], Mapping[str, float]]
    read_shifted: Callable[[float], tuple[tuple[float, float], Mapping[str, float]]]
    random_errors: Callable[[int], Mapping[str, float]]
    code_step: float
    wavelength: float
    factor_of_phase: bool


def echo_errors(result: EchoResult, probe: EchoProbe) -> EchoErrors:
    """Measure what an echo's numbers may be off by; the formulas stand above."""
    phase = probe.phase_error()
    interpolation = float(result.information["strehl_error"])
    if probe.factor_of_phase:
        strehl = root_sum_square((strehl_error(result.mean_strehl, phase), interpolation, probe.pupil_error()))
        share = strehl / result.mean_strehl if result.mean_strehl > 0.0 else math.inf
    else:
        strehl = (
            math.nan
            if math.isnan(result.mean_strehl)
            else root_sum_square((strehl_error(result.mean_strehl, phase), probe.pupil_error()))
        )
        factor = _mean_factor(result)
        share = interpolation / factor if factor > 0.0 else math.inf
    share = math.hypot(share, QUADRATURE)
    moved = [probe.read_shifted(shift) for shift in SHIFTS]
    heights = [max(abs(change[kind]) for change, _ in moved) for kind in (0, 1)]
    power, voltage = (
        math.hypot(share, height) * peak
        for height, peak in zip(heights, (result.peak_power, result.peak_voltage), strict=True)
    )
    noise = float(result.noise_rms)
    voltage = root_sum_square((voltage, noise, 0.5 * probe.code_step))
    random = probe.random_errors(TRIAL_COUNT) if noise > 0.0 else {}
    scaled = [probe.read_scaled(1.0 + sign * share) for sign in (0.0, 1.0, -1.0)] if 0.0 < share < 1.0 else []
    ranges = {}
    for method, value in result.ranges.items():
        if math.isnan(value):
            ranges[method] = RangeUncertainty(math.nan, math.nan)
            continue
        walk = max((abs(one[method] - scaled[0][method]) for one in scaled), default=math.nan)
        if any(math.isnan(one[method]) for one in scaled):  # within its error the echo may be lost
            walk = math.inf
        place = max(abs(found.get(method, math.nan)) for _, found in moved)
        path = 0.5 * probe.wavelength * phase / math.pi
        ranges[method] = RangeUncertainty(
            root_sum_square((walk, place, path)), random.get(method, math.nan) if noise > 0.0 else 0.0
        )
    return EchoErrors(strehl, power, voltage, ranges)


def _mean_factor(result: EchoResult) -> float:
    good = np.isfinite(result.return_factor) & (result.beam_share > 0.0)
    share = result.beam_share[good]
    return float(share @ result.return_factor[good] / share.sum()) if good.any() else math.nan
