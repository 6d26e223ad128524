"""Trace again the rays whose own error estimate is above the tolerance, and report those that stay above it.

First in the requested precision under error control, then in float64 with the tolerance times a power of RETRACE_SHARE;
"fixed" and "paper" take the caller's steps. A ray whose steps are exhausted in float32 has an infinite error: rounding
may have kept them short.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aerokernels.inputs.checks import warn_caller

from ..device_arrays import rows_beside, rows_where
from ..medium import IndexField
from ..rays import RayBundle
from .error_limit import error_limit
from .launch import launch
from .plan import TracePlan
from .status import RayStatus, reached

# A further attempt requests this share of the last attempt's tolerance, since error control may end a little above the
# requested tolerance. Rays that were further above it get a power of the share, at least LEAST_SHARE: ten times the
# steps.
RETRACE_SHARE = 0.5
LEAST_SHARE = 1e-4
# A ray along a straight line whose error falls by less than this with shorter steps is not traced again.
STEPS_FALL = 0.7
# From this many waves on, an error estimate means only that there is no bound.
UNBOUNDED = 1e6


class ToleranceWarning(RuntimeWarning):
    """Some rays were traced again, and their own error estimate is still above the requested tolerance."""


def retrace_rejected(
    field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, arrays: dict
) -> None:
    """Trace again those rays whose "step_error" is above the tolerance; others are not copied from the device.

    `arrays` are per-ray results by name, "step_error" and "status" among them, which are changed in place.
    """
    limit = error_limit(field, plan.tolerance * wavelength)
    rows = rows_where(arrays["status"], RayStatus.TOLERANCE_NOT_MET, arrays["step_error"], limit)
    if not len(rows):
        return
    # From a device only the results by which rays are judged are read.
    there = rows_beside(arrays["status"], rows)
    part = rays.part(rows if rays.device is None else there)
    status, error = arrays["status"][rows], arrays["step_error"][rows]

    def trace_again(chosen: np.ndarray, attempt: TracePlan) -> None:
        """Trace these rays of the part again; a ray that got worse, or was lost, keeps its previous results."""
        some = part if len(chosen) == len(rows) else part.part(chosen)
        found = launch(field, some, attempt, until, wavelength, frozenset(arrays) - {"status"})
        new_status, new_error = np.asarray(found["status"]), np.asarray(found["step_error"])
        flew_past = status[chosen] == RayStatus.STOP_NOT_REACHED
        is_worth_keeping = flew_past | (reached(status[chosen]) & np.isfinite(error[chosen]))
        ended = reached(new_status) | (new_status == RayStatus.STOP_NOT_REACHED)
        taken = np.flatnonzero(~is_worth_keeping | (ended & (new_error < error[chosen])))
        replaced = chosen[taken]
        status[replaced], error[replaced] = new_status[taken], new_error[taken]
        for name in arrays.keys() - {"status", "step_error"}:
            if len(taken) == len(rows):
                arrays[name][there] = found[name]
            else:
                arrays[name][rows[replaced]] = found[name][taken]

    _trace_rejected(trace_again, plan, status, error, limit)
    holds = error <= plan.tolerance * wavelength
    status[(status == RayStatus.OK) & ~holds] = RayStatus.TOLERANCE_NOT_MET
    status[(status == RayStatus.TOLERANCE_NOT_MET) & holds] = RayStatus.OK
    arrays["status"][there], arrays["step_error"][there] = status, error


def _trace_rejected(
    trace_again: Callable[[np.ndarray, TracePlan], None],
    plan: TracePlan,
    status: np.ndarray,
    error: np.ndarray,
    limit: float,
) -> None:
    """Trace rays again that are above the allowed error `limit` [m], attempt by attempt."""
    # A trace along undisturbed lines remains one; leapfrog is replaced by another method for bent rays.
    asked = "straight" if plan.method == "straight" and not plan.sample_count else "adaptive"
    controlled = replace(plan, method=asked, sample_count=0, sampling=None)
    if plan.looks_up_cubes:  # the spline may be accurate where the polynomials of cubes are not
        chosen = np.flatnonzero(_rejected(status, error, limit) & np.isfinite(error))
        if len(chosen):
            trace_again(chosen, replace(plan, cubes=False))
    if plan.sample_count:
        chosen = np.flatnonzero(_rejected(status, error, limit))
        if len(chosen):
            trace_again(chosen, controlled)
    # An estimate in single precision may be rounding alone: it does not show which steps float64 needs.
    is_known = plan.precision == "float64" and asked == plan.method
    share = np.ones(len(status))  # of the tolerance, by which each ray was traced
    fell = np.ones(len(status), dtype=bool)
    for round_number in range(2 if is_known else 3):
        rejected, before = _rejected(status, error, limit) & fell, error.copy()
        by_steps = asked == "adaptive" and (is_known or round_number)
        powers = _powers(error, limit) if by_steps else 1.0
        share = np.where(rejected, np.maximum(share * RETRACE_SHARE**powers, LEAST_SHARE), share)
        for part in np.unique(share[rejected]):
            chosen = np.flatnonzero(rejected & (share == part))
            trace_again(chosen, replace(controlled, precision="float64", tolerance=part * plan.tolerance))
        if asked == "straight":  # shorter steps do not lower what a straight line neglects
            fell = error <= STEPS_FALL * before


def _powers(error: np.ndarray, limit: float) -> np.ndarray:
    """The power of RETRACE_SHARE that brings each ray's error estimate below the allowed error; at least 1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.where(np.isfinite(error), error, limit) / limit
    return np.maximum(np.ceil(np.log(np.maximum(excess, 1.0)) / -np.log(RETRACE_SHARE) + 0.4), 1.0)


def _rejected(status: np.ndarray, error: np.ndarray, limit: float) -> np.ndarray:
    """Which rays must be traced again: above the limit [m], or outside what the method can estimate (infinite)."""
    # A ray that passes beside its stop by an error above the limit may meet it.
    return ~(error <= limit) & (reached(status) | (status == RayStatus.STOP_NOT_REACHED) | np.isinf(error))


def report_rejected(plan: TracePlan, count: int, ray_count: int, greatest: float | None, wavelength: float):
    """Warn of rays that are still above the tolerance, and return the plan with a sentence about them.

    `greatest` is their greatest error estimate [m]; None where it was not kept.
    """
    if not count:
        return plan
    size = "" if greatest is None else f", the greatest of them {greatest / wavelength:.2g} waves"
    if greatest is not None and not greatest <= UNBOUNDED * wavelength:
        size = ", some of them without bound"
    sentence = (
        f"{count} of {ray_count} rays have error estimates above the tolerance of {plan.tolerance:g} waves{size}, "
        "though they were traced again in float64: their status is TOLERANCE_NOT_MET"
    )
    warn_caller(f"{sentence}; loosen the tolerance, or read step_error", ToleranceWarning)
    return replace(plan, reasons=(*plan.reasons, sentence))
