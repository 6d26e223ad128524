r"""The error budget of a trace's optical path difference, by cause, measured on a subset of its rays.

    precision       the run's own steps in the run's precision against the same steps in float64
    step            float64 steps against float64 steps with a far smaller tolerance (of the curved ray, also if the run
                    was along straight lines)
    interpolation   through every second and every fourth node of the field, extrapolated (medium/levels.py); on a
                    uniform grid at least the terms that the interpolant omits (grid_error.py)
    resampling      for a resampled field, its difference from the original field, to the same stop; for an interpolant
                    of cell averages, the deficit of the averages along the ray (average_deficit.py); for a volume, the
                    change by resampling the flow's cells, on lines through it (`IndexField.upstream`)
    sampling        0: a trace is no mean over rays (an estimate over a pupil fills it in)
    bundle          the error of interpolating between traced rays, as estimated while they were chosen (bundle/)
    truncation      the OPD that rays lack because the field was cut from a larger one (cuts.py)
    refractivity    the uncertainty of the model that made the index from a density: a share of the OPD. A finer
                    computation would not reduce it, so it is given beside the total and is not part of it
    total           root sum of squares of the others

Each cause up to "sampling" is the greatest over the rays of the subset. All but "bundle" and "refractivity", which have
factors of their own, and "truncation", which is computed, are multiplied by SAFETY, to cover the rays outside the
subset and errors that an estimate cannot see. Rays are traced to the run's own stop, so that an error of direction
counts as it does there. A cause that cannot be measured (no ray arrived, or the field before resampling was not kept)
is nan, and so is the total. For a resampled field "interpolation" is that of the field it was made from.

The steps of the reference backend are more accurate than the trace that would have to serve as the truth. Where this
backend chooses its steps, the step error is its own estimate: the sum of its embedded formulae.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...medium import IndexField
from ...rays import RayBundle
from ..allowance import step_allowance
from ..cuts import lost
from ..lines import SIDE, box_span
from ..plan import TracePlan
from ..status import reached
from ..stop import Plane
from .average_deficit import deficit_integrals
from .grid_error import greatest, grid_error
from .rays import subset

SAFETY = 3.0
# The tolerance of the trace that serves as the truth, as a share of the requested one; a requested tolerance above
# TIGHTEST_ASKED [waves] counts as that. Where the gradient jumps at every cell, far smaller ones cannot be reached.
TIGHTER = {"linear": 1.0 / 8.0, "bilinear": 1.0 / 8.0}
TIGHTER_ELSEWHERE = 1.0 / 64.0
TIGHTEST_ASKED = 1e-3
CAUSES = ("step", "interpolation", "resampling", "precision", "sampling", "bundle", "truncation", "refractivity")
# Of the rays that leave through the curved side of a field's box, this many are traced, each to a plane of its own.
SIDE_RAYS = 16
# (field, rays, plan, until, wavelength) -> OPD [m], status and the trace's own estimate of its error [m], each of shape
# (ray_count,)
Traced = tuple[np.ndarray, np.ndarray, np.ndarray]
Run = Callable[[IndexField, RayBundle, TracePlan, object, float], Traced]


@dataclass(frozen=True, eq=False)
class Retrace:
    """How a budget traces rays again: `run` to the stop `until`, at a wavelength [m]."""

    run: Run
    until: object
    wavelength: float

    def __call__(self, field: IndexField, rays: RayBundle, plan: TracePlan) -> Traced:
        """OPD [m], status and own error [m], each of shape (ray_count,)."""
        return self.run(field, rays, plan, self.until, self.wavelength)


def opd_errors(field: IndexField, rays: RayBundle, plan: TracePlan, retrace: Retrace) -> dict[str, np.ndarray]:
    """Estimated OPD errors [m] of the rays: "step", "precision", "interpolation", "resampling", "refractivity".

    Rays that do not arrive in every trace are left out, so the arrays may differ in length. An empty array means that
    the error is not known. "omitted" has the terms that an interpolant on a uniform grid omits, and bounds of the rest,
    shape (2, n): the interpolation error is at least that.
    """
    tight = _tight(field, plan)
    truth = retrace(field, rays, tight)
    run = retrace(field, rays, plan)
    if plan.backend == "reference":
        found = {"step": run[2][reached(run[1])], "precision": np.zeros(1)}
        if plan.method != "adaptive":  # the steps, or the straight line, are not chosen by error control
            found["step"] = np.maximum(_greatest(found["step"]), np.abs(_change(run, truth)))
    else:
        exact = run if plan.precision == "float64" else retrace(field, rays, replace(plan, precision="float64"))
        found = {"step": _change(exact, truth), "precision": _change(run, exact)}
    made = field.upstream
    found["refractivity"] = np.zeros(1) if made is None else made.refractivity * run[0][reached(run[1])]
    if field.resampling is None:
        lacks = deficit_integrals(field, rays, retrace.until)[reached(truth[1])]
        return {**found, **_interpolation(field, rays, plan, retrace, truth), "resampling": lacks}
    return {**found, **_against_source(field, rays, plan, retrace, truth)}


def _tight(field: IndexField, plan: TracePlan) -> TracePlan:
    """Return the plan of the trace that serves as the truth in this field."""
    return replace(
        plan,
        method="adaptive",
        sample_count=0,
        step=None,
        backend="warp" if plan.backend == "reference" and field.interpolation != "cells" else plan.backend,
        precision="float64",
        tolerance=TIGHTER.get(field.interpolation, TIGHTER_ELSEWHERE) * min(plan.tolerance, TIGHTEST_ASKED),
        max_steps=max(plan.max_steps, step_allowance(field, "adaptive", None, None)),
    )


def _interpolation(field: IndexField, rays: RayBundle, plan: TracePlan, retrace: Retrace, truth) -> dict:
    """Estimate the field's interpolation error from its coarser versions; `truth` is the trace through the field.

    Differences between the versions may vanish by chance. The terms that the interpolant omits do not depend on them,
    but do not show what is finer than a cell.
    """
    levels = field.refinement
    if levels is None:
        return {"interpolation": np.zeros(0), "omitted": np.zeros((2, 0))}
    traces = [truth if levels.fine is field else retrace(levels.fine, rays, _tight(levels.fine, plan))]
    traces += [
        retrace(level, rays, _tight(level, plan)) for level in (levels.coarse, levels.coarser) if level is not None
    ]
    good = np.logical_and.reduce([reached(status) for _, status, _ in traces])
    opd = [path[good] for path, _, _ in traces]
    arrived = np.flatnonzero(reached(truth[1]))
    omitted = grid_error(field, rays.rows(arrived), retrace.until) if len(arrived) else np.zeros((2, 0))
    if not good.any():
        return {"interpolation": np.asarray(opd[0]), "omitted": omitted}
    by_levels = levels.richardson_error(opd[0], opd[1], opd[2] if len(opd) > 2 else None)
    return {"interpolation": np.asarray(by_levels), "omitted": omitted}


def _against_source(field: IndexField, rays: RayBundle, plan: TracePlan, retrace: Retrace, truth) -> dict:
    """Return the change against the field that was resampled, and that field's own interpolation error."""
    source = field.source
    parts = [{"interpolation": np.zeros(0), "omitted": np.zeros((2, 0)), "resampling": np.zeros(0)}]
    if source is None:
        return parts[0]
    for rows, until in _common_stops(field, rays, retrace.until):
        again = retrace if until is retrace.until else replace(retrace, until=until)
        some = rays[rows]
        here = tuple(array[rows] for array in truth) if again is retrace else again(field, some, _tight(field, plan))
        there = again(source, some, _tight(source, plan))
        arrived = reached(here[1]) & reached(there[1])
        missing = lost(field, some, again.until, tolerance=0.0)  # a cause of its own
        change = (here[0] + missing - there[0] - deficit_integrals(source, some, again.until))[arrived]
        parts.append({**_interpolation(source, some, plan, again, there), "resampling": change})
    return {name: np.concatenate([part[name] for part in parts], axis=-1) for name in parts[0]}


