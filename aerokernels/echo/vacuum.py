"""The echo of a scene in vacuum: what it is summed over, its times, and the record that a rangefinder is calibrated on.

No ray is traced for any of it, and a scene whose echo cannot be computed shows here.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..scene import Scene
from ..tracing import Plane
from .chain import DetectorChain, chain_of
from .detector import sample_times
from .paths import TransmitPaths, target_plane, vacuum_paths
from .pulses import PulseShape, pulse_of
from .received_power import point_power
from .target_points import TargetPoints, target_points
from .waveform import SPEED_OF_LIGHT, sum_of_pulses

# The detector's low-pass rings for a few 1 / bandwidth.
FILTER_MARGIN = 3.0
# Power is computed at least this many times a pulse's time scale and a period of the amplifier's bandwidth, however
# slow the digitiser: nothing of the pulse is aliased, and all noise that is folded into the samples is there.
LEAST_RATE = 8.0
# Light that comes earlier or later than in vacuum by more than this share of a pulse's time scale moves the record's
# ends. Less leaves the sample times as they are, so that scenes that differ in their flow have the same.
LEAST_MOVE = 0.1
GREATEST_SAMPLE_COUNT = 1 << 22


@dataclass(frozen=True, eq=False)
class VacuumEcho:
    """A scene's echo in vacuum.

    Attributes:
        scene: The scene.
        pulse: The shape of its pulse.
        chain: Its detector chain.
        points: The points of the beam that the echo is summed over.
        plane: The target's plane.
        paths: The straight ways to the target.
    """

    scene: Scene
    pulse: PulseShape
    chain: DetectorChain
    points: TargetPoints
    plane: Plane
    paths: TransmitPaths

    @classmethod
    def of(cls, scene: Scene, limits: str | None = None) -> "VacuumEcho":
        """That of a scene; `limits` as for `target_points`, which says what is refused."""
        points, plane = target_points(scene, limits), target_plane(scene)
        return cls(scene, pulse_of(scene), chain_of(scene), points, plane, vacuum_paths(points, plane))

    @cached_property
    def point_power(self) -> np.ndarray:
        """Peak power of each point's pulse at the receiver [W], shape (m,)."""
        return point_power(self.scene, self.points.weight, self.paths, np.ones(len(self.points.weight)))

    def power(self, time: np.ndarray, later: float = 0.0) -> np.ndarray:
        """Received power [W], of the shape of `time` [s]; `later` by that time [s]."""
        return sum_of_pulses(time, 2.0 * self.paths.path / SPEED_OF_LIGHT + later, self.point_power, self.pulse)

    def times(self, path: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, int]:
        """Sample times [s], times at which power is computed, and how many of these make one sample period.

        They follow from the paths in vacuum alone, but where air over kilometres, or glass, makes a long way of it.

        Args:
            path: Optical path of each ray to the target [m], shape (m,), NaN for one that does not arrive; None: those
                in vacuum.

        Raises:
            ValueError: A record of millions of samples.
        """
        vacuum, detector = self.paths.path, self.scene.detector
        delay = 2.0 * vacuum / SPEED_OF_LIGHT
        later = 2.0 * ((vacuum if path is None else path) - vacuum) / SPEED_OF_LIGHT
        least = LEAST_MOVE * self.pulse.timescale
        ends = float(np.nanmin(later)), float(np.nanmax(later))
        early, late = (shift if abs(shift) > least else 0.0 for shift in ends)
        before, after = self.pulse.support
        tail = 0.0 if detector.bandwidth is None else FILTER_MARGIN / detector.bandwidth
        rate = detector.sample_rate
        start, stop = delay.min() + before + min(early, 0.0), delay.max() + after + tail + max(late, 0.0)
        fastest = max(1.0 / self.pulse.timescale, detector.bandwidth or 0.0)
        stride = max(1, math.ceil(LEAST_RATE * fastest / rate))
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
    """The echo of a scene in vacuum, without noise or digitiser, on which its rangefinder is calibrated.

    Returns:
        Sample times after the pulse's peak left [s], and voltage [V], each of shape (n,).

    Raises:
        ValueError: The target reaches back to the aperture, or a record of millions of samples.
    """
    vacuum = VacuumEcho.of(scene)
    time, fine, stride = vacuum.times()
    return time, vacuum.chain.voltage(fine, vacuum.power(fine))[::stride]
