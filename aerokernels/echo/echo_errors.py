r"""Compute the errors of an echo's numbers.

    Strehl ratio   the greatest change of S that a phase error of rms e over the pupil can cause (strehl_errors.py; this
                   bound is concave in S, so its mean over the target points is at most its value at the mean S), the
                   error of the interpolation over the target, and the change of S with more rays over the pupil
                   (pupil_errors.py)
    peak power     P is proportional to the return factor: P x (error of the factor) / factor; the error of the pupil's
                   open share if a body blocks a part of the pupil; the error of the beam's lost share if a body cuts
                   the beam (cut_beam.py); and the greatest error of the peak over positions of the samples on the
                   pulse, against the pulse between them
    peak voltage   as for the power; and two standard deviations of the noise at the peak, and half a digitiser code
    range          systematic: the change of the reading with the error of the peak, read off the waveform scaled by
                   1 +- the relative error (range walk of a fixed threshold; every method if the peak is cut off); the
                   change of the reading with the position of the samples; the change by rounding this waveform to the
                   digitiser's codes if there is no noise to dither them; e as a length; and the refractivity model's
                   uncertainty of the group path, as a mean over the beam.
                   random: the standard deviation of the range over noisy records

The error of a number is the root sum of squares of its parts, of the random one twice. The return factors "bucket" and
"none" do not depend on phases.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..display.quantities import root_sum_square
from ..medium import IndexField
from ..scene import Scene
from ..strehl import StrehlEstimate
from ..wavefront.strehl_errors import strehl_error
from .pulse_curve import PulseCurve, peak_height
from .pupil_errors import OPEN, is_blocked, open_share_error, own_phase_error, pupil_error
from .rangefinder import Rangefinder
from .ranging import AMPLITUDE_METHODS, RANGING_METHODS
from .result import EchoResult
from .uncertainty import SPREADS, EchoErrors, RangeUncertainty
from .vacuum import VacuumEcho
from .waveform import SPEED_OF_LIGHT

# Relative error of the sum over the beam's points (target_points.py).
QUADRATURE = 1e-7
# Fractions of a sample period by which the echo is delayed to measure the effect of the samples' position.
SHIFTS = tuple(k / 8 for k in range(8))
# Noise above this fraction of a code dithers the codes: their errors are then random.
DITHER = 0.5
# Target points at which the error of a partly blocked pupil is measured.
BLOCKED_POINTS = 16
# Noisy records from which the random error is measured.
TRIAL_COUNT = 32


@dataclass(frozen=True, eq=False)
class EchoProbe:
    """Everything an echo was computed from, to compute its errors on demand.

    Attributes:
        field: The refractive index of the flow.
        known_phase_error: Rms phase error of rays over the receiver's pupil [rad], or a Strehl estimate that provides
            it; None: a small estimate is made.
        vacuum: The echo without flow.
        time: Sample times [s].
        fine: Times at which power is computed [s], shape (n,).
        stride: Number of these times per sample period.
        power: Received power at the times `fine` [W], shape (n,).
        clean: Voltage of the samples without noise [V].
        rangefinder: Reads ranges.
        air_error: Error of the group path due to the refractivity model, mean over the beam [m].
    """

    field: IndexField
    known_phase_error: float | StrehlEstimate | None
    vacuum: VacuumEcho
    time: np.ndarray
    fine: np.ndarray
    stride: int
    power: np.ndarray
    clean: np.ndarray
    rangefinder: Rangefinder
    air_error: float = 0.0

    @cached_property
    def vacuum_peaks(self) -> tuple[float, float]:
        """Peak power [W] and voltage [V] of the echo in vacuum, between its samples too."""
        power = self.vacuum.power(self.fine)
        return peak_height(power), peak_height(self.vacuum.chain.voltage(self.fine, power))

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.vacuum.scene

    @property
    def code_step(self) -> float:
        """Voltage between two codes of the digitiser [V], 0 without one."""
        digitiser = self.vacuum.chain.digitiser
        return 0.0 if digitiser is None else digitiser.step

    def phase_error(self) -> float:
        """Rms phase error of rays over the receiver's pupil [rad]."""
        known = self.known_phase_error
        if isinstance(known, StrehlEstimate):
            return known.phase_error
        return own_phase_error(self.scene, self.field) if known is None else float(known)

    def read_scaled(self, *factors: float) -> list[dict[str, float]]:
        """Return the ranges [m] of the noise-free waveform times each factor, by methods that depend on amplitude.

        If the amplifier or the digitiser cuts one of these waveforms off, that is every method.
        """
        chain = self.vacuum.chain
        linear = self.clean if chain.saturation is None else chain.linear_voltage(self.fine, self.power)[:: self.stride]
        scaled = [factor * linear for factor in factors]
        clipped = [chain.clipped(volts) for volts in scaled]
        is_cut = not all(map(np.array_equal, clipped, scaled))
        return self._read(clipped, RANGING_METHODS if is_cut else AMPLITUDE_METHODS)

    def read_digitised(self) -> dict[str, float]:
        """Return the change of the noise-free waveform's range by the rounding to codes [m], by method."""
        chain = self.vacuum.chain
        if chain.digitiser is None:
            return {}
        read = self._read([chain.digitise(self.clean), chain.clipped(self.clean)])
        return {method: abs(value - read[1][method]) for method, value in read[0].items()}

    def read_shifted(self, *shares: float) -> list[tuple[tuple[float, float], dict[str, float]]]:
        """Read the echo in vacuum when it arrives a fraction of a sample later, for each fraction.

        Returns:
            Relative errors of its peak power and voltage, and the errors of its ranges by method [m].
        """
        shifts = [share * (self.time[1] - self.time[0]) for share in shares]
        fine = [self.vacuum.power(self.fine, shift) for shift in shifts]
        power = [one[:: self.stride] for one in fine]
        volts = [self.vacuum.chain.voltage(self.fine, one)[:: self.stride] for one in fine]
        curves = PulseCurve.of_each([*power, *volts])
        of_power, of_volts = curves[: len(shares)], curves[len(shares) :]
        found = []
        for k, shift in enumerate(shifts):
            weaker = peak_height(power[k], of_power[k]) / self.vacuum_peaks[0] - 1.0
            lower = peak_height(volts[k], of_volts[k]) / self.vacuum_peaks[1] - 1.0
            true = self.scene.target.distance + 0.5 * SPEED_OF_LIGHT * shift
            read = self.rangefinder.ranges(self.time, volts[k], curve=of_volts[k])[0]
            found.append(((weaker, lower), {name: value - true for name, value in read.items()}))
        return found

    def _read(self, records: list[np.ndarray], methods: Sequence[str] = RANGING_METHODS) -> list[dict[str, float]]:
        """Return the ranges of records by method [m]."""
        curves = PulseCurve.of_each(records)
        return [
            self.rangefinder.ranges(self.time, record, methods, curve)[0]
            for record, curve in zip(records, curves, strict=True)
        ]

    def random_errors(self, count: int) -> dict[str, float]:
        """Return the standard deviation of the range by method [m] over `count` noisy records."""
        found = self.rangefinder.statistics(self.scene, self.fine, self.power, self.stride, count)
        return {name: one.random_error for name, one in found.items()}


