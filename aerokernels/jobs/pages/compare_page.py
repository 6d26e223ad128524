"""The report of a comparison of recorded echoes with runs: waveforms, residuals, and every number by label."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from aerokernels.display.canvas import SHADES
from aerokernels.display.figures import Axis, Line, Lines
from aerokernels.display.quantities import Quantity
from aerokernels.jobs.pages.page import Answer, Page, Panel
from aerokernels.jobs.recorded import label_text

if TYPE_CHECKING:
    from aerokernels.jobs.comparison import BenchComparison, LabelComparison

Table = tuple[str, Sequence[str], Sequence[Sequence[str]]]
MOST_LABELS = 12  # most labels whose waveforms are drawn
# Waveforms are shown where the pulse is above SHOWN_ABOVE of its peak, plus SHOWN_MARGIN of that width on each side.
SHOWN_ABOVE, SHOWN_MARGIN = 0.01, 0.4


def compare_page(found: "BenchComparison", tables: Sequence[Table], notes: Sequence[str]) -> Page:
    """Return the report of a comparison.

    Args:
        found: The comparison.
        tables: Its tables: caption, columns and rows of texts.
        notes: How the comparison was made, in sentences.
    """
    labels = found.labels
    panels: list[Panel] = []
    for number, one in enumerate(labels[:MOST_LABELS]):
        panels += [_waveforms(number, one), _residual(number, one)]
    panels += [_peaks(labels), _correlations(labels)]
    if any(one.ranges for one in labels):
        panels.append(_ranges(labels))
    runs = [(label_text(one.label), one.run.name, str(one.run.path)) for one in labels]
    return Page(
        "comparison",
        "Recorded against simulated",
        [
            ("Recording", str(found.source)),
            ("Labels", ", ".join(label_text(one.label) for one in labels)),
            ("Echoes", f"{sum(one.recorded.count for one in labels):,}"),
            ("Trigger offset", found.options.align),
        ],
        _answers(labels),
        panels,
        tables=[*tables, ("Runs", ("label", "scene", "folder"), runs)],
        remarks=[("Warning", text) for text in found.warnings],
        details=[("How the comparison was made", [note for note in notes if not note.startswith("Warning")])],
        words=("echo", "correlation", "range", "error"),
    )


def _answers(labels: "Sequence[LabelComparison]") -> list[Answer]:
    """Return the worst of all labels, in peak, shape and range."""
    peak = max(labels, key=lambda one: abs(one.waveform.peak_error))
    wave = peak.waveform
    error = 100.0 * math.hypot(
        peak.covering * peak.errors.peak / wave.recorded_peak,
        peak.run.error_of("echo_peak_v") / wave.simulated_peak,
    )
    of = f" Label {label_text(peak.label)}." if len(labels) > 1 else ""
    side = "above" if wave.peak_error > 0.0 else "below"
    answers = [
        Answer.of(
            "The recorded peak is",
            Quantity(100.0 * abs(wave.peak_error), error, "%"),
            f"{side} the simulated one.",
            f"{wave.recorded_peak:.4g} V recorded, {wave.simulated_peak:.4g} V simulated.{of}",
            "The peaks differ by at most",
        )
    ]
    shape = min(labels, key=lambda one: one.waveform.correlation)
    of = f" Label {label_text(shape.label)}." if len(labels) > 1 else ""
    text = f"{shape.waveform.correlation:.4f}".replace("-", "−")
    answers.append(Answer("The shapes correlate with r =", text, "", "", f"({shape.waveform.degree}).", of.strip()))
    ranged = [(one, method, errors) for one in labels for method, errors in one.ranges.items()]
    if ranged:
        one, method, errors = min(ranged, key=lambda each: each[2].random_error_m)
        spread = Quantity(1e3 * errors.random_error_m, math.nan, "mm")
        more = f"By {method}, the least of {len(one.ranges)} methods; label {label_text(one.label)}."
        answers.append(Answer("Ranges of single echoes spread by", f"{spread.value:.3g}", "", "mm", "rms.", more))
    return answers


def _span(one: "LabelComparison") -> tuple[float, float]:
    """Return the times [ns] between which a label's waveforms are shown."""
    time = 1e9 * one.recorded.time
    high = np.flatnonzero(np.maximum(one.recorded.mean, one.simulated) > SHOWN_ABOVE * one.simulated.max())
    margin = SHOWN_MARGIN * float(time[high[-1]] - time[high[0]])
    return max(float(time[0]), float(time[high[0]]) - margin), min(float(time[-1]), float(time[high[-1]]) + margin)


