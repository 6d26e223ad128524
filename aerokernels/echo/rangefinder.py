"""Read ranges from a scene's echo by the four ranging methods, each calibrated on the same scene's echo in vacuum."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..inputs.checks import Waveform, as_waveform
from ..scene import Scene
from .chain import chain_of
from .pulse_curve import PulseCurve
from .range_error import RangeStatistics, chain_range_statistics
from .range_walk import RangeWalk, range_walk
from .ranging import RANGING_METHODS, Reading, template_curve
from .shaped_curve import Shape, shaped_curve


@dataclass(frozen=True, eq=False)
class Rangefinder:
    """Reads ranges from the echoes of a scene.

    Attributes:
        threshold: Level of the leading edge [V].
        fraction: Fraction of the peak for "constant-fraction".
        shape: The echo in vacuum as a function of time [s], with zero at its greatest sample: the template of the
            matched filter, and the interpolant of all methods if there are few samples.
        calibration: Offset that is subtracted from each method's reading [m]; methods that cannot read the reference
            are absent.
        walk: The curve that corrects the leading edge, or None.
        unreadable: For each method that cannot read the reference, the reason.
    """

    threshold: float
    fraction: float
    shape: Shape
    calibration: Mapping[str, float]
    walk: RangeWalk | None = None
    unreadable: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def calibrated(
        cls,
        scene: Scene,
        time: np.ndarray,
        reference: np.ndarray,
        fine: tuple[np.ndarray, np.ndarray] | None = None,
        curve: PulseCurve | None = None,
    ) -> "Rangefinder":
        """Calibrate on the echo in vacuum.

        Args:
            scene: The scene.
            time: Sample times [s], shape (n,).
            reference: Samples [V], shape (n,).
            fine: Times [s] and voltage [V] at which the same echo was computed, fine enough to resolve the pulse
                whatever the digitiser's sample rate; None: the samples.
            curve: The curve through the samples, if it was computed already.
        """
        detector = scene.detector
        known = (time, reference) if fine is None else fine
        walk, unreadable = None, {}
        methods = dict.fromkeys(RANGING_METHODS, 0.0)
        try:
            itself = known[1].size == reference.size  # the echo was computed at the samples themselves
            shape = template_curve(known[1], as_waveform(*known)[2], curve if itself else None)
        except ValueError as fault:
            reason = f"the echo in vacuum, without flow, cannot be ranged: {fault}"
            return cls(detector.threshold, detector.fraction, np.zeros_like, {}, None, dict.fromkeys(methods, reason))
        if detector.walk_correction:
            try:
                walk = range_walk(*known, detector.threshold)
            except ValueError as fault:
                unreadable["leading-edge"] = f"the echo in vacuum gives no range walk curve: {fault}"
                del methods["leading-edge"]
        bare = cls(detector.threshold, detector.fraction, shape, methods, walk)
        found, faults = bare._readings(time, reference, tuple(methods), curve)
        offsets = {method: reading - scene.target.distance for method, reading in found.items()}
        for method, reason in faults.items():
            unreadable[method] = f"the echo in vacuum, without flow, cannot be ranged: {reason}"
        return cls(detector.threshold, detector.fraction, shape, offsets, walk, unreadable)

    def range(self, time: np.ndarray, voltage: np.ndarray, method: str) -> float:
        """Return the range by one method [m].

        Raises:
            ValueError: The method finds no echo.
        """
        return self._range(as_waveform(time, voltage), method)

    def _range(self, waveform: Waveform, method: str, curve: PulseCurve | None = None) -> float:
        template = self.shape if method == "matched-filter" else None
        distance = Reading(method, self.threshold, template, self.fraction, self.shape).range_of(waveform, curve)
        if method == "leading-edge" and self.walk is not None:
            times, volts, period = waveform
            curve = curve or shaped_curve(volts, self.shape, period)
            distance = self.walk.correct(times, volts, distance, peak=curve.peak if curve.upsampling > 1 else None)
        return distance - self.calibration[method]

    def ranges(
        self,
        time: np.ndarray,
        voltage: np.ndarray,
        methods: Sequence[str] = RANGING_METHODS,
        curve: PulseCurve | None = None,
    ) -> tuple[dict[str, float], dict[str, str]]:
        """Return ranges by method [m], NaN for methods without a range, and for each of these the reason.

        A method has no range if it finds no echo or is not calibrated. `curve` is the one through the voltage, if it
        was computed already.
        """
        readable = [method for method in methods if method not in self.unreadable]
        found, faults = self._readings(time, voltage, readable, curve)
        # Flow or noise left too weak an echo for the methods in `faults`.
        known = {**self.unreadable, **{one: f"the echo cannot be ranged: {fault}" for one, fault in faults.items()}}
        reasons = {method: known[method] for method in methods if method in known}
        return {method: found.get(method, math.nan) for method in methods}, reasons

    def _readings(
        self, time: np.ndarray, voltage: np.ndarray, methods: Sequence[str], curve: PulseCurve | None
    ) -> tuple[dict[str, float], dict[str, str]]:
        """Return the ranges [m] by method, and the reason for each method that cannot read the record."""
        try:
            waveform = as_waveform(time, voltage)
        except ValueError as fault:
            return {}, dict.fromkeys(methods, str(fault))
        shaped = None
        with suppress(ValueError):  # a record without a curve: each method reports the reason
            shaped = shaped_curve(waveform[1], self.shape, waveform[2], curve)
        found, faults = {}, {}
        for method in methods:
            try:
                found[method] = self._range(waveform, method, shaped)
            except ValueError as fault:
                faults[method] = str(fault)
        return found, faults

    def statistics(
        self, scene: Scene, time: np.ndarray, power: np.ndarray, stride: int, trial_count: int
    ) -> dict[str, RangeStatistics]:
        """Return the errors over noisy records of each calibrated method that reads at least two of the records.

        Args:
            scene: The scene, whose detector makes the records.
            time: Times at which power is computed [s], shape (n,).
            power: Received power [W], shape (n,).
            stride: Number of these times per sample period.
            trial_count: Number of records; 0 for none.
        """
        found = {}
        for method in self.calibration if trial_count else ():
            try:
                found[method] = chain_range_statistics(
                    chain_of(scene),
                    time,
                    power,
                    partial(self.range, method=method),
                    true_range=scene.target.distance,
                    stride=stride,
                    trial_count=trial_count,
                    seed=scene.detector.seed,
                )
            except ValueError:
                continue  # fewer than two trials gave a range
        return found
