"""A scene's rangefinder: the four ranging methods, each calibrated on the echo of the same scene in vacuum."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..scene import Scene
from .checks import as_waveform
from .range_walk import RangeWalk, range_walk
from .ranging import RANGING_METHODS, read_range, template_curve
from .shaped_curve import Shape, shaped_curve


@dataclass(frozen=True, eq=False)
class Rangefinder:
    """How a scene reads ranges.

    Attributes:
        threshold: Level of the leading edge [V].
        fraction: Share of the peak of the constant fraction.
        shape: The echo in vacuum as a function of time [s], zero at its greatest sample: the matched filter's template,
            and what all methods go by between few samples.
        calibration: What is subtracted from each method's reading [m]; methods that cannot read the
            reference are absent.
        walk: The curve that the leading edge is corrected by, or None.
    """

    threshold: float
    fraction: float
    shape: Shape
    calibration: Mapping[str, float]
    walk: RangeWalk | None = None

    @classmethod
    def calibrated(
        cls, scene: Scene, time: np.ndarray, reference: np.ndarray, fine: tuple[np.ndarray, np.ndarray] | None = None
    ) -> "Rangefinder":
        """Calibrate on the echo in vacuum.

        Args:
            scene: The scene.
            time: Sample times [s], shape (n,).
            reference: Samples [V], shape (n,).
            fine: Times [s] and voltage [V] of the same echo where it was computed, fine enough to show all of the
                pulse however slow the digitiser; None: the samples.

        Raises:
            ValueError: The scene's own method cannot read that echo.
        """
        detector = scene.detector
        known = (time, reference) if fine is None else fine
        shape = template_curve(known[1], as_waveform(*known)[2])
        walk, offsets = None, {}
        if detector.walk_correction:
            walk = _explained(lambda: range_walk(*known, detector.threshold))
        bare = cls(detector.threshold, detector.fraction, shape, dict.fromkeys(RANGING_METHODS, 0.0), walk)
        for method in RANGING_METHODS:
            try:
                offsets[method] = bare.range(time, reference, method) - scene.target.distance
            except ValueError as fault:
                if method == detector.ranging:
                    raise ValueError(f"the echo in vacuum, without flow, cannot be ranged: {fault}") from None
        return cls(detector.threshold, detector.fraction, shape, offsets, walk)

    def range(self, time: np.ndarray, voltage: np.ndarray, method: str) -> float:
        """Range by one method [m].

        Raises:
            ValueError: The method finds no echo.
        """
        reading = read_range(
            time,
            voltage,
            method,
            threshold=self.threshold,
            template=self.shape if method == "matched-filter" else None,
            fraction=self.fraction,
            shape=self.shape,
        )
        if method == "leading-edge" and self.walk is not None:
            _, volts, period = as_waveform(time, voltage)
            curve, finer = shaped_curve(volts, self.shape, period)
            reading = self.walk.correct(time, voltage, reading, peak=curve.peak if finer > 1 else None)
        return reading - self.calibration[method]

    def ranges(self, time: np.ndarray, voltage: np.ndarray) -> dict[str, float]:
        """Range by each calibrated method [m]; NaN where a method finds no echo."""
        found = {}
        for method in self.calibration:
            try:
                found[method] = self.range(time, voltage, method)
            except ValueError:  # the flow, or the noise, left too little of the echo for this method
                found[method] = math.nan
        return found


def _explained(make):
    try:
        return make()
    except ValueError as fault:
        raise ValueError(f"the echo in vacuum gives no range walk curve: {fault}") from None