def _waveforms(number: int, one: "LabelComparison") -> Panel:
    wave, name, time = one.waveform, label_text(one.label), 1e9 * one.recorded.time
    lines = [
        Line(time, one.recorded.mean, "recorded, mean", "one", one.recorded.standard_error),
        Line(time, one.simulated, "simulated", "two"),
    ]
    limits = [("y", wave.edge_level, f"edge at {wave.edge_level:.3g} V")]
    shown = Lines(
        Axis("time since the pulse left [ns]", _span(one), "ns"), Axis("voltage [V]", unit="V"), lines, limits=limits
    )
    says = f"r = {wave.correlation:.4f}, peak {100.0 * wave.peak_error:+.2f} %, {one.recorded.count} echoes."
    return Panel(
        f"waveform-{number}",
        f"{name}: waveforms",
        says.replace("-", "−"),
        f"Recorded and simulated echo of {name}.",
        shown,
    )


def _residual(number: int, one: "LabelComparison") -> Panel:
    time, rest = 1e9 * one.recorded.time, 1e3 * (one.recorded.mean - one.simulated)
    bias = 1e3 * one.covering * np.nan_to_num(one.recorded.standard_error)
    lines = [
        Line(time, rest, "spread of one echo", "plain", 1e3 * np.nan_to_num(one.recorded.spread)),
        Line(time, rest, "difference, with the mean's error", "one", bias),
    ]
    shown = Lines(
        Axis("time since the pulse left [ns]", _span(one), "ns"),
        Axis("recorded minus simulated [mV]", unit="mV"),
        lines,
        limits=[("y", 0.0, "")],
    )
    name = label_text(one.label)
    return Panel(
        f"residual-{number}",
        f"{name}: difference",
        "Dark: error of the mean. Light: spread of one echo.",
        f"Difference of the recorded mean and the simulated echo of {name}.",
        shown,
    )


def _names(labels: "Sequence[LabelComparison]") -> Axis:
    return Axis("", names=[label_text(one.label) for one in labels])


def _peaks(labels: "Sequence[LabelComparison]") -> Panel:
    place = np.arange(len(labels), dtype=float)
    recorded = [one.waveform.recorded_peak for one in labels]
    simulated = [one.waveform.simulated_peak for one in labels]
    errors = [one.covering * one.errors.peak for one in labels]
    errors_of_runs = [abs(one.run.error_of("echo_peak_v")) for one in labels]
    lines = [
        Line(place - 0.06, recorded, "recorded", "one", errors, dots=True),
        Line(place + 0.06, simulated, "simulated", "twosolid", errors_of_runs, dots=True),
    ]
    says = "Peak voltages of the mean echo and of the simulated one, with their errors."
    return Panel(
        "peaks", "Peaks", says, "Peak voltages by label.", Lines(_names(labels), Axis("peak [V]", unit="V"), lines)
    )


def _correlations(labels: "Sequence[LabelComparison]") -> Panel:
    place = np.arange(len(labels), dtype=float)
    lines = [
        Line(place - 0.06, [one.waveform.correlation for one in labels], "at zero lag", "one", dots=True),
        Line(place + 0.06, [one.waveform.best_correlation for one in labels], "greatest", "twosolid", dots=True),
    ]
    lowest = min(one.waveform.correlation for one in labels)
    y = Axis("r", (min(0.95, lowest - 0.1 * (1.0 - lowest)), 1.005 + 0.05 * (1.0 - lowest)))
    says = "Pearson's r of the recorded mean and the simulation."
    return Panel("correlation", "Correlation", says, "Correlation by label.", Lines(_names(labels), y, lines))


def _ranges(labels: "Sequence[LabelComparison]") -> Panel:
    methods = list(dict.fromkeys(method for one in labels for method in one.ranges))
    steps = np.linspace(0, len(SHADES) - 1, len(methods)).round().astype(int)
    lines = []
    for k, (method, step) in enumerate(zip(methods, steps, strict=True)):
        there = [number for number, one in enumerate(labels) if method in one.ranges]
        read = [labels[number].ranges[method] for number in there]
        lines.append(
            Line(
                np.array(there) + 0.16 * (k - 0.5 * (len(methods) - 1)),
                [1e3 * one.systematic_error_m for one in read],
                method.replace("-", " "),
                f"c{step}",
                [1e3 * one.random_error_m for one in read],
                dots=True,
            )
        )
    says = "Mean of the ranges read minus the true one; bars are the spread of one echo."
    y = Axis("range error [mm]", unit="mm")
    shown = Lines(_names(labels), y, lines, limits=[("y", 0.0, "")], pick=True)
    return Panel("ranges", "Range errors", says, "Range errors by label and method.", shown)
