"""The reference engine: traces whole bundles in float64 NumPy, for readability and without formulas of the kernels.

steps.py integrates with DOP853 within one smooth piece of the field after another, to the requested tolerance, at most
LAXEST. `step_error` is the sum over the steps of the errors by the embedded formulas, multiplied by their lever arms to
the stop, and of rounding; of "straight" it is at least the difference from the bent ray.
"""

from dataclasses import replace

import numpy as np

from ....medium import IndexField
from ....rays import RayBundle
from ...plan import RAY_OUTPUTS, TracePlan
from ...stop import RayStatus, reached
from .ends import Ends
from .medium import GridAir
from .mesh import MeshAir
from .steps import Integrator

# The greatest tolerance with which it integrates [waves], and the share of the tolerance that the steps may use.
LAXEST = 1e-9
SHARE = 0.1


def trace(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset):
    """Trace a bundle and return per-ray arrays by name.

    Raises:
        ValueError: Steps of a rule.
    """
    if plan.method in ("fixed", "paper"):
        raise ValueError(
            f"backend 'reference' controls its steps by their errors: method {plan.method!r} is one of backends 'warp' "
            "and 'opencl'"
        )
    start, heading = np.array(rays.position), np.array(rays.direction)
    ends = Ends(field, until)
    interval = ends.interval(start, heading)
    rows = np.flatnonzero(interval.meets & (interval.status == RayStatus.OK))
    flight, turn = None, np.zeros((0, 3))
    if len(rows):
        air = GridAir(field) if field.is_uniform else MeshAir(field)
        some = type(interval)(*(getattr(interval, name)[rows] for name in interval.__dataclass_fields__))
        entry = start[rows] + some.t_enter[:, None] * heading[rows]
        flight = ends.flight(start[rows], heading[rows], some, air.cell_at(entry, heading[rows]))
        integrator = Integrator(
            air,
            field.ambient_index,
            ends,
            SHARE * min(plan.tolerance, LAXEST) * wavelength,
            plan.max_steps,
            plan.method == "straight",
        )
        integrator.begin(flight, np.flatnonzero(~air.in_gap(flight.cell)))
        integrator.run(flight)
        turn = integrator.turn(flight.direction, flight.momentum)
    found = ends.finish(interval, rows, flight, turn, start, heading, plan.method == "straight")
    if plan.method == "straight":
        bent = trace(field, rays, replace(plan, method="adaptive"), until, wavelength, frozenset({"opd"}))
        error = np.where(reached(bent["status"]), np.abs(found["opd"] - bent["opd"]), np.inf)
        fine = reached(found["status"])
        found["step_error"][fine] = np.maximum(found["step_error"], error)[fine]
        found["status"][fine & ~(found["step_error"] <= plan.tolerance * wavelength)] = RayStatus.TOLERANCE_NOT_MET
    return {name: found[name] for name in [*RAY_OUTPUTS, "status"] if name in outputs | {"status"}}
