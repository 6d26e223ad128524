"""Trace a pilot's rays with several numbers of leapfrog samples, scale rays' error estimates, and weigh the cost."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...rays import RayBundle
from ..engines import engine_of
from ..launch import Trials
from ..plan import TracePlan
from ..step_bound import predict_evaluations
from ..stop import reached

# A ray's estimate is scaled to SAFETY times the pilot's greatest error.
SAFETY = 3.0
# The error as a share of the difference from the sum over every third sample: for order 4, the order of the rule, and
# for order 2.
LEAST_SHARE, GREATEST_SHARE = 1.0 / 80.0, 1.0 / 8.0


def error_scales(level: "Level", worst: float, bends: float) -> tuple[float, float]:
    """Scales of a ray's own error estimate that cover the pilot's greatest error `worst` [m]; see `greatest_bend`."""
    share = SAFETY * worst / level.difference if level.difference > 0.0 else GREATEST_SHARE
    trajectory_error_scale = SAFETY * worst / bends if bends > 0.0 else 0.0
    # The trajectory error as a share of int P^2 / p_t dt: it never exceeds the path that bending adds.
    return min(max(share, LEAST_SHARE), GREATEST_SHARE), min(trajectory_error_scale, 0.5)


def levels_of(trials: Trials, *counts: int) -> list["Level"]:
    """The pilot with each of these numbers of samples; its error estimates are the unscaled differences."""
    return [Level(*made) for made in zip(trials(*((count, 1.0, 0.0) for count in counts)), counts, strict=True)]


def greatest_bend(trials: Trials, count: int) -> float:
    """The greatest int P^2 / p_t dt of the pilot's rays with so many samples [m]."""
    return Level(trials((count, 0.0, 1.0))[0], count).difference


def level_pair(trials: Trials, count: int) -> tuple["Level", "Level", float]:
    """The pilot with `count` and three times as many samples, and the latter's `greatest_bend`, in two launches."""
    first, second = trials((count, 1.0, 0.0), (3 * count, 0.0, 1.0))
    level, finest = Level(first, count), Level(second, 3 * count)
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
        # The share of the pilot's rays that may be unfit for leapfrog.
        self.is_fit = good > 0 and int(np.count_nonzero(arrived)) - good <= 0.1 * count
        self.difference = float(self.step_error.max(where=self.good, initial=0.0))

    def error(self, finer: "Level") -> float:
        """Greatest change of the optical path difference from this level to a finer one [m]."""
        greatest = float(np.abs(self.opd - finer.opd).max(where=self.good & finer.good, initial=-1.0))
        return greatest if greatest >= 0.0 else math.inf

    def turn(self, other: "Level") -> float:
        """Greatest angle between the directions of this level and another one [rad]."""
        good = self.good & other.good
        return float(np.linalg.norm(self.direction - other.direction, axis=1)[good].max()) if good.any() else math.inf


# Fewer rays are traced under error control at once: a pilot would not pay.
LEAST_RAYS = 4096
# To search a field for structure between samples takes as long as so many evaluations under error control for each node
# of its grid, on a CPU (False). A GPU (True) makes many more in that time, but large bundles are traced repeatedly.
EVALUATIONS_OF_NODE = {False: 6.0, True: 48.0}  # speed only
# Up to CHEAP samples leapfrog is always taken. Above that it is taken where the samples are at most WORTH times the
# evaluations predicted for error control: a sample costs less than an evaluation, and much less on OpenCL, where the
# lanes of a CPU share it.
CHEAP = {"opencl": 450, "warp": 120}
WORTH = {"opencl": 5.0, "warp": 1.2}
MOST_SAMPLES = 3000
# Where rays side by side are further apart than this many cells at the end of their paths, the lanes of a CPU hardly
# share lookups, and a sample in a volume costs this many times as much.
APART, SCATTERED = 2.0, 4.0  # speed only


def pays_once(field: IndexField, ray_count: int, evaluations: Callable[[], float], backend: str, device: str) -> bool:
    """Whether the plan of a bundle that is traced once takes less time than leapfrog saves over error control."""
    grid = field.samples
    if backend == "reference" or not isinstance(grid, UniformGrid) or ray_count < LEAST_RAYS:
        return False
    least = EVALUATIONS_OF_NODE[engine_of(backend, device).is_gpu] * grid.samples.size
    # Error control hardly ever takes fewer evaluations for a ray (speed only).
    return ray_count * 20.0 >= least or ray_count * evaluations() >= least


@dataclass(frozen=True, eq=False)
class SampleCost:
    """The cost of samples, by the OPD error allowed to a ray and the length of the longest in the support [m]."""

    field: IndexField
    pilot: RayBundle
    plan: TracePlan
    limit: float
    length: float

    @cached_property
    def of_sample(self) -> float:
        """The cost of a sample over that of a sample whose lookup the lanes of a CPU share."""
        if self.plan.backend != "opencl" or self.field.geometry != "volume":
            return 1.0
        is_gpu = engine_of(self.plan.backend, self.plan.device).is_gpu
        return 1.0 if is_gpu or not self._are_scattered() else SCATTERED

    def _are_scattered(self) -> bool:
        """Whether rays side by side part: their directions are no linear function of their positions."""
        place, along = self.pilot.position, self.pilot.direction
        terms = np.column_stack([np.ones(len(place)), place - place.mean(axis=0)])
        rest = along - terms @ np.linalg.lstsq(terms, along, rcond=None)[0]
        angle = math.sqrt(float((rest**2).sum(axis=1).mean()))
        return angle * self.length > APART * float(np.min(self.field.spacing))

    @property
    def evaluations(self) -> float:
        """Field evaluations of a ray under error control, as predicted."""
        return predict_evaluations(self.field, self.limit, self.pilot.direction)

    def of_retraced(self) -> float:
        """The cost of tracing a ray under error control, in samples."""
        return max(CHEAP[self.plan.backend], WORTH[self.plan.backend] * self.evaluations) / self.of_sample

    def is_worth_it(self, count: int) -> bool:
        """Whether so many samples cost less than error control; that cost is predicted only where it may decide."""
        size = count * self.of_sample
        if size <= CHEAP[self.plan.backend] or count > MOST_SAMPLES:
            return count <= MOST_SAMPLES
        return size <= WORTH[self.plan.backend] * self.evaluations
