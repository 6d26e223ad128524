"""Compute the echo in vacuum: target points, record times, and the record that calibrates the rangefinder.

No ray is traced for it. A setup whose echo cannot be computed raises ValueError here.

A body that cuts the beam, or another loss of rays, makes the integrand of the sum over the beam's points jump, and
Gauss points no longer converge fast. `cut_beam` doubles the points along each side until the share of the beam that is
lost is known well enough. Its error is the change from the same sum over half as many points a side and a third of that
from a quarter as many, as independent errors: an error falls about threefold from one rule to the next, but two may
agree by chance.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aerokernels.echo.detector import sample_times
from aerokernels.echo.parts import Setup
from aerokernels.echo.paths import TargetPoints, TransmitPaths, point_power, target_points, transmit_paths, vacuum_paths
from aerokernels.echo.pulses import SPEED_OF_LIGHT, sum_of_pulses
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
