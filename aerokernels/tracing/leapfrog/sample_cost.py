"""What the leapfrog samples of a bundle cost beside error control: it decides which of the two traces the rays."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...rays import RayBundle
from ..engines import engine_of
from ..plan import TracePlan
from ..prediction import predict_evaluations

# Fewer rays are traced under error control at once: a pilot would not pay.
LEAST_RAYS = 4096
# To search a field for structure between samples takes as long as so many evaluations under error control for each node
# of its grid, on a CPU (False). A GPU (True) makes many more in that time, but large bundles are traced repeatedly.
EVALUATIONS_OF_NODE = {False: 6.0, True: 48.0}  # speed only
# Error control hardly ever takes fewer evaluations for a ray.
FEWEST_EVALUATIONS = 20.0  # speed only
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
    """Whether the plan of a bundle that is traced once takes less time than leapfrog saves.

    Args:
        field: The refractive index.
        ray_count: Number of rays.
        evaluations: Predicts the field evaluations of a ray under error control.
        backend: Where they are traced.
        device: Its device.
    """
    grid = field.samples
    if backend == "reference" or not isinstance(grid, UniformGrid) or ray_count < LEAST_RAYS:
        return False
    least = EVALUATIONS_OF_NODE[engine_of(backend, device).is_gpu] * grid.samples.size
    return ray_count * FEWEST_EVALUATIONS >= least or ray_count * evaluations() >= least


@dataclass(frozen=True, eq=False)
class SampleCost:
    """The cost of samples of a bundle.

    Attributes:
        field: A field on a uniform grid.
        pilot: Some of the rays.
        plan: Their backend and device.
        limit: The OPD error allowed to a ray [m].
        length: Length of the longest ray through the field's support [m].
    """

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
