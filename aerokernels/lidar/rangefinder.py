"""Compute the echo in vacuum, and read ranges by the four methods, each calibrated on that echo.

No ray is traced for it. A setup whose echo cannot be computed raises ValueError here.

A body that cuts the beam, or another loss of rays, makes the integrand of the sum over the beam's points jump, and
Gauss points no longer converge fast. `cut_beam` doubles the points along each side until the share of the beam that is
lost is known well enough. Its error is the change from the same sum over half as many points a side and a third of that
from a quarter as many, as independent errors: an error falls about threefold from one rule to the next, but two may
agree by chance.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from aerokernels.inputs.checks import Waveform, as_waveform
from aerokernels.lidar.detector import sample_times
from aerokernels.lidar.parts import RANGING_METHODS, Detector, Setup
from aerokernels.lidar.paths import (
    TargetPoints,
    TransmitPaths,
    point_power,
    target_points,
    transmit_paths,
    vacuum_paths,
)
from aerokernels.lidar.pulse_curve import PulseCurve, Shape, peak_height, shaped_curve
from aerokernels.lidar.pulses import SPEED_OF_LIGHT, sum_of_pulses
from aerokernels.lidar.range_error import RangeStatistics, RangeWalk, chain_range_statistics, range_walk
from aerokernels.lidar.ranging import Reading, template_curve
from aerokernels.lidar.return_paths import check_ahead
from aerokernels.medium import IndexField
from aerokernels.scene import Scene

GREATEST_SAMPLE_COUNT = 1 << 22


@dataclass(frozen=True, eq=False)
class VacuumEcho:
    """The echo in vacuum.

    Attributes:
        setup: Laser, target, receiver and detector.
        points: The points of the beam over which the echo is summed.
        paths: The straight paths to the target.
    """

    setup: Setup
    points: TargetPoints
    paths: TransmitPaths

    @classmethod
    def of(cls, setup: Setup, finer: float = 1.0) -> "VacuumEcho":
        """Compute the points and paths of a setup; arguments and errors as for `target_points`."""
        points = target_points(setup, finer)
        return cls(setup, points, vacuum_paths(setup, points))

    @cached_property
    def point_power(self) -> np.ndarray:
        """Peak power of each point's pulse at the receiver [W], shape (m,)."""
        return point_power(self.setup, self.points.weight, self.paths, 1.0)

    def power(self, time: np.ndarray, later: float = 0.0) -> np.ndarray:
        """Return the received power [W], of the shape of `time` [s], for an echo delayed by `later` [s]."""
        delay = 2.0 * self.paths.path / SPEED_OF_LIGHT + later
        return sum_of_pulses(time, delay, self.point_power, self.setup.laser.shape)

    def times(self, path: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, int]:
        """Return sample times [s], times at which power is computed [s], and the number of these per sample period.

        They follow from the paths in vacuum alone, unless air over kilometres, or glass, delays the light noticeably:
        by more than a tenth of the pulse's timescale. So setups that differ only in their flow share sample times.

        Args:
            path: Group path of each ray to the target [m], shape (m,), NaN for one that does not arrive; None: vacuum.

        Raises:
            ValueError: A record of millions of samples.
        """
        vacuum, pulse, bandwidth = self.paths.path, self.setup.laser.shape, self.setup.detector.chain.bandwidth
        delay = 2.0 * vacuum / SPEED_OF_LIGHT
        later = 2.0 * ((vacuum if path is None else path) - vacuum) / SPEED_OF_LIGHT
        ends = float(np.nanmin(later)), float(np.nanmax(later))
        early, late = (shift if abs(shift) > 0.1 * pulse.timescale else 0.0 for shift in ends)
        before, after = pulse.support
        tail = 0.0 if bandwidth is None else 3.0 / bandwidth  # for which the low-pass rings
        rate = self.setup.detector.sample_rate
        start, stop = delay.min() + before + min(early, 0.0), delay.max() + after + tail + max(late, 0.0)
        # Eight values per timescale of the pulse and per 1 / bandwidth, however slow the digitiser: the pulse is not
        # aliased, and all noise that sampling aliases is computed.
        stride = max(1, math.ceil(8.0 * max(1.0 / pulse.timescale, bandwidth or 0.0) / rate))
        length = max(stop - start, 1.0 / rate)
        if length * rate * stride > GREATEST_SAMPLE_COUNT:
            raise ValueError(
                f"the record would take {length * rate * stride:.1e} samples to compute, {length:.3g} s at "
                f"{rate * stride:.3g} Hz: beam.pulse_tau, detector.bandwidth and detector.sample_rate do not go "
                "together"
            )
        time = sample_times(start, stop, rate)
        fine = time[0] + np.arange((time.size - 1) * stride + 1) / (rate * stride)
        return time, fine, stride


