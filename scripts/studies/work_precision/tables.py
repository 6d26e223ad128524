"""Tables of work-precision runs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..report import markdown_table
from .runs import Error, Run

TARGETS = (1e-3, 1e-5, 1e-7)  # [waves]
DEFAULT_TOLERANCE = 1e-3  # [waves]


@dataclass(frozen=True)
class Need:
    """The amount needed for a target; a bound where even the coarsest setting is better than the target."""

    amount: float
    is_bound: bool = False

    def __str__(self) -> str:
        """Format the amount for tables."""
        number = f"{self.amount:.0f}" if self.amount >= 10.0 else f"{self.amount:.2g}"
        return f"≤ {number}" if self.is_bound else number


def need(amount: Sequence[float], error: Sequence[float], target: float) -> Need | None:
    """The amount at which the error first falls to a target, by straight lines in the log-log plot.

    Args:
        amount: Evaluations or seconds of some settings.
        error: Their errors.
        target: The target error.

    Returns:
        The amount, or None if no setting reaches the target.
    """
    order = np.argsort(amount)
    x, y = np.log(np.asarray(amount)[order]), np.log(np.maximum(np.asarray(error)[order], 1e-300))
    wanted = np.log(target)
    good = np.flatnonzero(y <= wanted)
    if not len(good):
        return None
    k = int(good[0])
    if k == 0:
        return Need(float(np.exp(x[0])), True)
    share = (y[k - 1] - wanted) / (y[k - 1] - y[k])
    return Need(float(np.exp(x[k - 1] + share * (x[k] - x[k - 1]))))


def ratio(fixed: Need | None, adaptive: Need | None) -> str:
    """How many times more the fixed step needs; a bound if one of the two is one, a dash if that is not meaningful."""
    if fixed is None or adaptive is None or (fixed.is_bound and adaptive.is_bound):
        return "–"
    sign = "≥ " if adaptive.is_bound else "≤ " if fixed.is_bound else ""
    return f"{sign}{fixed.amount / adaptive.amount:.2g}"


def of_method(runs: Iterable[Run], method: str) -> list[Run]:
    """The runs of a method, by the caller's request."""
    return [run for run in runs if run.setting.method == method]


def select(runs: Iterable[Run], **wanted: str) -> list[Run]:
    """The runs whose attributes have these values."""
    return [run for run in runs if all(getattr(run, name) == value for name, value in wanted.items())]


def names(runs: Iterable[Run]) -> list[str]:
    """The cases that occur, in order."""
    return list(dict.fromkeys(run.case for run in runs))


def need_table(runs: list[Run]) -> str:
    """Evaluations for each rms error with error control and with the best fixed step, float64, cubic interpolant."""
    heading = ["field"]
    for target in TARGETS:
        heading += [f"adaptive, {target:.0e}", f"fixed, {target:.0e}", "ratio"]
    rows = []
    for case in names(runs):
        some = select(runs, case=case, precision="float64", interpolation="cubic")
        row = [case]
        for target in TARGETS:
            adaptive, fixed = (
                need([r.evaluations for r in chosen], [r.tracing.opd_rms for r in chosen], target)
                if (chosen := of_method(some, method))
                else None
                for method in ("adaptive", "fixed")
            )
            row += [str(adaptive or "–"), str(fixed or "–"), ratio(fixed, adaptive)]
        rows.append(row)
    return markdown_table(heading, rows)


def default_table(runs: list[Run]) -> str:
    """The default call, "auto" at 1e-3 waves in float32: its cost, and its reported and actual errors."""
    heading = ["field", "interpolant", "evaluations", "µs per ray", "tracing error, rms"]
    heading += ["total error, rms", "reported, total"]
    rows = [
        [
            run.case,
            run.interpolation,
            f"{run.evaluations:.0f}",
            f"{run.microseconds()[0]:.2g}",
            *(short(value) for value in (run.tracing.opd_rms, run.total.opd_rms, run.reported_total)),
        ]
        for run in of_method(select(runs, precision="float32"), "auto")
        if run.setting.value == DEFAULT_TOLERANCE
    ]
    return markdown_table(heading, rows, text_columns=2)


def report_table(runs: list[Run]) -> str:
    """Compare reported with actual errors over all runs of a method; "adaptive" is what "auto" takes."""
    heading = ["method", "interpolant", "runs", "step error covers tracing error, max"]
    heading += ["budget covers total error, rms", "total error, max", "median ratio to rms"]
    rows = []
    for method in dict.fromkeys(run.setting.method for run in runs if run.setting.method != "adaptive"):
        for interpolation in dict.fromkeys(run.interpolation for run in runs):
            some = of_method(select(runs, interpolation=interpolation), method)
            step = ratios([(run.reported_step, run.tracing.opd_max) for run in some])
            known = [run for run in some if np.isfinite(run.total.opd_rms)]
            budget = ratios([(run.reported_total, run.total.opd_rms) for run in known])
            greatest = ratios([(run.reported_total, run.total.opd_max) for run in known])
            row = [method, interpolation, str(len(some)), covered(step)]
            rows.append([*row, covered(budget), covered(greatest), middle(budget)])
    return markdown_table(heading, rows, text_columns=2)


def ratios(pairs: list[tuple[float, float]]) -> np.ndarray:
    """Reported over actual error; an error of exactly 0 is covered by any reported error."""
    return np.array([reported / made if made > 0.0 else np.inf for reported, made in pairs])


def covered(ratios: np.ndarray) -> str:
    """The share of ratios of reported to actual error that are at least 1."""
    return f"{np.mean(ratios >= 1.0):.0%}" if len(ratios) else "–"


def middle(ratios: np.ndarray) -> str:
    """The median."""
    return f"{np.median(ratios):.2g}" if len(ratios) else "–"


def check_table(checks: dict[tuple[str, str], tuple[Error, Error]]) -> str:
    """The deviations that confirm the tight traces."""
    heading = ["field", "interpolant", "fixed step of 1/64 cell, max", "SciPy on the interpolant, max"]
    rows = [[*key, short(fine.opd_max), short(scipy.opd_max)] for key, (fine, scipy) in checks.items()]
    return markdown_table(heading, rows, text_columns=2)


def peer_table(runs: list[Run]) -> str:
    """Greatest total errors through gridded fields beside the best published elsewhere."""
    heading = ["field", "traced by", "evaluations", "OPD error [waves]", "direction error [µrad]"]
    rows = [["radial gradient, analytic", "diffrax (others' best)", "–", "1.8e-04", "0.022"]]
    rows += [
        [
            run.case,
            f"aerokernels, {run.precision}, tolerance {run.setting.value:.0e}",
            f"{run.evaluations:.0f}",
            short(run.total.opd_max),
            f"{run.total.direction_max:.2g}",
        ]
        for run in runs
        if run.setting.value == DEFAULT_TOLERANCE
    ]
    return markdown_table(heading, rows, text_columns=2)


def short(number: float) -> str:
    """Format a number with its power of ten, or a dash for NaN."""
    return "–" if np.isnan(number) else f"{number:.1e}"
