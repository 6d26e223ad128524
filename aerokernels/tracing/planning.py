"""Make the plan of a trace from the caller's choices; the backend is chosen in the order of engines/choice.py.

Decided elsewhere: what of a bundle is interpolated (bundle/run.py), how many leapfrog samples a ray takes
(leapfrog/sample_count.py), a pupil's quadrature (pupil/job.py), and the order and chunks of rays, and which are traced
again (launch.py).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..inputs.checks import check_choice, check_count, check_positive, warn_caller
from ..medium import IndexField
from ..rays import RayBundle
from .engines import engine_of
from .engines.choice import choose_backend
from .engines.info import memory_of
from .error_limit import error_limit
from .grid_tables import prepare_once
from .launch import launch
from .leapfrog.pilot import pays_once
from .leapfrog.sample_count import fit_leapfrog, may_be_leapfrog
from .lines import box_size, lever_arms_of
from .plan import LEAPFROG, METHODS, PRECISIONS, TracePlan
from .step_bound import predict_evaluations, step_allowance

STRAIGHT = "; along the undisturbed line, with the second-order correction of the optical path"


def check_choices(field: IndexField, *, method, precision, tolerance, step) -> None:
    """Reject an unknown name or a number that makes no sense, before any ray is planned."""
    check_choice(method, "method", METHODS)
    if precision not in PRECISIONS:
        raise ValueError(f"precision {precision!r} is not known: choose 'float32' or 'float64'")
    check_positive(tolerance, "tolerance", "waves")
    if method == "fixed":
        if step is None or not (np.isfinite(step) and step > 0.0):
            raise ValueError(f"method 'fixed' needs step, a positive length of arc in metres, got {step!r}")
    elif step is not None:
        raise ValueError(f"step belongs to method 'fixed', not to {method!r}: leave it out or choose 'fixed'")


def plan_rays(
    field: IndexField,
    pilot,
    ray_count: int,
    until,
    *,
    method,
    wavelength,
    rays: RayBundle | None = None,
    like=None,
    sure_count: int | None = None,
    is_once: bool = False,
    **choices,
) -> TracePlan:
    """Return the plan of a bundle: leapfrog where that meets the tolerance; `pilot()` makes some of its rays.

    `rays` is the whole bundle; None if the pilot rays already show its extent. `like` is the plan of such rays through
    a field like this one. `sure_count` rays are traced in any case: it decides whether a table pays. With `is_once` the
    plan has to pay for itself at the first trace.
    """
    if field.geometry == "planar" and choices["path_length"] is None:
        # The box has no end in x: a ray may fly much farther in it than across its other axes.
        lever_arms = lever_arms_of(field, pilot(), until)
        choices["path_length"] = None if lever_arms is None else lever_arms.path_length
    if method == "auto" and may_be_leapfrog(field, ray_count, until):
        # Its number of evaluations is not predicted: the pilot will show it.
        trial = make_plan(field, method="straight", wavelength=wavelength, **choices)

        def evaluations() -> float:
            limit = error_limit(field, choices["tolerance"] * wavelength)
            return predict_evaluations(field, limit, pilot().direction)

        pays = not is_once or pays_once(field, ray_count, evaluations, trial.backend, trial.device)
        if trial.backend != "reference" and pays:
            trial = replace(trial, method=LEAPFROG, reasons=trial.reasons[1:])  # without the reason for the method
            with memory_of(trial.device):
                plan = fit_leapfrog(field, pilot(), trial, until, wavelength, rays, like, sure_count or ray_count)
            if plan is not None:
                return plan
    plan = make_plan(field, method=method, wavelength=wavelength, **choices)
    return seen_in_mesh(field, pilot, sure_count or ray_count, until, wavelength, plan)


def plan_bundle(
    field: IndexField, rays: RayBundle, until, *, method="auto", step=None, is_once=True, **choices
) -> TracePlan:
    """Return the plan of a bundle whose rays are at hand; the other arguments are those of `plan_rays`."""
    return plan_rays(
        field,
        lambda: rays.pilot,
        rays.ray_count,
        until,
        method=method,
        step=step,
        directions=rays.direction if rays.device is None else rays.pilot.direction,
        is_once=is_once,
        rays=rays,
        **choices,
    )


def make_plan(
    field: IndexField,
    *,
    method,
    backend,
    device,
    precision,
    step,
    tolerance,
    max_steps,
    path_length,
    wavelength,
    directions,
) -> TracePlan:
    """Fill in the choices left to "auto"; the others have passed `check_choices`."""
    if method == "fixed" and max_steps is None and step < 1e-8 * box_size(field):
        raise ValueError(
            f"a step of {step:g} m would take more than 1e8 steps through a box of {box_size(field):.3g} m: give a "
            "longer one, or let method 'adaptive' choose"
        )
    if max_steps is not None:
        max_steps = check_count(max_steps, "max_steps", most=2**62)  # no ray takes as many: kernels cut it
    chosen, device, why = choose_backend(backend, device)
    if chosen != "reference":
        with memory_of(device):
            prepare_once(engine_of(chosen, device), field.samples)
    # Names taken from an array are NumPy strings, which the caches of kernels would treat as different keys.
    method, precision = str(method), str(precision)
    reasons = []
    predicted = None
    if method == "auto" and backend == "reference":
        method = "adaptive"
        reasons.append("method adaptive: the reference is the answer that others are measured against")
    elif method == "auto":
        method = "adaptive"
        predicted = predict_evaluations(field, error_limit(field, tolerance * wavelength), directions)
        reasons.append(f"method adaptive: error control, about {predicted:.0f} evaluations a ray across the box")
    else:
        reasons.append(f"method {method}: requested{STRAIGHT if method == 'straight' else ''}")
    reasons.append(why)
    dimension = {"volume": "a volume", "planar": "two axes, x is never expanded"}.get(
        field.geometry, "r and z, never expanded to a volume"
    )
    reasons.append(f"{field.geometry} field: evaluated in {dimension}")
    reasons.append("outside the field's box a ray flies in one step")
    if field.body is None:
        reasons.append("no body: no wall test in the kernel")
    if max_steps is None:
        max_steps = step_allowance(field, method, step, path_length)
    if predicted is None and method == "fixed":
        predicted = 3.0 * box_size(field) / step
    return TracePlan(
        method,
        chosen,
        device,
        precision,
        int(max_steps),
        step,
        float(tolerance),
        tuple(reasons),
        predicted_evaluations=predicted,
        predicted_error=None if method in ("paper", "fixed") else float(tolerance),
    )


# Rays that are traced to see how many evaluations they need, and the number of rays from which they are.
SOME, MANY = 32, 2000
# Evaluations of all rays that take two cores some ten seconds at most, and how many times as many an H100 makes.
LONG, ON_GPU = 2e7, 500.0


def seen_in_mesh(
    field: IndexField, pilot: Callable[[], RayBundle], ray_count: int, until, wavelength: float, plan: TracePlan
) -> TracePlan:
    """The plan of many rays through a mesh with the evaluations that some of them need; warn if they take long."""
    if field.is_uniform or ray_count < MANY or plan.method != "adaptive" or plan.backend == "reference":
        return plan
    rays = pilot()
    some = rays.rows(np.linspace(0, rays.ray_count - 1, min(SOME, rays.ray_count)).round().astype(int))
    found = launch(field, some, plan, until, wavelength, frozenset(["evaluation_count"]))
    each = float(np.mean(np.asarray(found["evaluation_count"])))
    limit = LONG * (ON_GPU if engine_of(plan.backend, plan.device).is_gpu else 1.0)
    if each * ray_count < limit:
        return replace(plan, predicted_evaluations=each)
    needed = f"about {float(f'{each:.2g}'):,.0f} evaluations for each of {ray_count:,} rays"
    warn_caller(
        f"through this mesh error control needs {needed}, which takes long: "
        f"field.resample(tolerance={plan.tolerance:g}) makes a uniform grid of it, through which a ray takes a few "
        "microseconds, and measures the error that this adds"
    )
    return replace(
        plan,
        predicted_evaluations=each,
        reasons=(*plan.reasons, f"a mesh, not resampled: {needed}, seen in {SOME} rays"),
    )
