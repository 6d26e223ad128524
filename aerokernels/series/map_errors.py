"""Errors of the maps of a series: its numbers on some of the rays, computed again as each cause changes these.

They are computed for a few snapshots, evenly spread, and for those whose wavefront is much steeper or flatter than it
was when that was last so. Each other one takes the errors of the nearest of these in time.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from aerokernels.display.quantities import combine
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.series.pupil_grid import MapReader
from aerokernels.tracing import Plane
from aerokernels.tracing.cuts import lost
from aerokernels.tracing.engines.choice import choose_backend
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.planning import backend_for
from aerokernels.tracing.step_bound import step_allowance
from aerokernels.tracing.stop import stop_distance
from aerokernels.tracing.trace import rerun
from aerokernels.tracing.variants.causes import Variants, errors, of_a_ray, variants
from aerokernels.tracing.variants.paths import Rays

# The numbers, in order; and with the optical path difference of a ray, what has an error.
NAMES = ("strehl", "boresight_x", "boresight_y", "piston", "opd_rms", "opd_rms_with_tilt")
WRONG = (*NAMES, "error")
LEAST_STEP = 128


def map_errors(
    found: Variants | None, points: np.ndarray, wavelength: float, remove: tuple[str, ...]
) -> dict[str, float]:
    """Return the errors of WRONG, by some rays at `points` across the look direction [m]; NaN where none is known."""
    if found is None:
        return dict.fromkeys(WRONG, float("nan"))
    reader = MapReader(points, found.weight, remove, wavelength)
    by_cause = errors(lambda rays: reader(rays.opd).numbers, found)
    totals = [combine({cause: error[k] for cause, error in by_cause.items()})["total"] for k in range(len(NAMES))]
    of_opd = of_a_ray(lambda rays: reader(rays.opd).opd, found)["total"]
    return {**dict(zip(NAMES, totals, strict=True)), "error": of_opd}


class Chosen:
    """Says of one snapshot after another whether errors are computed for it: of 8 places at most, and of 8 others.

    Places are LEAST_STEP or more apart, so that errors take little of the time.
    """

    def __init__(self, total: int):
        """Begin with the first snapshot of `total`."""
        self._step = LEAST_STEP
        while self._step * 8 < total:
            self._step *= 2
        self._number, self._more, self._slope = 0, 0, np.nan

    def __call__(self, slope: float) -> bool:
        """Whether the next snapshot is one of them; `slope` is the mean square of its wavefront's slopes."""
        other = self._number > 0 and not self._slope / 3.0 <= slope <= self._slope * 3.0
        other = other and self._more < 8
        if other or self._number == 0:
            self._slope = slope
        self._more += other
        self._number += 1
        return bool((self._number - 1) % self._step == 0 or other)


def nearest_in_time(errors: np.ndarray) -> np.ndarray:
    """Return errors of all snapshots, shape (n,), from those that were computed; the others are NaN."""
    known = np.flatnonzero(np.isfinite(errors))
    if not len(known):
        return np.full(len(errors), np.nan)
    place = np.arange(len(errors))
    return np.asarray(errors[known[np.abs(place[:, None] - known).argmin(axis=1)]])


def straight_variants(
    field: IndexField,
    rays: RayBundle,
    opd: np.ndarray,
    until: Plane,
    wavelength: float,
    tolerance: float,
    options: Mapping[str, Any],
) -> Variants:
    """Return how rays, in random order, change by cause; that of "step" is what full traces bring besides `opd` [m].

    `opd` is that along straight lines, shape (n,), and `options` are backend and device of the full traces.
    """
    backend = backend_for(field, options.get("backend") or "auto")
    backend, device, _ = choose_backend(backend, options.get("device"))
    allowance = step_allowance(field, "adaptive", None, None)
    plan = TracePlan("adaptive", backend, device, "float64", allowance, None, tolerance)
    way = stop_distance(rays.position, rays.direction, until)
    base = Rays(np.asarray(opd, np.float64), rays.direction, rays.position + way[:, None] * rays.direction)
    weight = np.broadcast_to(np.asarray(rays.weight, np.float64), way.shape)
    beyond = lost(field, rays, until)
    run = rerun(until, wavelength)
    return variants(field, rays, base, plan, until, run, weight=weight / weight.sum(), lost=beyond)
