"""The errors of an echo's numbers by cause: each number computed again where rays over the receiver's pupil change.

The rays leave the pupil straight ahead, as to a distant target: the relative change of S = |<exp(i k OPD)>|^2, tilt
kept, stands for that of every point of the target. "sampling" is what no ray shows, root sum of squares, with two
standard deviations of what is random.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aerokernels.display.quantities import ErrorBudget, combine, root_sum_square, unknown
from aerokernels.focus import StrehlEstimate
from aerokernels.focus.estimate import PreparedStrehl, StrehlVariants
from aerokernels.lidar.parts import RANGING_METHODS, Setup
from aerokernels.lidar.paths import air_error
from aerokernels.lidar.pulse_curve import peak_height
from aerokernels.lidar.pulses import SPEED_OF_LIGHT
from aerokernels.lidar.rangefinder import Rangefinder, VacuumEcho
from aerokernels.lidar.result import EchoResult
from aerokernels.lidar.return_paths import factor_of, is_symmetric, reduce_pupils, upper_half
from aerokernels.medium import IndexField
from aerokernels.pupils.base import lengths
from aerokernels.tracing.variants.causes import FACTOR, Variants, errors
from aerokernels.tracing.variants.paths import Rays
from aerokernels.wavefronts import mean_phasor

# The numbers, in order, before the ranges by method; and their units.
NUMBERS = {"strehl": "", "peak_power": "W", "peak_voltage": "V", "group_path": "m"}


@dataclass(frozen=True, eq=False)
class EchoProbe:
    """Everything an echo was computed from, to compute its errors on demand.

    `estimate` is a Strehl estimate of the receiver's pupil through the field, whose rays are used; None: rays are
    traced. `power` (n,) is that at times `fine` [s], every `stride`-th of which is sampled; `clean` the voltage of the
    samples without noise.
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

    @cached_property
    def setup(self) -> Setup:
        """Laser, target, receiver and detector."""
        return self.vacuum.setup

    @property
    def code_step(self) -> float:
        """Voltage between two codes of the digitiser [V], 0 without one."""
        digitiser = self.setup.detector.chain.digitiser
        return 0.0 if digitiser is None else digitiser.step

    @cached_property
    def linear(self) -> np.ndarray:
        """Voltage of the samples without noise and limits [V]."""
        chain = self.setup.detector.chain
        return self.clean if chain.saturation is None else chain.linear_voltage(self.fine, self.power)[:: self.stride]

    @cached_property
    def rays(self) -> Variants | None:
        """Rays over the receiver's pupil, and how they change by cause; None where none gets out."""
        varied = None if self.estimate is None else self.estimate.varied
        if not (isinstance(varied, StrehlVariants) and varied.field is self.field):
            options = {**self.setup.options, "allow_truncation": True}
            try:
                prepared = PreparedStrehl(self.field, self.setup.receiver.pupil, **options)
            except ValueError:  # no ray meets the field, or arrives
                return None
            varied = prepared.varied(prepared.plan)
        rays = varied.found
        if rays is None or "refractivity" not in rays.causes:
            return rays
        model = rays.causes["refractivity"]
        air = air_error(self.field, self.setup.target.distance)
        model = replace(model, known=tuple(one.lifted(air) for one in model.known))
        return replace(rays, causes={**rays.causes, "refractivity": model})

    def read(self, share: float) -> tuple[float, dict[str, float]]:
        """Return peak voltage [V] and ranges by method [m] of the waveform without noise times a share of its power.

        A range that is missing from such a waveform is infinite.
        """
        if share in self._known:
            return self._known[share]
        volts, whole = share * self.linear, self._known.get(1.0)
        record = self.setup.detector.chain.clipped(volts)
        methods: Sequence[str] = RANGING_METHODS
        if whole and np.array_equal(record, volts) and np.array_equal(self.clean, self.linear):
            methods = ("leading-edge",)  # the others do not depend on the amplitude
        ranges = self.rangefinder.ranges(self.time, record, methods)[0]
        ranges = {name: math.inf if math.isnan(value) else value for name, value in ranges.items()}
        self._known[share] = peak_height(record), {**(whole[1] if whole else {}), **ranges}
        return self._known[share]

    @cached_property
    def _known(self) -> dict[float, tuple[float, dict[str, float]]]:
        return {}

    def read_shifted(self) -> tuple[float, float, dict[str, float]]:
        """Return the rms errors by the samples' position: of peak power and voltage, relative, and of ranges [m].

        The echo in vacuum arrives eighths of a sample later; the errors are against the pulse between its samples.
        """
        off: dict[str, list[float]] = {name: [] for name in ("power", "voltage", *RANGING_METHODS)}
        for shift in np.arange(8) / 8 * (self.time[1] - self.time[0]):
            power = self.vacuum.power(self.fine, shift)
            volts = self.setup.detector.chain.voltage(self.fine, power)
            if not shift:
                true_power, true_voltage = peak_height(power), peak_height(volts)
            record = volts[:: self.stride]
            off["power"].append(true_power / peak_height(power[:: self.stride]) - 1.0)
            off["voltage"].append(true_voltage / peak_height(record) - 1.0)
            at = self.setup.target.distance + 0.5 * SPEED_OF_LIGHT * shift
            for method, value in self.rangefinder.ranges(self.time, record)[0].items():
                off[method].append(value - at)
        rms = {name: float(np.sqrt(np.mean(np.square(errors)))) for name, errors in off.items()}
        return rms.pop("power"), rms.pop("voltage"), rms


