"""How optical path differences along undisturbed rays change by each cause of an error, bending included."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from ..tracing import Plane
from ..tracing.cuts import lost
from ..tracing.planning import make_plan
from ..tracing.stop import stop_distance
from ..tracing.trace import rerun
from ..tracing.variants.causes import Run, Variants, variants
from ..tracing.variants.rays import Rays


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
    plan = make_plan(
        field,
        method="adaptive",
        backend=options.get("backend") or "auto",
        device=options.get("device"),
        precision="float64",
        step=None,
        tolerance=tolerance,
        max_steps=None,
        path_length=None,
        wavelength=wavelength,
        directions=rays.direction,
    )
    way = stop_distance(rays.position, rays.direction, until)
    base = Rays(np.asarray(opd, np.float64), rays.direction, rays.position + way[:, None] * rays.direction)
    weight = np.broadcast_to(np.asarray(rays.weight, np.float64), way.shape)
    beyond = lost(field, rays, until)
    run = rerun(until, wavelength) if run is None else run
    return variants(field, rays, base, plan, until, run, weight=weight / weight.sum(), lost=beyond)