def vacuum_echo(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Compute the echo of a scene in vacuum, without noise or digitiser, on which its rangefinder is calibrated.

    Returns:
        Sample times after the pulse's peak left [s], and voltage [V], each of shape (n,).

    Raises:
        ValueError: The target reaches back to the aperture, or a record of millions of samples.
    """
    vacuum = VacuumEcho.of(Setup.of_scene(scene))
    time, fine, stride = vacuum.times()
    return time, vacuum.setup.detector.chain.voltage(fine, vacuum.power(fine))[::stride]


def cut_beam(vacuum: VacuumEcho, field: IndexField) -> tuple[VacuumEcho, TransmitPaths, float]:
    """Return the echo in vacuum over enough points, their paths through a field, and the error of the lost share."""
    known: dict[float, tuple[VacuumEcho, TransmitPaths, float]] = {}

    def lost(finer: float) -> tuple[VacuumEcho, TransmitPaths, float]:
        if finer not in known:
            echo = vacuum if finer == 1.0 else VacuumEcho.of(vacuum.setup, finer)
            paths = transmit_paths(vacuum.setup, field, echo.points)
            known[finer] = echo, paths, float(echo.points.weight[~paths.arrived].sum())
        return known[finer]

    finer = 1.0
    while True:
        echo, paths, share = lost(finer)
        if not 0.0 < share < float(echo.points.weight.sum()):
            return echo, paths, 0.0
        error = math.hypot(share - lost(0.5 * finer)[2], (share - lost(0.25 * finer)[2]) / 3.0)
        if error <= 2e-3 or 4 * len(echo.points.weight) > 1 << 17:
            return echo, paths, error
        finer *= 2.0


@dataclass(frozen=True, eq=False)
class Rangefinder:
    """Reads ranges from the echoes of a setup.

    Attributes:
        detector: Threshold and fraction of the methods, and the electronics of noisy records.
        distance: The target's distance, which every method reads from the echo in vacuum [m].
        shape: The echo in vacuum as a function of time [s], with zero at its greatest sample: the template of the
            matched filter, and the interpolant of all methods if there are few samples.
        calibration: Offset that is subtracted from each method's reading [m]; methods that cannot read the reference
            are absent.
        walk: The curve that corrects the leading edge, or None.
        unreadable: For each method that cannot read the reference, the reason.
    """

    detector: Detector
    distance: float
    shape: Shape
    calibration: Mapping[str, float]
    walk: RangeWalk | None = None
    unreadable: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def calibrated(
        cls,
        setup: Setup,
        time: np.ndarray,
        reference: np.ndarray,
        fine: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> "Rangefinder":
        """Calibrate on the echo in vacuum.

        Args:
            setup: The target and the detector.
            time: Sample times [s], shape (n,).
            reference: Samples [V], shape (n,).
            fine: Times [s] and voltage [V] at which the same echo was computed, fine enough to resolve the pulse
                whatever the digitiser's sample rate; None: the samples.
        """
        detector, distance = setup.detector, setup.target.distance
        known = (time, reference) if fine is None else fine
        walk, unreadable = None, {}
        methods = dict.fromkeys(RANGING_METHODS, 0.0)
        try:
            shape = template_curve(known[1], as_waveform(*known)[2])
        except ValueError as fault:
            reason = f"the echo in vacuum, without flow, cannot be ranged: {fault}"
            return cls(detector, distance, np.zeros_like, {}, None, dict.fromkeys(methods, reason))
        if detector.walk_correction:
            try:
                walk = range_walk(*known, detector.threshold)
            except ValueError as fault:
                unreadable["leading-edge"] = f"the echo in vacuum gives no range walk curve: {fault}"
                del methods["leading-edge"]
        readings, faults = cls(detector, distance, shape, methods, walk)._readings(time, reference, tuple(methods))
        offsets = {method: reading - distance for method, reading in readings.items()}
        for method, reason in faults.items():
            unreadable[method] = f"the echo in vacuum, without flow, cannot be ranged: {reason}"
        return cls(detector, distance, shape, offsets, walk, unreadable)

    def range(self, time: np.ndarray, voltage: np.ndarray, method: str) -> float:
        """Return the range by one method [m].

        Raises:
            ValueError: The method finds no echo.
        """
        return self._range(as_waveform(time, voltage), method)

    def _range(self, waveform: Waveform, method: str, curve: PulseCurve | None = None) -> float:
        template = self.shape if method == "matched-filter" else None
        reading = Reading(method, self.detector.threshold, template, self.detector.fraction, self.shape)
        distance = reading.range_of(waveform, curve)
        if method == "leading-edge" and self.walk is not None:
            times, volts, period = waveform
            curve = curve or shaped_curve(volts, self.shape, period)
            distance = self.walk.correct(times, volts, distance, peak=curve.peak if curve.upsampling > 1 else None)
        return distance - self.calibration[method]

    def ranges(
        self, time: np.ndarray, voltage: np.ndarray, methods: Sequence[str] = RANGING_METHODS
    ) -> tuple[dict[str, float], dict[str, str]]:
        """Return ranges by method [m], NaN for methods without a range, and for each of these the reason.

        A method has no range if it finds no echo or is not calibrated.
        """
        readable = [method for method in methods if method not in self.unreadable]
        readings, faults = self._readings(time, voltage, readable)
        # Flow or noise left too weak an echo for the methods in `faults`.
        known = {**self.unreadable, **{one: f"the echo cannot be ranged: {fault}" for one, fault in faults.items()}}
        reasons = {method: known[method] for method in methods if method in known}
        return {method: readings.get(method, math.nan) for method in methods}, reasons

    def _readings(
        self, time: np.ndarray, voltage: np.ndarray, methods: Sequence[str]
    ) -> tuple[dict[str, float], dict[str, str]]:
        """Return the ranges [m] by method, and the reason for each method that cannot read the record."""
        try:
            waveform = as_waveform(time, voltage)
        except ValueError as fault:
            return {}, dict.fromkeys(methods, str(fault))
        curve = None
        with suppress(ValueError):  # a record without a curve: each method reports the reason
            curve = shaped_curve(waveform[1], self.shape, waveform[2])
        readings, faults = {}, {}
        for method in methods:
            try:
                readings[method] = self._range(waveform, method, curve)
            except ValueError as fault:
                faults[method] = str(fault)
        return readings, faults

    def statistics(
        self, time: np.ndarray, power: np.ndarray, stride: int, trial_count: int
    ) -> dict[str, RangeStatistics]:
        """Return the errors over noisy records of each calibrated method that reads at least two of the records.

        Args:
            time: Times at which power is computed [s], shape (n,).
            power: Received power [W], shape (n,).
            stride: Number of these times per sample period.
            trial_count: Number of records; 0 for none.
        """
        statistics = {}
        for method in self.calibration if trial_count else ():
            with suppress(ValueError):  # fewer than two trials gave a range
                statistics[method] = chain_range_statistics(
                    self.detector.chain,
                    time,
                    power,
                    partial(self.range, method=method),
                    true_range=self.distance,
                    stride=stride,
                    trial_count=trial_count,
                    seed=self.detector.seed,
                )
        return statistics


@dataclass(frozen=True)
class EchoPrediction:
    """A scene's echo in vacuum.

    Attributes:
        peak_power: Its peak power [W].
        peak_voltage: Its peak voltage [V].
        reasons: For each ranging method that cannot read this echo, the reason. The scene's echo through the flow has
            no range by that method either.
        least_factor: Least return factor, 0 to 1, with which the scene's own method still finds the echo; NaN if that
            method does not depend on the amplitude, or finds no echo even in vacuum.
    """

    peak_power: float
    peak_voltage: float
    reasons: Mapping[str, str]
    least_factor: float


def predict_echo(scene: Scene, field: IndexField | None = None) -> EchoPrediction:
    """Compute the echo of a scene in vacuum, without tracing rays, and whether each method can read a range from it.

    Args:
        scene: The scene.
        field: The refractive index, to check that the target is ahead of it; None: not checked.

    Raises:
        ValueError: A scene whose echo cannot be computed: a target that reaches back to the aperture or into the flow's
            box, one too deep for its pulse, or a record of millions of samples.
    """
    vacuum = check_echo(Setup.of_scene(scene), field)
    detector = vacuum.setup.detector
    time, fine, stride = vacuum.times()
    power = vacuum.power(fine)
    fine_voltage = detector.chain.voltage(fine, power)
    voltage = fine_voltage[::stride]
    rangefinder = Rangefinder.calibrated(vacuum.setup, time, voltage, (fine, fine_voltage))
    own, least_factor = detector.ranging, math.nan
    if own == "leading-edge" and own not in rangefinder.unreadable:
        # The voltage without saturation, because it is proportional to the light.
        least_factor = detector.threshold / peak_height(detector.chain.linear_voltage(fine, power)[::stride])
    return EchoPrediction(peak_height(power[::stride]), peak_height(voltage), rangefinder.unreadable, least_factor)


def check_echo(setup: Setup, field: IndexField | None = None) -> VacuumEcho:
    """Return the echo of a setup in vacuum, after checking that its echo can be computed.

    Raises:
        ValueError: As for `predict_echo`.
    """
    vacuum = VacuumEcho.of(setup)
    vacuum.times()  # raises for a record of too many samples
    _ = vacuum.point_power  # raises for a receiver wider than its distance
    if field is not None and setup.receiver.return_factor != "none":
        check_ahead(field, vacuum.paths.intersection)
    return vacuum
