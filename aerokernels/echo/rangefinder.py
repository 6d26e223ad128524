"""A scene's rangefinder: the four ranging methods, each calibrated on the echo of the same scene in vacuum."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..scene import Scene
from .range_walk import RangeWalk, range_walk
from .ranging import RANGING_METHODS, estimate_range


@dataclass(frozen=True, eq=False)
class Rangefinder:
    """How a scene reads ranges.

    Attributes:
        threshold: Level of the leading edge [V].
        fraction: Share of the peak of the constant fraction.
        reference: Samples of the echo in vacuum [V], shape (n,): the matched filter's template.
        calibration: What is subtracted from each method's reading [m]; methods that cannot read the
            reference are absent.
        walk: The curve that the leading edge is corrected by, or None.
    """

    threshold: float
    fraction: float
    reference: np.ndarray
    calibration: Mapping[str, float]
    walk: RangeWalk | None = None

    @classmethod
    def calibrated(cls, scene: Scene, time: np.ndarray, reference: np.ndarray) -> "Rangefinder":
        """Calibrate on the echo in vacuum.

        Args:
            scene: The scene.
            time: Sample times [s], shape (n,).
            reference: Samples [V], shape (n,).

        Raises:
            ValueError: The scene's own method cannot read that echo.
        """
        detector = scene.detector
        walk, offsets = None, {}
        if detector.walk_correction:
            walk = _explained(lambda: range_walk(time, reference, detector.threshold))
        bare = cls(detector.threshold, detector.fraction, reference, dict.fromkeys(RANGING_METHODS, 0.0), walk)
        for method in RANGING_METHODS:
            try:
                offsets[method] = bare.range(time, reference, method) - scene.target.distance
            except ValueError as fault:
                if method == detector.ranging:
                    raise ValueError(f"the echo in vacuum, without flow, cannot be ranged: {fault}") from None
        return cls(detector.threshold, detector.fraction, reference, offsets, walk)

    def range(self, time: np.ndarray, voltage: np.ndarray, method: str) -> float:
        """Range by one method [m].

        Raises:
            ValueError: The method finds no echo.
        """
        template = self.reference if method == "matched-filter" else None
        reading = estimate_range(
            time, voltage, method, threshold=self.threshold, template=template, fraction=self.fraction
        )
        if method == "leading-edge" and self.walk is not None:
            reading = self.walk.correct(time, voltage, reading)
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