class EchoNumbers:
    """Computes an echo's NUMBERS and its ranges by method again from rays over the receiver's pupil."""

    def __init__(self, probe: EchoProbe, rays: Variants, strehl: float, peak_power: float):
        """Take the echo's mean Strehl ratio and its peak power [W], and the rays with their changes."""
        self.probe, self.rays, self.strehl, self.peak_power = probe, rays, strehl, peak_power
        beam, start = probe.setup.laser, rays.start
        # Directions of the beam without flow where the rays start, (n, 3), and its shares there, (n,).
        ahead = np.full(len(start), probe.setup.target.distance)
        line = np.column_stack([start[:, :2] * (beam.radius / beam.exit_radius - 1.0), ahead])
        square = 2.0 * np.sum(start[:, :2] ** 2, axis=1) / beam.exit_radius**2
        share = rays.weight * np.exp(square.min() - square)
        self.straight, self.share = line / lengths(line)[:, None], share / share.sum()
        self.ratio, self.path = self._strehl(rays.base), self._path(rays.base)

    def _strehl(self, rays: Rays) -> float:
        return abs(mean_phasor(rays.opd, self.rays.weight, self.probe.setup.laser.wavelength)) ** 2

    def _path(self, rays: Rays) -> float:
        """Return the mean path of the rays over the beam [m], where these are turned as the rays are."""
        plane = self.probe.setup.plane
        way = self.straight + rays.direction - self.rays.ahead
        length = (plane.point - self.rays.start) @ plane.normal * lengths(way) / (way @ plane.normal)
        return float(self.share @ (rays.opd + length))

    def __call__(self, rays: Rays) -> np.ndarray:
        """Return the numbers of rays, shape (4 + number of methods,); those without a value are NaN."""
        change = self._strehl(rays) / self.ratio if self.ratio > 0.0 else math.nan
        if math.isnan(change):
            return np.full(len(NUMBERS) + len(RANGING_METHODS), np.nan)
        share = change if self.probe.setup.receiver.return_factor == "strehl" else 1.0
        volts, ranges = self.probe.read(share)
        path = self._path(rays) - self.path
        numbers = self.strehl * change, share * self.peak_power, volts, path
        return np.array([*numbers, *[ranges[method] + path for method in RANGING_METHODS]])


def echo_errors(result: EchoResult, probe: EchoProbe) -> dict[str, ErrorBudget]:
    """Return the error budgets of an echo's NUMBERS and of its ranges by method: see above."""
    units = NUMBERS | dict.fromkeys(RANGING_METHODS, "m")
    probe.read(1.0)
    if probe.rays is None:
        return {name: unknown(unit) for name, unit in units.items()}
    with np.errstate(invalid="ignore"):  # a range that is lost is infinite
        by_cause = errors(EchoNumbers(probe, probe.rays, result.mean_strehl, result.peak_power), probe.rays)
    sampling = _sampling(result, probe)
    budgets = {}
    for k, (name, unit) in enumerate(units.items()):
        causes = {cause: float(error[k]) for cause, error in by_cause.items()}
        for cause, error in by_cause.items():
            if name in RANGING_METHODS and math.isnan(causes[cause]) and not math.isnan(error[1]):
                causes[cause] = math.inf
        known = not math.isnan(result.ranges.get(name, 0.0))
        budgets[name] = combine(causes | {"sampling": sampling[name]}, unit) if known else unknown(unit)
    return budgets


