"""Compute the echo in vacuum, and read ranges by the four methods, each calibrated on that echo.

No ray is traced for it. A setup whose echo cannot be computed raises ValueError here.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from aerokernels.inputs.checks import as_waveform
from aerokernels.lidar.parts import RANGING_METHODS, Detector, Setup
from aerokernels.lidar.paths import (
    TargetPoints,
    TransmitPaths,
    point_power,
    target_points,
    transmit_paths,
    vacuum_paths,
)
from aerokernels.lidar.pulse_curve import Shape, peak_height, shaped_curve
from aerokernels.lidar.pulses import SPEED_OF_LIGHT, sum_of_pulses
from aerokernels.lidar.range_error import RangeStatistics, summarise_ranges
from aerokernels.lidar.ranging import Reading, template_curve
from aerokernels.lidar.return_paths import check_ahead
from aerokernels.medium import IndexField
from aerokernels.scene import Scene


@dataclass(frozen=True, eq=False)
class VacuumEcho:
    """The echo in vacuum: the points of the beam over which it is summed, and the straight paths to the target."""

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

        They follow from the paths in vacuum alone, unless the group `path` [m], shape (m,), through air over kilometres
        delays the light by more than a tenth of the pulse's timescale: setups that differ only in their flow share
        sample times.
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
        if length * rate * stride > 1 << 22:
            raise ValueError(
                f"the record would take {length * rate * stride:.1e} samples to compute, {length:.3g} s at "
                f"{rate * stride:.3g} Hz: beam.pulse_tau, detector.bandwidth and detector.sample_rate do not go "
                "together"
            )
        time = np.arange(math.floor(start * rate), math.ceil(stop * rate) + 1) / rate
        fine = time[0] + np.arange((time.size - 1) * stride + 1) / (rate * stride)
        return time, fine, stride


def vacuum_echo(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and voltage [V], (n,) each, of a scene's echo in vacuum, without noise or digitiser."""
    vacuum = VacuumEcho.of(Setup.of_scene(scene))
    time, fine, stride = vacuum.times()
    return time, vacuum.setup.detector.chain.voltage(fine, vacuum.power(fine))[::stride]


