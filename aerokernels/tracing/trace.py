"""The public function `trace`: trace a bundle of rays through a field."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..device_arrays import rows_where
from ..inputs.arguments import checked
from ..inputs.checks import check_choice
from ..inputs.kinds import wrong_kind
from ..medium import IndexField
from ..process.clock import clocked, stage
from ..rays import RayBundle
from .absorption import absorbs, transmission
from .cuts import flow_ends, lost, may_lose
from .launch import report_rejected, run_plan
from .lines import check_meeting
from .plan import RAY_OUTPUTS
from .planning import check_choices, plan_bundle
from .result import TraceResult
from .stop import ArcLength, Plane, RayStatus

if TYPE_CHECKING:
    from .variants.causes import Variants

# Allowed values of `bundle`.
BUNDLES = ("auto", "off")

NONE_REJECTED = np.zeros(0, np.int32)


@checked
def trace(
    field: IndexField,
    rays: RayBundle,
    *,
    method: str = "auto",
    tolerance: float = 1e-3,
    step: float | None = None,
    until=None,
    wavelength: float | None = None,
    backend: str = "auto",
    device: str | None = None,
    precision: str = "float32",
    max_steps: int | None = None,
    outputs=None,
    bundle: str = "auto",
) -> TraceResult:
    """Trace rays through a field.

    Args:
        field: The refractive index.
        rays: Where the rays start and point.
        method: "auto", "straight" (along the undisturbed line, with the second-order correction of the optical path),
            "adaptive" (error controlled), "paper" (step rule of the paper's eq 5) or "fixed" (needs `step`).
        tolerance: Requested OPD error [waves at `wavelength`].
        step: Step of method "fixed" [m of arc length].
        until: None (where the ray leaves the field's box), Plane(point, normal) or ArcLength(length).
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm where it has none.
        backend: "auto", "warp", "opencl" or "reference".
        device: "cpu", "cuda:0" or an OpenCL device's name; None takes the best, or the GPU that holds the rays.
        precision: "float32" or "float64" inside the kernel.
        max_steps: Steps after which a ray is given up; None takes a generous number.
        outputs: Names of the requested per-ray arrays (see RAY_OUTPUTS); None for all. "group_path" stands for the two
            from which it follows, "optical_path" and "arc_length".
        bundle: "auto": if many rays are a smooth map of two parameters (parallel rays, or rays through one point),
            method "auto" traces as many as are needed to interpolate the others within the tolerance; `plan.bundle`
            says how many. "off" traces every ray. Steps and evaluations of an interpolated ray are the greatest of the
            traced rays around it; its `step_error` includes the interpolation error.

    Returns:
        A TraceResult. A ray that fails has a status and does not affect the others.

    Raises:
        TypeError: `field`, `rays` or `until` of the wrong kind.
        ValueError: A name or number that makes no sense, another wavelength than the field's, a backend or device that
            is not available, or a bundle of which no ray meets the field.
        MemoryError: The device's free memory is not enough for the field and a few rays.
    """
    if not isinstance(field, IndexField):
        raise wrong_kind(field, "field", "an IndexField")
    if not isinstance(rays, RayBundle):
        raise wrong_kind(rays, "rays", "a RayBundle")
    if until is not None and not isinstance(until, (Plane, ArcLength)):
        raise wrong_kind(until, "until", "None, a Plane or an ArcLength")
    wavelength = field.wavelength_for(wavelength)
    wanted = check_outputs(outputs)
    check_choice(bundle, "bundle", BUNDLES)
    check_choices(field, method=method, precision=precision, tolerance=tolerance, step=step)
    if backend == "auto" and device is None and rays.device not in (None, "cpu"):
        device = rays.device  # rays that are stored on a GPU are traced there
    choices: dict[str, Any] = {
        "backend": backend,
        "device": device,
        "precision": precision,
        "tolerance": tolerance,
        "max_steps": max_steps,
        "path_length": until.length if isinstance(until, ArcLength) else None,
    }
    with clocked() as seconds:
        with stage("plan"):
            made: Any = "every ray is traced: requested by bundle='off'" if bundle == "off" else None
            if bundle == "auto" and method == "auto" and backend != "reference":
                from .bundle.run import BundleRequest, trace_bundle

                made = trace_bundle(BundleRequest(field, rays, until, wavelength, wanted, choices))
            if isinstance(made, tuple):
                plan, arrays = made
            else:
                check_meeting(field, rays, "ray of the bundle")
                plan = plan_bundle(field, rays, until, method=method, step=step, wavelength=wavelength, **choices)
                plan = plan if made is None else replace(plan, reasons=(*plan.reasons, made))
            ends = flow_ends(field, rays.pilot, until, tolerance * wavelength)
            plan = replace(plan, reasons=(*plan.reasons, ends)) if ends else plan
        if not isinstance(made, tuple):
            arrays = run_plan(field, rays, plan, until, wavelength, wanted)
        # Interpolated rays are within the tolerance: only traced rays can be above it.
        some_traced = plan.bundle is None or plan.bundle.one_by_one > 0
        rejected = rows_where(arrays["status"], RayStatus.TOLERANCE_NOT_MET) if some_traced else NONE_REJECTED
        greatest = float(arrays["step_error"][rejected].max()) if len(rejected) and "step_error" in arrays else None
        done = report_rejected(plan, len(rejected), rays.ray_count, greatest, wavelength)
        if "step_error" not in wanted:
            arrays.pop("step_error", None)

    return TraceResult(
        plan=done,
        seconds=seconds,
        wavelength=wavelength,
        weight=np.asarray(rays.weight),
        start_position=rays.held("position"),
        start_direction=rays.held("direction"),
        varied=partial(_variants, field, rays, until, wavelength),
        lost=partial(_lost, field, rays, until) if may_lose(field, tolerance * wavelength) else None,
        group=partial(_group_path, field, rays, until),
        absorbed=partial(transmission, field, rays, until) if absorbs(field) else None,
        traced_status=arrays.pop("status"),
        **arrays,
    )


def _variants(field: IndexField, rays: RayBundle, until, wavelength: float, result: TraceResult) -> "Variants | None":
    """Return how some of a result's rays change by each cause of an error; None where no ray arrived."""
    from .variants.causes import brought, sample_rows, variants
    from .variants.paths import Rays

    rows = sample_rows(field, rays, result.ok)
    if not len(rows):
        return None
    some = rays.rows(rows)
    if (ends := result.ends) is None:
        base, _ = brought(field, some, replace(result.plan, bundle=None), until, wavelength)
    else:
        base = Rays(np.zeros(len(rows)), ends[1][rows], ends[0][rows])
    base = base if result.opd is None else replace(base, opd=result.opd[rows])
    weight = np.broadcast_to(result.weight, (result.ray_count,))[rows]
    lacked = _lost(field, some, until, result, rows)
    return variants(field, some, base, result.plan, until, wavelength, weight=weight, lost=lacked)


def _lost(field: IndexField, rays: RayBundle, until, result: TraceResult, rows: Any = slice(None)) -> np.ndarray:
    """Return what a result's rays, or those of some rows, lack by cuts of the field [m]."""
    ends = None if result.ends is None else (result.ends[0][rows], result.ends[1][rows])
    return lost(field, rays, until, ends, result.plan.tolerance * result.wavelength)


def _group_path(field: IndexField, rays: RayBundle, until, result: TraceResult) -> np.ndarray:
    """Return the group path of each ray [m]: along the traced path in one gas, else along rays of the group index."""
    group = None if field.upstream is None else field.upstream.group
    assert result.optical_path is not None and result.arc_length is not None
    if group is None:
        return result.optical_path
    if group.field is None:
        disturbed = result.optical_path - field.ambient_index * result.arc_length
        return group.ambient_index * result.arc_length + group.ratio * disturbed
    plan = result.plan
    options = {"tolerance": plan.tolerance, "backend": plan.backend, "device": plan.device, "precision": plan.precision}
    traced = trace(group.field(), rays, until=until, outputs="optical_path", **options)
    return np.asarray(traced.optical_path)


def check_outputs(outputs) -> frozenset:
    """Return the set of output names; an unknown one is refused with a list of those that exist."""
    if outputs is None:
        return frozenset(RAY_OUTPUTS)
    if not isinstance(outputs, (str, list, tuple, set, frozenset)) or not all(isinstance(one, str) for one in outputs):
        raise TypeError(f"outputs must be names, of {', '.join(RAY_OUTPUTS)}, got {outputs!r}")
    wanted = frozenset([outputs] if isinstance(outputs, str) else outputs)
    if "group_path" in wanted:
        wanted = wanted - {"group_path"} | {"optical_path", "arc_length"}
    unknown = sorted(wanted - set(RAY_OUTPUTS) - {"status"})
    if unknown:
        raise ValueError(f"outputs {unknown} are not known: choose from {', '.join(RAY_OUTPUTS)}, group_path")
    return wanted - {"status"}
