"""The errors of an echo's numbers by cause: each number computed again where rays over the receiver's pupil change.

    return factor   F S(rays) / S(base), with S = |<exp(i k OPD)>|^2, tilt kept; F if it does not depend on phases
    peaks, ranges   of the echo's waveform without noise times this change of the factor, through the detector chain
    path            OPD of the rays, and the way to the target's plane along the beam's rays where these are turned as
                    the rays are, as a mean over the beam; the model's uncertainty changes the air at rest too

The rays leave the pupil straight ahead, as to a distant target: their relative change of S stands for that of every
point of the target. (Group and phase index of air differ by 1.4 %, which is left out of errors.)

"sampling" is what no ray shows, root sum of squares, with two standard deviations of what is random:

    factor      more rays over the pupil, without interpolation over the target, at some points (pupil_errors.py); the
                share of the beam that is lost (cut_beam.py)
    peaks       twice the rms error of the echo in vacuum where it arrives fractions of a sample later; of the voltage
                the noise at the peak and half a code of the digitiser
    ranges      the changes of the reading with the factor, of the mean path over the points weighted by it, with the
                samples' position, and by the rounding to codes if no noise dithers them; the spread over noisy records
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..display.quantities import ErrorBudget, combine, root_sum_square, unknown
from ..medium import IndexField
from ..pupils.base import lengths
from ..scene import Scene
from ..strehl import StrehlEstimate
from ..strehl.budget import StrehlVariants
from ..strehl.estimate import PreparedStrehl
from ..tracing.variants.causes import FACTOR, Variants, errors
from ..tracing.variants.paths import Rays
from ..wavefront import mean_phasor
from .paths import air_error, trace_options
from .pulse_curve import PulseCurve, peak_height
from .pupil_errors import factor_errors
from .rangefinder import Rangefinder
from .ranging import AMPLITUDE_METHODS, RANGING_METHODS
from .result import EchoResult
from .vacuum import VacuumEcho
from .waveform import SPEED_OF_LIGHT

# The numbers, in order, before the ranges by method; and their units.
NUMBERS = {"strehl": "", "peak_power": "W", "peak_voltage": "V", "group_path": "m"}
# Fractions of a sample period by which the echo is delayed to measure the effect of the samples' position.
SHIFTS = np.arange(8) / 8
# Relative error of the sum over the beam's points (target_points.py).
QUADRATURE = 1e-7
# Noise above this fraction of a code dithers the codes: their errors are then random.
DITHER = 0.5
# Noisy records from which the random error is measured.
TRIAL_COUNT = 32


@dataclass(frozen=True, eq=False)
class EchoProbe:
    """Everything an echo was computed from, to compute its errors on demand.

    Attributes:
        field: The refractive index of the flow.
        estimate: A Strehl estimate of the scene, whose rays are used if they are those of the receiver's pupil; None:
            rays are traced.
        vacuum: The echo without flow.
        time: Sample times [s].
        fine: Times at which power is computed [s], shape (n,).
        stride: Number of these times per sample period.
        power: Received power at the times `fine` [W], shape (n,).
        clean: Voltage of the samples without noise [V].
        rangefinder: Reads ranges.
    """

    field: IndexField
    estimate: StrehlEstimate | None
    vacuum: VacuumEcho
    time: np.ndarray
    fine: np.ndarray
    stride: int
    power: np.ndarray
    clean: np.ndarray
    rangefinder: Rangefinder

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.vacuum.scene

    @property
    def code_step(self) -> float:
        """Voltage between two codes of the digitiser [V], 0 without one."""
        digitiser = self.vacuum.chain.digitiser
        return 0.0 if digitiser is None else digitiser.step

    @cached_property
    def linear(self) -> np.ndarray:
        """Voltage of the samples without noise and limits [V]."""
        chain = self.vacuum.chain
        return self.clean if chain.saturation is None else chain.linear_voltage(self.fine, self.power)[:: self.stride]

    @cached_property
    def found(self) -> Variants | None:
        """Rays over the receiver's pupil, and how they change by cause; None where none gets out."""
        known = None if self.estimate is None else self.estimate.varied
        if not (isinstance(known, StrehlVariants) and known.field is self.field and not self.scene.has_own_pupil):
            options = trace_options(self.scene) | {"allow_truncation": True}
            try:
                prepared = PreparedStrehl(self.field, self.scene.receiver.pupil, **options)
            except ValueError:  # no ray meets the field, or arrives
                return None
            known = prepared.varied(prepared.plan)
        found = known.found
        if found is None or "refractivity" not in found.causes:
            return found
        model = found.causes["refractivity"]
        air = air_error(self.field, self.scene.target.distance)
        model = replace(model, known=tuple(one.lifted(air) for one in model.known))
        return replace(found, causes={**found.causes, "refractivity": model})

    def read(self, share: float) -> tuple[float, dict[str, float]]:
        """Return peak voltage [V] and ranges by method [m] of the waveform without noise times a share of its power.

        A range that is missing from such a waveform is infinite.
        """
        if share in self._known:
            return self._known[share]
        chain = self.vacuum.chain
        volts, whole = share * self.linear, self._known.get(1.0)
        record = chain.clipped(volts)
        methods: Sequence[str] = RANGING_METHODS
        if whole and np.array_equal(record, volts) and np.array_equal(self.clean, self.linear):
            methods = AMPLITUDE_METHODS
        curve = PulseCurve.of_each([record])[0]
        found = self.rangefinder.ranges(self.time, record, methods, curve)[0]
        found = {name: math.inf if math.isnan(value) else value for name, value in found.items()}
        self._known[share] = peak_height(record, curve), {**(whole[1] if whole else {}), **found}
        return self._known[share]

    @cached_property
    def _known(self) -> dict[float, tuple[float, dict[str, float]]]:
        return {}

    def read_digitised(self) -> dict[str, float]:
        """Return the change of the noise-free waveform's range by the rounding to codes [m], by method."""
        chain = self.vacuum.chain
        if chain.digitiser is None:
            return {}
        record = chain.digitise(self.clean)
        read = self.rangefinder.ranges(self.time, record, curve=PulseCurve.of_each([record])[0])[0]
        plain = self.read(1.0)[1]
        return {method: abs(value - plain[method]) for method, value in read.items()}

    def read_shifted(self) -> tuple[float, float, dict[str, float]]:
        """Return the rms errors by the samples' position: of peak power and voltage, relative, and of ranges [m].

        The echo in vacuum arrives fractions of a sample later; the errors are against the pulse between its samples.
        """
        chain, stride = self.vacuum.chain, self.stride
        shifts = SHIFTS * (self.time[1] - self.time[0])
        fine = [self.vacuum.power(self.fine, shift) for shift in shifts]
        volts = [chain.voltage(self.fine, one) for one in fine]
        records = [one[::stride] for one in (*fine, *volts)]
        curves = PulseCurve.of_each(records)
        heights = np.array([peak_height(*pair) for pair in zip(records, curves, strict=True)]).reshape(2, -1)
        true = np.array([[peak_height(fine[0])], [peak_height(volts[0])]])
        power, voltage = np.sqrt(np.mean((true / heights - 1.0) ** 2, axis=1))
        off: dict[str, list[float]] = {method: [] for method in RANGING_METHODS}
        for shift, record, curve in zip(shifts, records[len(shifts) :], curves[len(shifts) :], strict=True):
            at = self.scene.target.distance + 0.5 * SPEED_OF_LIGHT * shift
            for method, value in self.rangefinder.ranges(self.time, record, curve=curve)[0].items():
                off[method].append(value - at)
        ranges = {method: float(np.sqrt(np.mean(np.square(errors)))) for method, errors in off.items()}
        return float(power), float(voltage), ranges

    def random_errors(self, count: int) -> dict[str, float]:
        """Return the standard deviation of the range by method [m] over `count` noisy records."""
        found = self.rangefinder.statistics(self.scene, self.fine, self.power, self.stride, count)
        return {name: one.random_error for name, one in found.items()}


