"""Write a comparison of recorded echoes with runs as files: table, waveforms, figures and an HTML report."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aerokernels import __version__
from aerokernels.compare import DEGREES
from aerokernels.display.canvas import png, styled_figure
from aerokernels.display.figures import Lines
from aerokernels.display.quantities import Quantity, two_digits
from aerokernels.hardware.export import csv_cell
from aerokernels.jobs.comparison import EACH, NO_ALIGNMENT, BenchComparison, LabelComparison
from aerokernels.jobs.echo_statistics import TOLD, covering, spread_factor
from aerokernels.jobs.pages.compare_page import compare_page
from aerokernels.jobs.pages.page import Page
from aerokernels.jobs.recorded import LEAST_SAMPLES, label_text
from aerokernels.jobs.store import REPORT_FILE, SUMMARY_FILE, staged_folder, to_json, write_result, write_summary
from aerokernels.lidar.pulses import SPEED_OF_LIGHT

TABLE_FILE, WAVEFORM_FILE, FIGURE_FILE = "compare.csv", "compare.nc", "compare.png"

# Ranging methods that read the time of a pulse's edge, which depends on the pulse's shape.
EDGE_METHODS = ("leading-edge", "constant-fraction")

Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]


def peak_table(result: BenchComparison) -> Table:
    """Make Table 3 of the paper: peak voltages."""
    rows: list[tuple[str, ...]] = [
        (
            label_text(one.label),
            str(one.recorded.count),
            str(Quantity(one.waveform.recorded_peak, one.covering * one.errors.peak)),
            f"{one.recorded.peak_mean:.4g}, spread {two_digits(one.recorded.peak_spread)}",
            str(Quantity(one.waveform.simulated_peak, one.run.error_of("echo_peak_v"))),
        )
        for one in result.labels
    ]
    columns = (
        "label",
        "echoes",
        "recorded peak of the mean [V]",
        "peak of one echo [V]",
        "simulated peak [V]",
    )
    return "Peak voltages (Table 3)", columns, rows


def error_table(result: BenchComparison) -> Table:
    """Make Table 4: relative peak errors, in both conventions, and the leading edge.

    The relative error of the ratio of two peaks is the root sum of squares of the peaks' relative errors.
    """
    rows: list[tuple[str, ...]] = []
    for one in result.labels:
        wave = one.waveform
        share = math.hypot(
            one.covering * one.errors.peak / wave.recorded_peak,
            one.run.error_of("echo_peak_v") / wave.simulated_peak,
        )
        ratio = wave.recorded_peak / wave.simulated_peak
        rows.append(
            (
                label_text(one.label),
                Quantity(100.0 * wave.peak_error, 100.0 * share * ratio, "%").text(signed=True),
                Quantity(100.0 * wave.peak_error_of_recorded, 100.0 * share / ratio, "%").text(signed=True),
                f"{wave.edge_level:.3f} V",
                Quantity(1e12 * wave.edge_shift, 1e12 * one.covering * one.errors.edge_shift).text(signed=True),
                _millimetres(wave.range_difference, 0.5 * SPEED_OF_LIGHT * one.covering * one.errors.edge_shift),
            )
        )
    columns = ("label", "of the simulated peak", "of the recorded peak", "edge at", "edge shift [ps]", "as range [mm]")
    return "Relative peak errors (Table 4) and leading edge", columns, rows


def correlation_table(result: BenchComparison) -> Table:
    """Make Table 6: correlation coefficients, with the degrees of Table 5."""
    rows: list[tuple[str, ...]] = [
        (
            label_text(one.label),
            f"{wave.correlation:.4f}",
            wave.degree + _caveat(one),
            f"{wave.best_correlation:.4f}",
            Quantity(1e12 * wave.lag, 1e12 * one.covering * one.errors.lag).text(signed=True),
            _number(one.echo_correlation, ".4f"),
            f"{_number(1e9 * wave.recorded_width, '.3f')} / {_number(1e9 * wave.simulated_width, '.3f')}",
        )
        for one, wave in ((one, one.waveform) for one in result.labels)
    ]
    columns = (
        "label",
        "r at zero lag",
        "degree",
        "greatest r",
        "its lag [ps]",
        "r of one echo, mean",
        "width recorded / simulated [ns]",
    )
    return "Correlation (Table 6; degrees by Table 5)", columns, rows


def range_table(result: BenchComparison) -> Table:
    """Make the table of systematic and random range errors, by label and method."""
    rows: list[tuple[str, ...]] = [
        (
            label_text(one.label),
            method,
            # The error of the run's range is also in its reading, so it cancels (`range_errors`).
            _millimetres(errors.systematic_error_m, covering(errors.ranged_count) * errors.systematic_standard_error_m)
            + (_caveat(one) if method in EDGE_METHODS else ""),
            str(Quantity(spread := 1e3 * errors.random_error_m, spread * spread_factor(errors.ranged_count, TOLD))),
            _millimetres(errors.simulated_error_m, one.run.error_of("ranges_m", method)),
            f"{errors.ranged_count} of {errors.ranged_count + errors.missed_count}",
        )
        for one in result.labels
        for method, errors in one.ranges.items()
    ]
    columns = ("label", "method", "systematic error [mm]", "random error [mm]", "simulated error [mm]", "echoes ranged")
    return "Range errors", columns, rows


def _caveat(one: LabelComparison) -> str:
    """Return the remark for a number that is distorted because the recorded pulse differs from the simulated one."""
    return " (different pulse)" if one.waveform.same_pulse is False else ""


def _number(value: float, digits: str) -> str:
    """Format a number; "none" for NaN."""
    return f"{value:{digits}}" if math.isfinite(value) else "none"


def _millimetres(value: float, error: float) -> str:
    """Format a signed length [m] with its error [m] in millimetres."""
    return Quantity(1e3 * value, 1e3 * error).text(signed=True)


TABLES = (peak_table, error_table, correlation_table, range_table)


def notes(result: BenchComparison) -> list[str]:
    """Describe in words how the comparison was made."""
    bounds = [bound for bound, _ in DEGREES]
    degrees = "; ".join(
        f"{name} from |r| = {bound:g} to {upper:g}"
        for (bound, name), upper in zip(DEGREES, [1.0, *bounds], strict=False)
    )
    is_measured = result.options.align != NO_ALIGNMENT
    alignment = {
        NO_ALIGNMENT: "The recorded times were used unchanged, apart from the given trigger offset.",
        EACH: "Each label was shifted to its greatest correlation: only shapes are compared, and systematic range "
        "errors and edge shifts are not meaningful.",
    }.get(
        result.options.align,
        f"The trigger offset was measured on {result.options.align} and subtracted for every label: differences "
        "between labels are real, the systematic error of that label is not.",
    )
    lines = [
        *(f"Warning: {text}." for text in result.warnings),
        alignment,
        "Trigger offsets: "
        + ", ".join(
            f"{label_text(one.label)} {Quantity(one.trigger_offset, error, 's').scaled(1e9, 'ns')}"
            for one in result.labels
            for error in [one.covering * one.trigger_offset_error if is_measured else None]
        ),
        f"Degrees of correlation: {degrees}.",
        f"At most {result.options.ranged_count} echoes of a label, chosen at random, were ranged one by one.",
    ]
    if result.options.voltage_offset:
        lines.append(f"{1e3 * result.options.voltage_offset:g} mV were subtracted from all recorded voltages.")
    resampled = sum(one.recorded.resampled_count for one in result.labels)
    if resampled:
        lines.append(f"{resampled} echoes had other sample times than most of their label: interpolated by a spline.")
    unfit = sum(one.unfit_count for one in result.labels)
    if unfit:
        lines.append(f"{unfit} echoes had fewer than {LEAST_SAMPLES} samples or no sample period and were skipped.")
    if result.left_out:
        lines.append(f"Labels without a run: {', '.join(map(label_text, result.left_out))}.")
    return lines


def write_comparison(result: BenchComparison, out: Path) -> list[str]:
    """Write compare.csv, compare.nc, compare.png, summary.json and report.html: all or none; return their names."""
    rows = [one.row() for one in result.labels]
    summary = {
        "recording": str(result.source),
        "align": result.options.align,
        "labels": rows,
        "warnings": result.warnings,
        "left_out": [label_text(label) for label in result.left_out],
        "version": __version__,
    }
    page = compare_page(result, [make(result) for make in TABLES], notes(result))
    report, picture = page.html(), _picture(page)
    with staged_folder(out) as folder:
        _write_csv(folder / TABLE_FILE, rows)
        (folder / FIGURE_FILE).write_bytes(picture)
        write_result(folder / WAVEFORM_FILE, result.to_xarray())
        write_summary(folder / SUMMARY_FILE, summary)
        (folder / REPORT_FILE).write_text(report, encoding="utf-8")
        return sorted(path.name for path in folder.iterdir())


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        for row in rows:
            plain = {name: to_json(value) for name, value in row.items()}
            writer.writerow({name: "" if value is None else csv_cell(value) for name, value in plain.items()})


def _picture(page: Page) -> bytes:
    """Draw a report's waveforms, and beside each its difference, as a PNG file."""
    drawn = [panel for panel in page.panels if panel.name.startswith(("waveform-", "residual-"))]
    with styled_figure(10.8, 1.6 * len(drawn)) as figure:
        for axes, panel in zip(figure.subplots(len(drawn) // 2, 2, squeeze=False).ravel(), drawn, strict=True):
            assert isinstance(panel.shown, Lines)
            panel.shown.draw(axes)
            axes.set_title(panel.title)
        return png(figure)
