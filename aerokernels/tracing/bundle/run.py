"""Trace a bundle as a map of two parameters: some lines are traced, most rays interpolated, the rest traced singly."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aerokernels.tracing.tasks.family import BundleTable, FaceClasses, Family, counted_parameters, find_family

from ...derived import cached_on
from ...device_arrays import DeviceArray, on_host, rows_where
from ...medium import IndexField
from ...rays import RayBundle
from ..cuts import face_strengths
from ..engines import engine_of
from ..engines.info import memory_of
from ..error_limit import error_limit
from ..launch import in_chunks, run_plan, starts_of
from ..leapfrog.pilot import LEAST_RAYS, pays_once
from ..lines import box_size, check_meeting, lever_arms_of
from ..plan import BundleCounts, TracePlan
from ..planning import make_plan, plan_bundle
from ..stop import NOT_DELIVERED
from .lattice import CHANNELS, TRACED, channels_of
from .refine import Refinement
from .tubes import Clearance, Tubes

# Smaller bundles are traced ray by ray.
LEAST_BUNDLE = 10_000
# Fractions of the tolerance for the traced lines and for the interpolation between them.
TRACED_SHARE, PATCH_SHARE = 0.25, 0.6
# Least fraction of the rays that must be interpolated; otherwise all are traced ray by ray.
LEAST_SHARE = 0.5
# Air at a face of the box counts as undisturbed if its OPD over the length of the box is below this fraction of the
# tolerance.
UNDISTURBED = 0.02


@dataclass(frozen=True, eq=False)
class BundleRequest:
    """A request to trace a bundle; `choices` are the other arguments of `make_plan`."""

    field: IndexField
    rays: RayBundle
    until: Any
    wavelength: float
    outputs: frozenset
    choices: dict[str, Any]

    @property
    def error_limit(self) -> float:
        """The OPD error allowed to each ray [m]."""
        return error_limit(self.field, self.choices["tolerance"] * self.wavelength)


def trace_bundle(request: BundleRequest) -> tuple[TracePlan, dict[str, np.ndarray]] | str:
    """The plan and the per-ray arrays of a bundle; or a sentence that says why all its rays are traced one by one."""
    field, rays = request.field, request.rays
    if rays.ray_count < LEAST_BUNDLE:
        return f"fewer than {LEAST_BUNDLE} rays are traced one by one"
    channels = channels_of(request.outputs)
    found = _recognised(field, rays, request.until, request.wavelength, channels, request.choices)
    if isinstance(found, str):
        return f"rays are traced one by one: {found}"
    family, table, plan = found
    with memory_of(plan.device):
        ready = engine_of(plan.backend, plan.device).prepare_bundle(table, request.outputs)
        arrays = in_chunks(ready, starts_of(rays), request.outputs)
        left = rows_where(arrays["status"], NOT_DELIVERED)
    if len(left) > (1.0 - LEAST_SHARE) * rays.ray_count:
        return (
            f"rays are traced one by one: interpolation would be accurate for only {rays.ray_count - len(left)} of them"
        )
    if len(left):
        _trace_left(request, left, arrays)
    counts = BundleCounts(table.traced, rays.ray_count - len(left), len(left), table.error, dict(table.refused))
    share = (table.traced + len(left)) / rays.ray_count
    predicted = None if plan.predicted_evaluations is None else plan.predicted_evaluations * share
    reasons = (counts.sentence(family.converges, request.wavelength), *plan.reasons)
    return replace(plan, bundle=counts, reasons=reasons, predicted_evaluations=predicted), arrays


@cached_on("field", 4)
def _recognised(
    field: IndexField, rays: RayBundle, until, wavelength: float, channels: int, choices: dict[str, Any]
) -> tuple[Family, BundleTable, TracePlan] | str:
    """The family of the rays, its patches and the plan of its lines; or the reason why there are none."""
    request = BundleRequest(field, rays, until, wavelength, frozenset(), choices)
    check_meeting(field, rays, "ray of the bundle")
    family = find_family(field, rays, until, request.error_limit)
    if isinstance(family, str):
        return family
    if not field.is_uniform:
        return "the field is on a mesh"
    table = find_table(request, family, channels)
    if table is None:
        return "no map between traced rays is smooth enough"
    tolerance = choices["tolerance"]
    return family, table, replace(_line_plan(request), tolerance=tolerance, predicted_error=tolerance)


def find_table(request: BundleRequest, family: Family, channels: int) -> BundleTable | None:
    """The patches of a family; None where no block can be interpolated. `channels` are those of the outputs."""
    field, limit = request.field, request.error_limit
    counted, share = counted_parameters(family, request.rays)
    refinement = Refinement(
        family=family,
        classes=FaceClasses(field, request.until, face_strengths(field) * box_size(field) > UNDISTURBED * limit),
        tracer=_Tracer(request),
        tubes=Tubes.of(field, family, request.until, channels > 1),
        clearance=None if field.body is None else Clearance(field, family, request.until),
        limits=_limits(request, limit),
        channels=channels,
    )
    return refinement.run(counted, share)


def _limits(request: BundleRequest, limit: float) -> np.ndarray:
    """The error limits of patches; a direction's is the slope that changes the path by its limit over one cell."""
    error = PATCH_SHARE * limit
    lever_arms = lever_arms_of(request.field, request.rays.pilot, request.until)
    turn = limit / float(np.min(request.field.spacing))
    scale = np.full(CHANNELS, error)
    scale[1:4] = turn
    scale[4:7] = max(turn * (lever_arms.reach if lever_arms is not None else 0.0), error)
    return scale