@dataclass(frozen=True, eq=False)
class EchoNumbers:
    """Computes an echo's NUMBERS and its ranges by method again from rays over the receiver's pupil.

    Attributes:
        probe: What the echo was computed from.
        found: The rays and their changes.
        strehl: The echo's mean Strehl ratio.
        peak_power: Its peak power [W].
    """

    probe: EchoProbe
    found: Variants
    strehl: float
    peak_power: float

    @cached_property
    def ratio(self) -> float:
        """Strehl ratio of the rays."""
        return self._strehl(self.found.base)

    def _strehl(self, rays: Rays) -> float:
        return abs(mean_phasor(rays.opd, self.found.weight, self.probe.scene.flow.wavelength)) ** 2

    @cached_property
    def path(self) -> float:
        """Mean path of the rays over the beam [m]."""
        return self._path(self.found.base)

    @cached_property
    def beam(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions of the beam without flow where the rays start, (n, 3), and its shares there, (n,)."""
        beam, start = self.probe.scene.beam, self.found.start
        line = np.column_stack([start[:, :2] * (beam.radius / beam.exit_radius - 1.0), self._ahead])
        square = 2.0 * np.sum(start[:, :2] ** 2, axis=1) / beam.exit_radius**2
        share = self.found.weight * np.exp(square.min() - square)
        return line / lengths(line)[:, None], share / share.sum()

    @cached_property
    def _ahead(self) -> np.ndarray:
        return np.full(len(self.found.start), self.probe.scene.target.distance)

    def _path(self, rays: Rays) -> float:
        plane, (straight, share) = self.probe.vacuum.plane, self.beam
        way = straight + rays.direction - self.found.ahead
        length = (plane.point - self.found.start) @ plane.normal * lengths(way) / (way @ plane.normal)
        return float(share @ (rays.opd + length))

    def __call__(self, rays: Rays) -> np.ndarray:
        """Return the numbers of rays, shape (4 + number of methods,); those without a value are NaN."""
        change = self._strehl(rays) / self.ratio if self.ratio > 0.0 else math.nan
        if math.isnan(change):
            return np.full(len(NUMBERS) + len(RANGING_METHODS), np.nan)
        share = change if self.probe.scene.receiver.return_factor == "strehl" else 1.0
        volts, ranges = self.probe.read(share)
        path = self._path(rays) - self.path
        numbers = self.strehl * change, share * self.peak_power, volts, path
        return np.array([*numbers, *(ranges[method] + path for method in RANGING_METHODS)])


def echo_errors(result: EchoResult, probe: EchoProbe) -> dict[str, ErrorBudget]:
    """Return the error budgets of an echo's NUMBERS and of its ranges by method: see above."""
    units = NUMBERS | dict.fromkeys(RANGING_METHODS, "m")
    probe.read(1.0)
    if probe.found is None:
        return {name: unknown(unit) for name, unit in units.items()}
    with np.errstate(invalid="ignore"):  # a range that is lost is infinite
        by_cause = errors(EchoNumbers(probe, probe.found, result.mean_strehl, result.peak_power), probe.found)
    sampling = _sampling(result, probe)
    found = {}
    for k, (name, unit) in enumerate(units.items()):
        causes = {cause: float(error[k]) for cause, error in by_cause.items()}
        for cause, error in by_cause.items():
            if name in RANGING_METHODS and math.isnan(causes[cause]) and not math.isnan(error[1]):
                causes[cause] = math.inf
        known = not math.isnan(result.ranges.get(name, 0.0))
        found[name] = combine(causes | {"sampling": sampling[name]}, unit) if known else unknown(unit)
    return found


def _sampling(result: EchoResult, probe: EchoProbe) -> dict[str, float]:
    """Return the errors that no ray shows, by number."""
    strehl, share, path = factor_errors(result, probe.scene, probe.field, probe.vacuum.plane)
    share = math.hypot(share, result.information["lost_share_error"] / result.information["beam_share"], QUADRATURE)
    power, voltage, place = probe.read_shifted()
    noise, peak_noise = float(result.noise_rms), 0.0
    if noise > 0.0:  # the signal's own shot noise may be many times the noise between echoes
        peak_noise = probe.vacuum.chain.noise_rms(result.peak_power, probe.scene.detector.sample_rate)
    found = {
        "strehl": strehl,
        "peak_power": result.peak_power * math.hypot(share, FACTOR * power),
        "peak_voltage": root_sum_square(
            (result.peak_voltage * math.hypot(share, FACTOR * voltage), FACTOR * peak_noise, 0.5 * probe.code_step)
        ),
        "group_path": 0.0,
    }
    random = probe.random_errors(TRIAL_COUNT) if noise > 0.0 else {}
    codes = probe.read_digitised() if noise < DITHER * probe.code_step else {}
    steps = [probe.read(1.0 + sign * share)[1] for sign in (-1.0, 1.0)] if 0.0 < share < 1.0 else []
    for method, value in probe.read(1.0)[1].items():
        walk = max((abs(one[method] - value) for one in steps), default=0.0 if share == 0.0 else math.nan)
        spread = random.get(method, math.nan) if noise > 0.0 else 0.0
        others = place.get(method, math.nan), codes.get(method, 0.0), spread
        found[method] = root_sum_square((walk, path, *(FACTOR * one for one in others)))
    return found