def echo_errors(result: EchoResult, probe: EchoProbe) -> EchoErrors:
    """Compute the errors of an echo's numbers by the rules in this module's docstring."""
    phase, strehl = probe.phase_error(), math.nan
    interpolation = float(result.information["strehl_error"])
    depends_on_phases = probe.scene.receiver.return_factor == "strehl"
    if depends_on_phases or not math.isnan(result.mean_strehl):
        causes = strehl_error(result.mean_strehl, phase), pupil_error(probe.scene, probe.field)
        strehl = root_sum_square((causes[0], interpolation, causes[1]) if depends_on_phases else causes)
    factor_error = strehl if depends_on_phases else interpolation
    factor = result.mean_strehl if depends_on_phases else result.beam_mean(result.return_factor)
    blocked = _blocked_pupil_error(result, probe)
    left = result.information["lost_share_error"] / result.information["beam_share"]
    share = root_sum_square((factor_error / factor if factor > 0.0 else math.inf, blocked, left, QUADRATURE))
    moved = probe.read_shifted(*SHIFTS)
    # Relative to the height that was read, which may be the lower one.
    heights = [max(abs(change[kind]) / min(1.0 + change[kind], 1.0) for change, _ in moved) for kind in (0, 1)]
    power, voltage = (
        math.hypot(share, height) * peak
        for height, peak in zip(heights, (result.peak_power, result.peak_voltage), strict=True)
    )
    noise, peak_noise = float(result.noise_rms), 0.0
    if noise > 0.0:  # the signal's own shot noise may be many times the noise between echoes
        peak_noise = probe.vacuum.chain.noise_rms(result.peak_power, probe.scene.detector.sample_rate)
    voltage = root_sum_square((voltage, SPREADS * peak_noise, 0.5 * probe.code_step))
    random = probe.random_errors(TRIAL_COUNT) if noise > 0.0 else {}
    scaled = probe.read_scaled(*(1.0 + sign * share for sign in (0.0, 1.0, -1.0))) if 0.0 < share < 1.0 else []
    codes = probe.read_digitised() if noise < DITHER * probe.code_step else {}
    ranges = {}
    for method, value in result.ranges.items():
        if math.isnan(value):
            ranges[method] = RangeUncertainty(math.nan, math.nan)
            continue
        walk = 0.0 if scaled else math.nan
        if scaled and method in scaled[0]:
            walk = max(abs(one[method] - scaled[0][method]) for one in scaled)
            if any(math.isnan(one[method]) for one in scaled):  # an echo weaker by the error may give no range
                walk = math.inf
        place = max(abs(found.get(method, math.nan)) for _, found in moved)
        path = 0.5 * probe.scene.flow.wavelength * phase / math.pi
        systematic = root_sum_square((walk, place, path, codes.get(method, 0.0), probe.air_error))
        spread = random.get(method, math.nan) if noise > 0.0 else 0.0
        ranges[method] = RangeUncertainty(systematic, spread, probe.air_error)
    return EchoErrors(strehl, power, voltage, ranges)


def _blocked_pupil_error(result: EchoResult, probe: EchoProbe) -> float:
    """Relative error of the power due to the edges of a body in front of the pupil; 0 for an open pupil."""
    kind, factor = probe.scene.receiver.return_factor, result.return_factor
    points = np.flatnonzero(np.isfinite(factor) & (result.beam_share > 0.0))
    # The return factor of an open pupil is the Strehl ratio, or 1.
    whole = result.strehl[points] if kind == "strehl" else 1.0
    if kind == "none" or not ((factor[points] < OPEN * whole).any() or is_blocked(probe.scene, probe.field)):
        return 0.0
    some = points[np.unique(np.linspace(0, len(points) - 1, BLOCKED_POINTS).astype(int))]
    return open_share_error(probe.scene, probe.field, result.target_point[some], result.beam_share[some])