def _sampling(result: EchoResult, probe: EchoProbe) -> dict[str, float]:
    """Return the errors that no ray shows, by number."""
    strehl, share, path = _factor_errors(result, probe)
    # The sum over the beam's points has a relative error of 1e-7 (paths.py).
    share = math.hypot(share, result.information["lost_share_error"] / result.information["beam_share"], 1e-7)
    power, voltage, place = probe.read_shifted()
    detector, noise, peak_noise = probe.setup.detector, float(result.noise_rms), 0.0
    if noise > 0.0:  # the signal's own shot noise may be many times the noise between echoes
        peak_noise = detector.chain.noise_rms(result.peak_power, detector.sample_rate)
    budget = {
        "strehl": strehl,
        "peak_power": result.peak_power * math.hypot(share, FACTOR * power),
        "peak_voltage": root_sum_square(
            (result.peak_voltage * math.hypot(share, FACTOR * voltage), FACTOR * peak_noise, 0.5 * probe.code_step)
        ),
        "group_path": 0.0,
    }
    noisy = probe.rangefinder.statistics(probe.fine, probe.power, probe.stride, 32) if noise > 0.0 else {}
    # Noise above half a code dithers the codes: their errors are then random.
    codes: dict[str, float] = {}
    if noise < 0.5 * probe.code_step:
        ranges = probe.rangefinder.ranges(probe.time, detector.chain.digitise(probe.clean))[0]
        codes = {method: abs(value - probe.read(1.0)[1][method]) for method, value in ranges.items()}
    steps = [probe.read(1.0 + sign * share)[1] for sign in (-1.0, 1.0)] if 0.0 < share < 1.0 else []
    for method, value in probe.read(1.0)[1].items():
        walk = max((abs(one[method] - value) for one in steps), default=0.0 if share == 0.0 else math.nan)
        spread = 0.0 if noise == 0.0 else noisy[method].random_error if method in noisy else math.nan
        others = place.get(method, math.nan), codes.get(method, 0.0), spread
        budget[method] = root_sum_square((walk, path, *(FACTOR * one for one in others)))
    return budget


def _factor_errors(result: EchoResult, probe: EchoProbe) -> tuple[float, float, float]:
    """Return errors of the mean Strehl ratio, relative of the return factor, and of the mean path by that [m].

    They are those of the number of rays over the pupil and of the interpolation over the target. NaN, infinite and 0 if
    no ray gets out, or nothing returns.
    """
    setup, receiver = probe.setup, probe.setup.receiver
    kind, pupil = receiver.return_factor, receiver.pupil
    if kind == "none":
        return math.nan, 0.0, 0.0
    points = np.flatnonzero(np.isfinite(result.return_factor) & (result.beam_share > 0.0))
    share = result.beam_share[points] / result.beam_share[points].sum()
    some = np.random.default_rng(0).choice(points, min(16, len(points)), replace=False, p=share)
    place, rays = result.target_point[some], pupil.sample(4 * max(receiver.ray_count, 256), "gauss")
    if is_symmetric(probe.field, setup.plane, pupil):
        place, rays = np.column_stack([np.hypot(*place.T[:2]), np.zeros(len(some)), place[:, 2]]), upper_half(*rays)
    try:
        sums = reduce_pupils(setup, probe.field, place, *rays)
    except ValueError:
        return math.nan, math.inf, 0.0
    strehl, mean = _error(result.strehl[some] - sums.strehl), result.beam_mean(result.return_factor)
    if not mean > 0.0:
        return strehl, math.inf, 0.0
    change = (result.return_factor[some] - factor_of(kind, sums.strehl, sums.open_share)) / mean
    path = result.group_path[some] - result.beam_mean(result.group_path)
    return strehl, _error(change), _error(change * path)


def _error(change: np.ndarray) -> float:
    return FACTOR * math.sqrt(float(change.mean()) ** 2 + float(change.var()) / max(len(change) - 1, 1))
