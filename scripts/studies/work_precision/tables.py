"""Tables of work-precision runs."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..report import markdown_table
from .runs import Error, Run

TARGETS = (1e-2, 1e-3, 1e-4)  # [waves]
TIGHTER = (1e-5, 1e-6, 1e-7, 1e-8)  # [waves]
PRECISIONS = ("float64", "float32")
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


def need_table(
    runs: list[Run], amount: Callable[[Run], float], error: str, targets=TARGETS, precisions=PRECISIONS
) -> str:
    """The amount for each target with error control and with the best fixed step, cubic interpolant."""
    heading = ["field", "precision"]
    for target in targets:
        heading += [f"adaptive, {target:.0e}", f"fixed, {target:.0e}", "ratio"]
    rows = []
    for case in names(runs):
        for precision in precisions:
            some = select(runs, case=case, precision=precision, interpolation="cubic")
            if not some:
                continue
            row = [case, precision]
            for target in targets:
                adaptive, fixed = (
                    need([amount(r) for r in chosen], [getattr(r.tracing, error) for r in chosen], target)
                    if (chosen := of_method(some, method))
                    else None
                    for method in ("adaptive", "fixed")
                )
                row += [str(adaptive or "–"), str(fixed or "–"), ratio(fixed, adaptive)]
            rows.append(row)
    return markdown_table(heading, rows, text_columns=2)


def default_table(runs: list[Run]) -> str:
    """The default call, "auto" at 1e-3 waves in float32: its choice, its cost, and its reported and actual errors."""
    heading = ["field", "interpolant", "chosen", "evaluations", "µs per ray", "tracing error, rms"]
    heading += ["tracing error, max", "total error, rms", "total error, max", "reported, total"]
    rows = [
        [
            run.case,
            run.interpolation,
            run.chosen,
            f"{run.evaluations:.0f}",
            f"{run.microseconds()[0]:.2g}",
            *(short(value) for value in (run.tracing.opd_rms, run.tracing.opd_max)),
            *(short(value) for value in (run.total.opd_rms, run.total.opd_max, run.reported_total)),
        ]
        for run in of_method(select(runs, precision="float32"), "auto")
        if run.setting.value == DEFAULT_TOLERANCE
    ]
    return markdown_table(heading, rows, text_columns=3)


def report_table(runs: list[Run]) -> str:
    """Compare reported with actual errors over all runs of a method."""
    heading = ["method", "interpolant", "runs", "step error covers tracing error, max"]
    heading += ["median of their ratio", "budget covers total error, rms", "total error, max", "median ratio to rms"]
    rows = []
    for method in dict.fromkeys(run.setting.method for run in runs):
        for interpolation in dict.fromkeys(run.interpolation for run in runs):
            some = of_method(select(runs, interpolation=interpolation), method)
            step = ratios([(run.reported_step, run.tracing.opd_max) for run in some])
            known = [run for run in some if np.isfinite(run.total.opd_rms)]
            budget = ratios([(run.reported_total, run.total.opd_rms) for run in known])
            greatest = ratios([(run.reported_total, run.total.opd_max) for run in known])
            row = [method, interpolation, str(len(some)), covered(step), middle(step)]
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


def floor_table(runs: list[Run]) -> str:
    """The least errors that any setting reached: the errors of the samples and of the precision."""
    heading = ["field", "interpolant", "total OPD error, float64", "total OPD error, float32"]
    heading += ["total direction error, float64 [µrad]", "tracing OPD error, float32"]
    rows = []
    for case in names(runs):
        for interpolation in dict.fromkeys(run.interpolation for run in runs):
            row = [case, interpolation]
            for precision, kind, error in (
                ("float64", "total", "opd_rms"),
                ("float32", "total", "opd_rms"),
                ("float64", "total", "direction_rms"),
                ("float32", "tracing", "opd_rms"),
            ):
                some = select(runs, case=case, interpolation=interpolation, precision=precision)
                values = [
                    getattr(getattr(run, kind), error)
                    for method in ("adaptive", "fixed")
                    for run in of_method(some, method)
                ]
                row.append(short(min(values, default=np.nan)))
            rows.append(row)
    return markdown_table(heading, rows, text_columns=2)


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
    ]
    return markdown_table(heading, rows, text_columns=2)


def short(number: float) -> str:
    """Format a number with its power of ten, or a dash for NaN."""
    return "–" if np.isnan(number) else f"{number:.1e}"
