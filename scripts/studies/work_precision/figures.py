"""Figures of work-precision runs: error against evaluations, and against time, one of each for a field."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..report import saved_figure
from .runs import INTERPOLATIONS, TIGHT_TOLERANCE, Run
from .tables import of_method, select

# Okabe and Ito's colours, which can be told apart with colour blindness; markers and lines distinguish the curves too.
METHODS: dict[str, dict[str, Any]] = {
    "adaptive": {"color": "#0072B2", "marker": "o"},
    "fixed": {"color": "#D55E00", "marker": "s"},
    "straight": {"color": "#009E73", "marker": "^"},
    "paper": {"color": "#CC79A7", "marker": "D", "linestyle": "none"},
    "auto": {"color": "#000000", "marker": "*", "markersize": 11, "linestyle": "none"},
}
INTERPOLANTS: dict[str, dict[str, Any]] = {
    "cubic": {"color": "#0072B2", "marker": "o"},
    "linear": {"color": "#E69F00", "marker": "v"},
    "monotone": {"color": "#CC79A7", "marker": "P"},
}
LEAST, MOST = 1e-12, 30.0  # [waves]; errors are clipped to this range
SHOWN_AUTO = 1e-3  # tolerance [waves] at which "auto" is shown
Amount = Callable[[Run], tuple[float, float, float]]


def evaluations(run: Run) -> tuple[float, float, float]:
    """Evaluations per ray, which have no spread."""
    return (run.evaluations,) * 3


def draw_curve(axes, runs: list[Run], amount: Amount, error: Callable[[Run], float], **look: Any) -> None:
    """Draw one curve, with the spread of the amount as a bar."""
    if not runs:
        return
    middle, low, high = np.array([amount(run) for run in runs]).T
    height = np.clip([error(run) for run in runs], LEAST, MOST)
    axes.errorbar(middle, height, xerr=[middle - low, high - middle], elinewidth=0.8, linewidth=1.5, **look)


def is_coarse(run: Run) -> bool:
    """Whether the trace that defines tracing errors is tighter than the run; otherwise they are the same trace."""
    asked = run.setting.value
    return run.setting.method == "fixed" or (asked is not None and asked > TIGHT_TOLERANCE[run.interpolation])


def draw(runs: list[Run], title: str, label: str, amount: Amount, path: Path) -> None:
    """Draw methods on the cubic interpolant, tracing error (left), and interpolants, total error if known (right).

    Args:
        runs: All runs of one field.
        title: Title of the figure.
        label: Label of the horizontal axis.
        amount: Returns the amount that a run took: median, least and greatest.
        path: The file to write.
    """
    from matplotlib.ticker import LogLocator

    known = any(np.isfinite(run.total.opd_rms) for run in runs)
    kind = "total" if known else "tracing"
    with saved_figure(path, 12.0, 5.6, dpi=110) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        for method, look in METHODS.items():
            for precision, more in (
                ("float64", {}),
                ("float32", {"markerfacecolor": "white", **({} if "linestyle" in look else {"linestyle": "--"})}),
            ):
                some = of_method(select(runs, precision=precision, interpolation="cubic"), method)
                if method == "auto":
                    some = [run for run in some if run.setting.value == SHOWN_AUTO]
                words = f"{method} at {SHOWN_AUTO:g} waves" if method == "auto" else method
                style = {"markersize": 5, "label": f"{words}, {precision}", **look, **more}
                draw_curve(left, some, amount, lambda run: run.tracing.opd_rms, **style)
        for interpolation in INTERPOLATIONS:
            look = INTERPOLANTS[interpolation]
            for method, more in (("adaptive", {}), ("fixed", {"linestyle": ":", "markerfacecolor": "white"})):
                some = of_method(select(runs, precision="float64", interpolation=interpolation), method)
                if not known:
                    some = [run for run in some if is_coarse(run)]
                style = {"markersize": 5, "label": f"{interpolation}, {method}", **look, **more}
                draw_curve(right, some, amount, lambda run: getattr(run, kind).opd_rms, **style)
        for axes in (left, right):
            axes.set(xscale="log", yscale="log", xlabel=label)
            axes.xaxis.set_major_formatter("{x:g}")
            lowest, highest = axes.get_xlim()
            if highest < 1000.0 * lowest:  # otherwise the labels would overlap
                axes.xaxis.set_minor_locator(LogLocator(subs=(2, 5)))
                axes.xaxis.set_minor_formatter("{x:g}")
            axes.tick_params(labelleft=True)
            axes.legend(fontsize=8, loc="best")
        left.set(ylabel="tracing error of OPD, rms [waves at 905 nm]", title="Methods, cubic interpolant")
        right.set(
            ylabel=f"{kind} error of OPD, rms [waves at 905 nm]",
            title="Interpolants, float64" + ("" if known else " (the true field is not known)"),
        )
        figure.suptitle(title)
