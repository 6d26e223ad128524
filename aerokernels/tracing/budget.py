r"""The error budget of a trace's optical path difference, by cause, measured on a subset of its rays.

    precision       the run's own steps in the run's precision against the same steps in float64
    step            those against float64 steps held to a far smaller tolerance (of the full ray, if it was straight)
    interpolation   through every second and every fourth node of the field, extrapolated (medium/coarser.py)
    resampling      measured when the field was resampled
    sampling        0: a trace is no mean over rays (an estimate over a pupil fills it in)
    total           root sum of squares

Every cause of a trace is the greatest over the rays of the subset, times SAFETY for the rays outside it. Where a cause
cannot be measured (no ray arrived; an unstructured mesh) it is nan, and so is the total. A field that was resampled has
as its "interpolation" that of the field it came from.

The reference backend stands in for no others: its own step error is that of SciPy at 1e-11.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..medium import IndexField, ResamplingError
from ..rays import RayBundle
from .plan import TracePlan, step_allowance
from .status import reached

SUBSET = 192
SAFETY = 3.0
# The tolerance that stands for the truth, as a share of the one asked for, and the greatest one that is taken for asked
# for [waves]. Where the gradient jumps at every cell a far smaller one is out of reach.
TIGHTER = {"linear": 1.0 / 8.0, "bilinear": 1.0 / 8.0}
TIGHTER_ELSEWHERE = 1.0 / 64.0
TIGHTEST_ASKED = 1e-3
CAUSES = ("step", "interpolation", "resampling", "precision", "sampling")
# (field, rays, plan) -> OPD [m] and status, each of shape (ray_count,)
Retrace = Callable[[IndexField, RayBundle, TracePlan], tuple[np.ndarray, np.ndarray]]


def subset(rays: RayBundle, good: np.ndarray) -> RayBundle:
    """Up to SUBSET of the rays that arrived, evenly spread over the bundle's order."""
    rows = np.flatnonzero(good)
    rows = rows[np.linspace(0, len(rows) - 1, min(SUBSET, len(rows))).round().astype(int)] if len(rows) else rows
    return RayBundle(rays.position[rows], rays.direction[rows])


def opd_errors(field: IndexField, rays: RayBundle, plan: TracePlan, retrace: Retrace) -> dict[str, np.ndarray]:
    """Estimated OPD errors [m] of the rays, by cause: "step", "precision", "interpolation".

    Rays that do not arrive in every trace are left out, so arrays may differ in length; an empty one is not known.
    """
    tight = replace(
        plan,
        method="adaptive",
        columns=False,
        sample_count=0,
        step=None,
        backend="warp" if plan.backend == "reference" else plan.backend,
        precision="float64",
        tolerance=TIGHTER.get(field.interpolation, TIGHTER_ELSEWHERE) * min(plan.tolerance, TIGHTEST_ASKED),
        max_steps=max(plan.max_steps, step_allowance(field, "adaptive", None, None)),
    )
    truth = retrace(field, rays, tight)
    if plan.backend == "reference":
        found = {"step": np.zeros(1), "precision": np.zeros(1)}
    else:
        run = retrace(field, rays, plan)
        exact = run if plan.precision == "float64" else retrace(field, rays, replace(plan, precision="float64"))
        found = {"step": _change(exact, truth), "precision": _change(run, exact)}
    if field.resampling is not None:
        return found
    rungs = field.ladder
    if rungs is None:
        found["interpolation"] = np.zeros(0)
        return found
    traces = [truth if rungs.fine is field else retrace(rungs.fine, rays, tight)]
    traces += [retrace(rung, rays, tight) for rung in (rungs.coarse, rungs.coarser) if rung is not None]
    good = np.logical_and.reduce([reached(status) for _, status in traces])
    opd = [path[good] for path, _ in traces]
    found["interpolation"] = rungs.remainder(opd[0], opd[1], opd[2] if len(opd) > 2 else None) if good.any() else opd[0]
    return found


def float64_rounding(field: IndexField, rays: RayBundle) -> float:
    """What float64 itself leaves of an OPD [m]: a few roundings of the lengths, which nothing better checks."""
    low, high = field.box
    lengths = np.concatenate([low, high, rays.position.ravel()])
    return float(4.0 * np.finfo(np.float64).eps * np.abs(lengths[np.isfinite(lengths)]).max())


def _change(one, other) -> np.ndarray:
    good = reached(one[1]) & reached(other[1])
    return np.asarray(one[0][good] - other[0][good])


def error_budget(
    field: IndexField, rays: RayBundle, good: np.ndarray, plan: TracePlan, retrace: Retrace
) -> dict[str, float]:
    """The budget of a trace [m of OPD]: the greatest error of each cause over the rays that arrived."""
    chosen = subset(rays, good) if good.any() else None
    if chosen is None:
        return dict.fromkeys((*CAUSES, "total"), float("nan"))
    found = opd_errors(field, chosen, plan, retrace)
    causes = {cause: SAFETY * _greatest(array) for cause, array in found.items()}
    causes["precision"] += float64_rounding(field, chosen)
    return combine(causes, field.resampling, ("source_opd_max", "opd_max"))


def combine(causes: dict[str, float], resampling, names: tuple[str, str]) -> dict[str, float]:
    """All causes and their root sum of squares; `names` are the attributes of a ResamplingError to take."""
    budget = {**dict.fromkeys(CAUSES, 0.0), **causes}
    if isinstance(resampling, ResamplingError):
        budget["interpolation"], budget["resampling"] = (float(getattr(resampling, name)) for name in names)
    budget["total"] = float(np.sqrt(sum(v * v for v in budget.values())))
    return budget


def _greatest(array: np.ndarray) -> float:
    return float(np.abs(array).max()) if len(array) else float("nan")
