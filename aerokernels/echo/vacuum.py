"""Compute the echo of a scene in vacuum: target points, record times, and the record that calibrates the rangefinder.

No ray is traced for it. A scene whose echo cannot be computed raises ValueError here.
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

# Time for which the detector's low-pass rings [1 / bandwidth].
FILTER_MARGIN = 3.0
# Least number of power values per timescale of the pulse and per 1 / bandwidth of the amplifier, however slow the
# digitiser: the pulse is not aliased, and all noise that sampling aliases is computed.
LEAST_RATE = 8.0
# The record's ends move if light arrives earlier or later than in vacuum by more than this fraction of the pulse's
# timescale. Smaller delays leave the sample times unchanged, so that scenes that differ only in their flow share them.
LEAST_MOVE = 0.1
GREATEST_SAMPLE_COUNT = 1 << 22


@dataclass(frozen=True, eq=False)
class VacuumEcho:
    """A scene's echo in vacuum.

    Attributes:
        scene: The scene.
        pulse: The shape of its pulse.
        chain: Its detector chain.
        points: The points of the beam over which the echo is summed.
        plane: The target's plane.
        paths: The straight paths to the target.
        limits: The limits of the points, as for `target_points`.
    """

    scene: Scene
    pulse: PulseShape
    chain: DetectorChain
    points: TargetPoints
    plane: Plane
    paths: TransmitPaths
    limits: str | None = None

    @classmethod
    def of(cls, scene: Scene, limits: str | None = None, finer: float = 1.0) -> "VacuumEcho":
        """Compute the points and paths of a scene; arguments and errors as for `target_points`."""
        points, plane = target_points(scene, limits, finer), target_plane(scene)
        return cls(scene, pulse_of(scene), chain_of(scene), points, plane, vacuum_paths(points, plane), limits)

    @cached_property
    def point_power(self) -> np.ndarray:
        """Peak power of each point's pulse at the receiver [W], shape (m,)."""
        return point_power(self.scene, self.points.weight, self.paths, np.ones(len(self.points.weight)))

    def power(self, time: np.ndarray, later: float = 0.0) -> np.ndarray:
        """Return the received power [W], of the shape of `time` [s], for an echo delayed by `later` [s]."""
        return sum_of_pulses(time, 2.0 * self.paths.path / SPEED_OF_LIGHT + later, self.point_power, self.pulse)

    def times(self, path: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, int]:
        """Return sample times [s], times at which power is computed [s], and the number of these per sample period.

        They follow from the paths in vacuum alone, unless air over kilometres, or glass, delays the light noticeably.

        Args:
            path: Group path of each ray to the target [m], shape (m,), NaN for one that does not arrive; None: vacuum.

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
    """Compute the echo of a scene in vacuum, without noise or digitiser, on which its rangefinder is calibrated.

    Returns:
        Sample times after the pulse's peak left [s], and voltage [V], each of shape (n,).

    Raises:
        ValueError: The target reaches back to the aperture, or a record of millions of samples.
    """
    vacuum = VacuumEcho.of(scene)
    time, fine, stride = vacuum.times()
    return time, vacuum.chain.voltage(fine, vacuum.power(fine))[::stride]