def cut_beam(vacuum: VacuumEcho, field: IndexField) -> tuple[VacuumEcho, TransmitPaths, float]:
    """Return the echo in vacuum over enough points, their paths through a field, and the error of the lost share.

    A body that cuts the beam makes the sum over the beam's points jump, and Gauss points no longer converge fast: they
    are doubled until the lost share is known. Its error is the change from half as many points a side and a third of
    that from a quarter as many: an error falls about threefold from one to the next, but two may agree by chance.
    """
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
        unreadable: For each method that cannot read the reference, the reason.
        name: What cannot be ranged, in reasons.
    """

    detector: Detector
    distance: float
    shape: Shape
    calibration: Mapping[str, float]
    unreadable: Mapping[str, str]
    name: str = "the echo"

    @classmethod
    def calibrated(cls, setup: Setup, fine: np.ndarray, voltage: np.ndarray, stride: int) -> "Rangefinder":
        """Calibrate on the voltage [V] of the echo in vacuum at times `fine` [s]; every `stride`-th is sampled."""
        detector, distance, name = setup.detector, setup.target.distance, "the echo in vacuum, without flow,"
        try:
            shape = template_curve(voltage, as_waveform(fine, voltage)[2])
        except ValueError as fault:
            reason = f"{name} cannot be ranged: {fault}"
            return cls(detector, distance, np.zeros_like, {}, dict.fromkeys(RANGING_METHODS, reason))
        bare = cls(detector, distance, shape, dict.fromkeys(RANGING_METHODS, 0.0), {}, name)
        readings, reasons = bare.ranges(fine[::stride], voltage[::stride])
        offsets = {method: reading - distance for method, reading in readings.items() if method not in reasons}
        return cls(detector, distance, shape, offsets, reasons)

    def range(self, time: np.ndarray, voltage: np.ndarray, method: str) -> float:
        """Return the range by one method [m]; a method that finds no echo raises ValueError."""
        return self._readings[method].range_of(as_waveform(time, voltage)) - self.calibration[method]

    @cached_property
    def _readings(self) -> dict[str, Reading]:
        """How each method reads a record."""
        kinds: Sequence[str] = RANGING_METHODS
        templates = {method: self.shape if method == "matched-filter" else None for method in kinds}
        given = self.detector.threshold, self.detector.fraction
        return {method: Reading(method, given[0], templates[method], given[1], self.shape) for method in kinds}

    def ranges(
        self, time: np.ndarray, voltage: np.ndarray, methods: Sequence[str] = RANGING_METHODS
    ) -> tuple[dict[str, float], dict[str, str]]:
        """Return ranges by method [m], NaN for those that find no echo or are not calibrated; for these the reason."""
        ranges, reasons, waveform, curve = dict.fromkeys(methods, math.nan), {}, None, None
        with suppress(ValueError):  # a record without a curve: each method reports the reason
            waveform = as_waveform(time, voltage)
            curve = shaped_curve(waveform[1], self.shape, waveform[2])
        for method in methods:
            if method in self.unreadable:
                reasons[method] = self.unreadable[method]
                continue
            try:
                found = self._readings[method].range_of(waveform or as_waveform(time, voltage), curve)
                ranges[method] = found - self.calibration[method]
            except ValueError as fault:
                reasons[method] = f"{self.name} cannot be ranged: {fault}"
        return ranges, reasons

    def statistics(
        self, time: np.ndarray, power: np.ndarray, stride: int, trial_count: int
    ) -> dict[str, RangeStatistics]:
        """Return the errors over noisy records of each calibrated method that reads at least two of the records."""
        statistics, chain = {}, self.detector.chain
        for method in self.calibration if trial_count else ():
            generator = np.random.default_rng(self.detector.seed)
            with suppress(ValueError):  # fewer than two trials gave a range
                statistics[method] = summarise_ranges(
                    partial(chain.record, time, power, generator, stride),
                    partial(self.range, time[::stride], method=method),
                    trial_count,
                    self.distance,
                    chain.cramer_rao_range(time, power),
                )
        return statistics


class EchoPrediction(NamedTuple):
    """Peaks [W] and [V] of a scene's echo in vacuum, reasons of methods that cannot read it, the least return factor.

    That is the least one with which the scene's own method still finds the echo; NaN if the method does not depend on
    the amplitude, or finds no echo even in vacuum.
    """

    peak_power: float
    peak_voltage: float
    reasons: Mapping[str, str]
    least_factor: float


def predict_echo(scene: Scene, field: IndexField | None = None) -> EchoPrediction:
    """Compute the echo of a scene in vacuum, and whether each method can read a range from it.

    A scene whose echo cannot be computed is a ValueError, also one whose target is not ahead of `field`.
    """
    vacuum = check_echo(Setup.of_scene(scene), field)
    detector = vacuum.setup.detector
    _, fine, stride = vacuum.times()
    power = vacuum.power(fine)
    fine_voltage = detector.chain.voltage(fine, power)
    rangefinder = Rangefinder.calibrated(vacuum.setup, fine, fine_voltage, stride)
    own, least_factor = detector.ranging, math.nan
    if own == "leading-edge" and own not in rangefinder.unreadable:
        # The voltage without saturation, because it is proportional to the light.
        least_factor = detector.threshold / peak_height(detector.chain.linear_voltage(fine, power)[::stride])
    peak_voltage = peak_height(fine_voltage[::stride])
    return EchoPrediction(peak_height(power[::stride]), peak_voltage, rangefinder.unreadable, least_factor)


def check_echo(setup: Setup, field: IndexField | None = None) -> VacuumEcho:
    """Return the echo of a setup in vacuum, after checking that its echo can be computed."""
    vacuum = VacuumEcho.of(setup)
    vacuum.times()  # raises for a record of too many samples
    _ = vacuum.point_power  # raises for a receiver wider than its distance
    if field is not None and setup.receiver.return_factor != "none":
        check_ahead(field, vacuum.paths.intersection)
    return vacuum
