"""Figures of the comparison of recorded with simulated echoes."""

import math
from typing import TYPE_CHECKING

import numpy as np

from aerokernels.jobs.comparison import BenchComparison, LabelComparison
from aerokernels.jobs.figure_layout import styled_figure
from aerokernels.jobs.plots import ACCENT, MUTED, RAY_COLOUR
from aerokernels.jobs.recorded import label_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PANELS = 12
# The figure shows the pulse where it is above SHOWN_ABOVE of its peak, plus SHOWN_MARGIN of that width on each side.
SHOWN_ABOVE, SHOWN_MARGIN = 0.01, 0.4
LOWEST_SHOWN = 0.95  # the axis of r starts at this or lower, so that nearly equal correlations look nearly equal


def waveforms_figure(found: BenchComparison) -> "Figure":
    """Draw recorded mean and simulation of the first twelve labels, and below each their difference."""
    shown = found.labels[:MOST_PANELS]
    columns = min(2, len(shown))
    rows = math.ceil(len(shown) / columns)
    with styled_figure(5.4 * columns, 4.2 * rows) as figure:
        ratios = (3.0, 1.2) * rows
        panels = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=ratios)
        for number in range(rows * columns):
            pair = panels[2 * (number // columns) : 2 * (number // columns) + 2, number % columns]
            if number < len(shown):
                _draw_waveforms(pair[0], shown[number])
                _draw_residual(pair[1], shown[number])
                pair[1].set_xlim(pair[0].get_xlim())
            else:
                pair[0].set_visible(False)
                pair[1].set_visible(False)
        panels[0, 0].legend(loc="upper right", fontsize=9)
    return figure


def _draw_waveforms(axes: "Axes", one: LabelComparison) -> None:
    time = 1e9 * one.time
    axes.plot(time, one.mean, color=RAY_COLOUR, linewidth=1.6, label="recorded, mean")
    axes.plot(time, one.simulated, color=ACCENT, linewidth=1.3, linestyle="--", label="simulated")
    axes.axhline(one.waveform.edge_level, color=MUTED, linewidth=0.8, linestyle=":")
    high = np.flatnonzero(np.maximum(one.mean, one.simulated) > SHOWN_ABOVE * one.simulated.max())
    margin = SHOWN_MARGIN * (time[high[-1]] - time[high[0]])
    axes.set_xlim(max(time[0], time[high[0]] - margin), min(time[-1], time[high[-1]] + margin))
    wave = one.waveform
    axes.set_title(f"{label_text(one.label)}: r = {wave.correlation:.4f}, peak {100 * wave.peak_error:+.2f} %")
    axes.set_ylabel("voltage [V]")
    axes.tick_params(labelbottom=False)
    axes.grid(True, color="#e3e7eb")


def _draw_residual(axes: "Axes", one: LabelComparison) -> None:
    time, rest = 1e9 * one.time, 1e3 * (one.mean - one.simulated)
    spread, error = 1e3 * one.spread, 1e3 * one.standard_error
    axes.fill_between(time, rest - spread, rest + spread, color=RAY_COLOUR, alpha=0.15, linewidth=0.0)
    axes.fill_between(time, rest - error, rest + error, color=RAY_COLOUR, alpha=0.5, linewidth=0.0)
    axes.plot(time, rest, color=RAY_COLOUR, linewidth=0.8)
    axes.axhline(0.0, color=ACCENT, linewidth=1.0, linestyle="--")
    axes.set(xlabel="time after the pulse's peak left [ns]", ylabel="difference [mV]")
    axes.grid(True, color="#e3e7eb")


def ranges_figure(found: BenchComparison) -> "Figure":
    """Draw peaks, correlation and range errors over the labels."""
    names = [label_text(one.label) for one in found.labels]
    place, waves = np.arange(len(names)), [one.waveform for one in found.labels]
    with styled_figure(10.6, 3.8) as figure:
        peaks, correlation, ranges = figure.subplots(1, 3)
        recorded, simulated = ([getattr(wave, f"{kind}_peak") for wave in waves] for kind in ("recorded", "simulated"))
        errors = [one.covering * one.peak_standard_error for one in found.labels]
        peaks.errorbar(place, recorded, yerr=errors, fmt="o", color=RAY_COLOUR, label="recorded")
        errors = [abs(one.run.error_of("echo_peak_v")) for one in found.labels]
        errors = [error if math.isfinite(error) else 0.0 for error in errors]
        peaks.errorbar(place, simulated, yerr=errors, fmt="s", color=ACCENT, mfc="none", label="simulated")
        peaks.set(title="Peak", ylabel="peak voltage [V]")
        peaks.legend(fontsize=9)
        for key, words, mark in (("correlation", "at zero lag", "o"), ("best_correlation", "greatest", "^")):
            correlation.plot(place, [getattr(wave, key) for wave in waves], mark, mfc="none", label=words)
        correlation.set(title="Correlation", ylabel="r")
        lowest = min(wave.correlation for wave in waves)
        correlation.set_ylim(min(LOWEST_SHOWN, lowest - 0.1 * (1.0 - lowest)), 1.005 + 0.05 * (1.0 - lowest))
        correlation.legend(fontsize=9)
        methods = list(dict.fromkeys(method for one in found.labels for method in one.ranges))
        for k, method in enumerate(methods):
            present = [number for number, one in enumerate(found.labels) if method in one.ranges]
            read = [found.labels[number].ranges[method] for number in present]
            ranges.errorbar(
                place[present] + 0.16 * (k - 0.5 * (len(methods) - 1)),
                [1e3 * one.systematic_error_m for one in read],
                yerr=[1e3 * one.random_error_m for one in read],
                fmt="o",
                markersize=4,
                capsize=2,
                label=method,
            )
        ranges.axhline(0.0, color=MUTED, linewidth=0.8)
        ranges.set(title="Range errors", ylabel="range error [mm]")
        low, high = ranges.get_ylim()
        ranges.set_ylim(low, high + 0.3 * (high - low))  # room for the legend
        ranges.legend(fontsize=8, ncols=2, loc="upper center")
        for axes in (peaks, correlation, ranges):
            axes.set_xticks(place, names, rotation=0 if len(names) <= 4 else 45)
            axes.set_xlim(-0.5, len(names) - 0.5)
            axes.grid(True, color="#e3e7eb")
    return figure
