"""How optical path differences along undisturbed rays change by each cause of an error, bending included."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from ..tracing import Plane
from ..tracing.cuts import lost
from ..tracing.engines.choice import choose_backend
from ..tracing.plan import TracePlan
from ..tracing.planning import backend_for
from ..tracing.step_bound import step_allowance
from ..tracing.stop import stop_distance
from ..tracing.trace import rerun
from ..tracing.variants.causes import Run, Variants, variants
from ..tracing.variants.paths import Rays


def straight_variants(
    field: IndexField,
    rays: RayBundle,
    opd: np.ndarray,
    until: Plane,
    wavelength: float,
    tolerance: float,
    options: Mapping[str, Any],
    run: Run | None = None,
) -> Variants:
    """Return how the rays change by cause; the part of "step" is what rays traced in full bring besides `opd`.

    Args:
        field: The refractive index.
        rays: The rays, in random order; `weight` is their share in means.
        opd: Their optical path differences along straight lines [m], shape (n,).
        until: Their stop.
        wavelength: Vacuum wavelength [m].
        tolerance: Requested OPD error [waves].
        options: backend and device of rays that are traced.
        run: Traces rays in full; None takes the package's own tracer.
    """
    backend = backend_for(field, options.get("backend") or "auto")
    backend, device, _ = choose_backend(backend, options.get("device"))
    allowance = step_allowance(field, "adaptive", None, None)
    plan = TracePlan("adaptive", backend, device, "float64", allowance, None, tolerance)
    way = stop_distance(rays.position, rays.direction, until)
    base = Rays(np.asarray(opd, np.float64), rays.direction, rays.position + way[:, None] * rays.direction)
    weight = np.broadcast_to(np.asarray(rays.weight, np.float64), way.shape)
    beyond = lost(field, rays, until)
    run = rerun(until, wavelength) if run is None else run
    return variants(field, rays, base, plan, until, run, weight=weight / weight.sum(), lost=beyond)