class _Tracer:
    """Trace lines to a fraction of the tolerance: many at a time by leapfrog steps where these are accurate enough."""

    def __init__(self, request: BundleRequest):
        self.request = request
        self.few = _line_plan(request)
        self.many: TracePlan | None = None
        self.traced = 0

    def __call__(self, rays: RayBundle) -> dict[str, np.ndarray]:
        request, plan = self.request, self.few
        self.traced += rays.ray_count
        cost = plan.predicted_evaluations or 0.0
        pays = pays_once(request.field, self.traced, lambda: cost, plan.backend, plan.device)
        if pays and rays.ray_count >= LEAST_RAYS:
            self.many = self.many or _plan_many(request, rays, TRACED_SHARE)
            plan = self.many
        return on_host(run_plan(request.field, rays, plan, request.until, request.wavelength, TRACED))


def _line_plan(request: BundleRequest) -> TracePlan:
    """The plan that traces few lines, with error control to TRACED_SHARE of the tolerance."""
    choices = {**request.choices, "tolerance": TRACED_SHARE * request.choices["tolerance"]}
    given = {"method": "auto", "step": None, "wavelength": request.wavelength, **choices}
    return make_plan(request.field, directions=request.rays.pilot.direction, **given)


def _plan_many(request: BundleRequest, rays: RayBundle, share: float) -> TracePlan:
    choices = {**request.choices, "tolerance": share * request.choices["tolerance"]}
    # The plan is used for all lines of a table, or whenever rays of the family are traced.
    return plan_bundle(request.field, rays, request.until, wavelength=request.wavelength, is_once=False, **choices)


def _trace_left(request: BundleRequest, rows: Any, arrays: dict[str, Any]) -> None:
    """Trace the rays of these rows one by one, and write their results into `arrays`."""
    rays = request.rays.part(rows)
    plan = _plan_many(request, rays, 1.0)
    outputs = request.outputs | {"step_error"}
    found = run_plan(request.field, rays, plan, request.until, request.wavelength, outputs)
    for name, array in found.items():
        if name in arrays:
            arrays[name][rows] = array if isinstance(arrays[name], DeviceArray) else np.asarray(array)
