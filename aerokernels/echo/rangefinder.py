"""A scene's rangefinder: the four ranging methods, each calibrated on the echo of the same scene in vacuum."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

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
        blind: Why, for each method that cannot read the reference.
    """

    threshold: float
    fraction: float
    reference: np.ndarray
    calibration: Mapping[str, float]
    walk: RangeWalk | None = None
    blind: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def calibrated(cls, scene: Scene, time: np.ndarray, reference: np.ndarray) -> "Rangefinder":
        """Calibrate on the echo in vacuum.

        Args:
            scene: The scene.
            time: Sample times [s], shape (n,).
            reference: Samples [V], shape (n,).
        """
        detector = scene.detector
        walk, offsets, blind = None, {}, {}
        methods = dict.fromkeys(RANGING_METHODS, 0.0)
        if detector.walk_correction:
            try:
                walk = range_walk(time, reference, detector.threshold)
            except ValueError as fault:
                blind["leading-edge"] = f"the echo in vacuum gives no range walk curve: {fault}"
                del methods["leading-edge"]
        bare = cls(detector.threshold, detector.fraction, reference, methods, walk)
        for method in methods:
            try:
                offsets[method] = bare.range(time, reference, method) - scene.target.distance
            except ValueError as fault:
                blind[method] = f"the echo in vacuum, without flow, cannot be ranged: {fault}"
        return cls(detector.threshold, detector.fraction, reference, offsets, walk, blind)

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

    def ranges(self, time: np.ndarray, voltage: np.ndarray) -> tuple[dict[str, float], dict[str, str]]:
        """Range by each method [m], NaN where it finds no echo or is not calibrated; and why, for those."""
        found, reasons = {}, {}
        for method in RANGING_METHODS:
            found[method] = math.nan
            if method in self.blind:
                reasons[method] = self.blind[method]
                continue
            try:
                found[method] = self.range(time, voltage, method)
            except ValueError as fault:  # the flow, or the noise, left too little of the echo for this method
                reasons[method] = f"the echo cannot be ranged: {fault}"
        return found, reasons
