"""Trace a pilot's rays with several numbers of leapfrog samples, and scale all rays' error estimates accordingly."""

import math

import numpy as np

from ..launch import Trials
from ..status import reached

# A ray's estimate is scaled to SAFETY times the pilot's greatest error.
SAFETY = 3.0
# The error as a share of the difference from the sum over every third sample: for order 4, the order of the rule, and
# for order 2.
LEAST_SHARE, GREATEST_SHARE = 1.0 / 80.0, 1.0 / 8.0
# The trajectory error as a share of int P^2 / p_t dt: it never exceeds the path that bending adds.
GREATEST_BEND = 0.5
# The share of the pilot's rays that may be unfit for leapfrog.
UNFIT = 0.1


def error_scales(level: "Level", worst: float, bends: float) -> tuple[float, float]:
    """Scales of a ray's own error estimate that cover the pilot's greatest error `worst` [m]; see `greatest_bend`."""
    share = SAFETY * worst / level.difference if level.difference > 0.0 else GREATEST_SHARE
    trajectory_error_scale = SAFETY * worst / bends if bends > 0.0 else 0.0
    return min(max(share, LEAST_SHARE), GREATEST_SHARE), min(trajectory_error_scale, GREATEST_BEND)


def levels_of(trials: Trials, *counts: int) -> list["Level"]:
    """The pilot with each of these numbers of samples; its error estimates are the unscaled differences."""
    return [Level(*made) for made in zip(trials(*((count, 1.0, 0.0) for count in counts)), counts, strict=True)]


def greatest_bend(trials: Trials, count: int) -> float:
    """The greatest int P^2 / p_t dt of the pilot's rays with so many samples [m]."""
    return Level(trials((count, 0.0, 1.0))[0], count).difference


def level_pair(trials: Trials, count: int) -> tuple["Level", "Level", float]:
    """The pilot with `count` samples and with three times as many, and the `greatest_bend` of the latter.

    The estimates of the latter are those of bending, so that two launches suffice.
    """
    return pair_of(trials(*pair_numbers(count)), count)


def pair_numbers(count: int) -> tuple[tuple[int, float, float], ...]:
    """What `Trials` are asked for `pair_of`."""
    return (count, 1.0, 0.0), (3 * count, 0.0, 1.0)


def pair_of(made: list[dict[str, np.ndarray]], count: int) -> tuple["Level", "Level", float]:
    """The result of `level_pair` from the outputs of trials of `pair_numbers`."""
    level, finest = Level(made[0], count), Level(made[1], 3 * count)
    return level, finest, finest.difference


class Level:
    """The pilot, traced with `count` samples a ray."""

    def __init__(self, arrays: dict[str, np.ndarray], count: int):
        """Take the traced arrays by name."""
        self.count = count
        self.opd, self.step_error, self.direction = arrays["opd"], arrays["step_error"], arrays["direction"]
        arrived = reached(arrays["status"])
        self.good = arrived & np.isfinite(self.step_error)
        good, count = int(np.count_nonzero(self.good)), len(arrived)
        self.is_fit = good > 0 and int(np.count_nonzero(arrived)) - good <= UNFIT * count
        self.difference = float(self.step_error.max(where=self.good, initial=0.0))

    def error(self, finer: "Level") -> float:
        """Greatest change of the optical path difference from this level to a finer one [m]."""
        greatest = float(np.abs(self.opd - finer.opd).max(where=self.good & finer.good, initial=-1.0))
        return greatest if greatest >= 0.0 else math.inf

    def turn(self, other: "Level") -> float:
        """Greatest angle between the directions of this level and another one [rad]."""
        good = self.good & other.good
        return float(np.linalg.norm(self.direction - other.direction, axis=1)[good].max()) if good.any() else math.inf
