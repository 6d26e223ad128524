"""Rays whose own error estimate is above the tolerance: traced again in one place, and told of where that is no help.

Every method estimates the error of each ray's optical path; but of "fixed" and "paper", whose steps are the caller's,
a ray above the tolerance is traced again under error control: in the precision asked for, if it was not so already, and
then in float64 with a power of RETRACE_SHARE of the tolerance. What is above the tolerance even then has the status
TOLERANCE_NOT_MET.
"""

import warnings
from dataclasses import replace

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from .held import held_error
from .launch import launch
from .plan import TracePlan
from .status import RayStatus, reached

# The share of the tolerance that is asked for the last time: error control may end a little above what it is asked for.
# Its powers are for rays that were above the tolerance by more, down to LEAST_SHARE: ten times the steps.
RETRACE_SHARE = 0.5
LEAST_SHARE = 1e-4


class ToleranceWarning(RuntimeWarning):
    """Rays whose own error estimate is above the tolerance asked for, though they were traced again."""


def retrace_rejected(
    field: IndexField, position, direction, plan: TracePlan, until, wavelength: float, arrays: dict
) -> None:
    """Trace the rays again whose "step_error" is above the tolerance.

    Args:
        field: The refractive index.
        position: Starts [m], shape (ray_count, 3).
        direction: Unit vectors, shape (ray_count, 3).
        plan: How the rays were traced; of a method that controls its error.
        until: The stop.
        wavelength: Vacuum wavelength [m].
        arrays: Per-ray results by name, "step_error" and "status" among them, which are changed.
    """
    held = held_error(field, plan.tolerance * wavelength)
    # What was asked for along the undisturbed line stays so; leapfrog and tables stand for full rays.
    asked = "straight" if plan.method == "straight" and not (plan.sample_count or plan.columns) else "adaptive"
    controlled = replace(plan, method=asked, columns=False, sample_count=0, sampling=None)

    def trace_again(rows: np.ndarray, attempt: TracePlan) -> None:
        part = RayBundle(position[rows], direction[rows])
        others = launch(field, part, attempt, until, wavelength, frozenset(arrays) - {"status"})
        # A ray that did not arrive this time, or fared worse, keeps what it had.
        lost = ~reached(arrays["status"][rows]) | ~np.isfinite(arrays["step_error"][rows])
        better = reached(others["status"]) & (others["step_error"] < arrays["step_error"][rows])
        taken = lost | better
        for name, array in arrays.items():
            array[rows[taken]] = others[name][taken]

    if plan.sample_count or plan.columns:
        rows = np.flatnonzero(_rejected(arrays, held))
        if len(rows):
            trace_again(rows, controlled)
    # An estimate in single precision may be rounding alone: it says nothing about steps in float64.
    is_known = plan.precision == "float64" and asked == plan.method
    for round_number in range(1 if is_known else 2):
        rejected = _rejected(arrays, held)
        powers = np.ones(len(rejected))
        if is_known or round_number:
            powers = round_number + _powers(arrays["step_error"], held)
        for power in np.unique(powers[rejected]):
            tolerance = max(RETRACE_SHARE**power, LEAST_SHARE) * plan.tolerance
            rows = np.flatnonzero(rejected & (powers == power))
            trace_again(rows, replace(controlled, precision="float64", tolerance=tolerance))
    status, holds = arrays["status"], arrays["step_error"] <= plan.tolerance * wavelength
    status[(status == RayStatus.OK) & ~holds] = RayStatus.TOLERANCE_NOT_MET
    status[(status == RayStatus.TOLERANCE_NOT_MET) & holds] = RayStatus.OK


def _powers(error: np.ndarray, held: float) -> np.ndarray:
    """The power of RETRACE_SHARE that brings each ray's error estimate below what it is held to; 1 at least.

    A step's share of the tolerance is its share of the undisturbed ray's way through the field. A ray that is turned so
    much that it stays there a hundred times longer ends that much above the tolerance, and now its estimate is known.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.where(np.isfinite(error), error, held) / held
    return np.maximum(np.ceil(np.log(np.maximum(excess, 1.0)) / -np.log(RETRACE_SHARE) + 0.4), 1.0)


def _rejected(arrays: dict, budget: float) -> np.ndarray:
    """Rays that are to be traced again: above the budget [m], or not held by the method at all (infinite)."""
    error = arrays["step_error"]
    return ~(error <= budget) & (reached(arrays["status"]) | np.isinf(error))


def told_of_rejected(plan: TracePlan, count: int, ray_count: int, greatest: float | None, wavelength: float):
    """The plan with a sentence about rays that are above the tolerance still, after a warning; as it is without any.

    Args:
        plan: The plan.
        count: How many rays have the status TOLERANCE_NOT_MET.
        ray_count: Of how many.
        greatest: Their greatest error estimate [m]; None where nobody kept it.
        wavelength: Vacuum wavelength [m].
    """
    if not count:
        return plan
    size = "" if greatest is None else f", the greatest of them {greatest / wavelength:.2g} waves"
    sentence = (
        f"{count} of {ray_count} rays have error estimates above the tolerance of {plan.tolerance:g} waves{size}, "
        "though they were traced again in float64: their status is TOLERANCE_NOT_MET"
    )
    warnings.warn(f"{sentence}; loosen the tolerance, or read step_error", ToleranceWarning, stacklevel=3)
    return replace(plan, reasons=(*plan.reasons, sentence))