def _common_stops(field: IndexField, rays: RayBundle, until) -> list[tuple[np.ndarray, object]]:
    """Rows of the rays, and the stops at which two fields of different boxes can be compared.

    Without a stop rays end on the faces of the box. The other field does not have these faces, so the rays are compared
    on the planes of the faces. Of the rays that leave through a curved side only some are compared.
    """
    if until is not None:
        return [(np.arange(rays.ray_count), until)]
    span = box_span(field, rays.position, rays.direction)
    face = np.where(span.meets, span.exit_face, -1)
    end = rays.position + np.where(span.meets, span.leave, 0.0)[:, None] * rays.direction
    stops: list[tuple[np.ndarray, object]] = []
    for number in np.unique(face[face >= 0]):
        rows = np.flatnonzero(face == number)
        if number != SIDE:
            stops.append((rows, Plane(end[rows[0]], np.eye(3)[number // 2])))
            continue
        for row in rows[np.linspace(0, len(rows) - 1, min(SIDE_RAYS, len(rows))).round().astype(int)]:
            stops.append((np.array([row]), Plane(end[row], end[row] * [1.0, 1.0, 0.0])))
    return stops


def float64_rounding(field: IndexField, rays: RayBundle) -> float:
    """Rounding of an OPD in float64 [m]: a few roundings of the greatest length, which no better trace can measure."""
    low, high = field.box
    lengths = np.concatenate([low, high, rays.position.ravel()])
    return float(4.0 * np.finfo(np.float64).eps * np.abs(lengths[np.isfinite(lengths)]).max())


def _change(one, other) -> np.ndarray:
    good = reached(one[1]) & reached(other[1])
    return np.asarray(one[0][good] - other[0][good])


def error_budget(
    field: IndexField,
    rays: RayBundle,
    good: np.ndarray,
    plan: TracePlan,
    retrace: Retrace,
    lost: np.ndarray,
    step_error: np.ndarray | None = None,
) -> dict[str, float]:
    """The budget of a trace [m of OPD]: the greatest error of each cause over the rays that arrived.

    `good` says which arrived, `lost` is the OPD that each lacks by cuts [m], both of shape (ray_count,). `step_error`
    is the trace's own estimate of each ray's step error [m], shape (ray_count,), if it was kept.
    """
    if not good.any():
        return dict.fromkeys((*CAUSES, "total"), float("nan"))
    rows = subset(field, rays, good, step_error)
    chosen = rays.rows(rows)
    found = opd_errors(field, chosen, plan, retrace)
    refractivity, omitted = _greatest(found.pop("refractivity")), greatest(found.pop("omitted"))
    causes = {cause: SAFETY * _greatest(array) for cause, array in found.items()}
    causes["interpolation"] = float(np.maximum(causes["interpolation"], SAFETY * omitted))
    causes["resampling"] = float(np.hypot(causes["resampling"], SAFETY * column_error(field)))
    causes["refractivity"] = refractivity
    causes["precision"] += float64_rounding(field, chosen)
    causes["bundle"] = 0.0 if plan.bundle is None else plan.bundle.error
    causes["truncation"] = _greatest(lost[good])
    return combine(causes)


def column_error(field: IndexField) -> float:
    """Root mean square OPD error [m] of lines through a field from resampling the flow's own cells."""
    return 0.0 if field.upstream is None else field.upstream.columns


def combine(causes: dict[str, float]) -> dict[str, float]:
    """All causes, 0 for those that are not given, and the root sum of squares of all but "refractivity"."""
    budget = {**dict.fromkeys(CAUSES, 0.0), **causes}
    budget["total"] = float(np.sqrt(sum(v * v for cause, v in budget.items() if cause != "refractivity")))
    return budget


def _greatest(array: np.ndarray) -> float:
    return float(np.abs(array).max()) if len(array) else float("nan")
