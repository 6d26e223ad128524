"""Tables of the paper's printed values beside this package's results, as Markdown and as rows of a CSV."""

from dataclasses import dataclass

import numpy as np

from aerokernels import flow
from aerokernels.compare import DEGREES
from aerokernels.lidar import RANGING_METHODS

from ..report import markdown_table
from .cases import SHOCKS, Case, Shadow, compare_cases, lag_of_correlation
from .printed import FIGURE_1, MACH, SIMULATED, TABLE_2, TABLE_3, TABLE_4, TABLE_6, TOTAL_TEMPERATURE
from .scheme import Steps

HEADING = ["item", "quantity", "density", "mach", "unit", "paper", "ours"]
Cases = dict[str, dict[int, Case]]


@dataclass(frozen=True)
class Table:
    """A table of the page, and its rows in the CSV: item, quantity, density, Mach number, unit, paper, ours."""

    markdown: str
    rows: list[list]


def table_2() -> Table:
    """Test conditions: the density from Mach number, total pressure and total temperature."""
    cells, rows = [], []
    for mach, (pressure, density) in TABLE_2.items():
        stream = flow.tunnel_conditions(mach, pressure, TOTAL_TEMPERATURE)
        shock = flow.normal_shock(float(mach))
        jump = stream.density * (shock.density_ratio - 1.0)
        cells.append(
            [
                str(mach),
                f"{1e-6 * pressure:.2f}",
                f"{density:.2f}",
                f"{stream.density:.4f}",
                f"{100 * (density / stream.density - 1.0):+.1f} %",
                f"{shock.density_ratio:.3f}",
                f"{jump:.3f}",
            ]
        )
        rows.append(["table 2", "free-stream density", "tunnel", mach, "kg/m3", density, stream.density])
        rows.append(["table 2", "density step of a normal shock", "tunnel", mach, "kg/m3", "", jump])
    heading = ["Mach", "P0 [MPa]", "ρ, paper [kg/m³]", "ρ, isentropic [kg/m³]", "paper − ours"]
    heading += ["ratio, normal shock", "step, normal shock [kg/m³]"]
    return Table(markdown_table(heading, cells), rows)


def table_3(cases: Cases) -> Table:
    """Echo peaks, and their drop from the peak without flow."""
    cells, rows = [], []
    for mach in MACH:
        row = [str(mach)]
        for printed, source in ((TABLE_3, "paper, test"), (SIMULATED, "paper, simulated")):
            row.append(f"{printed[mach]:.3f} ({100 * (printed[mach] / printed[0] - 1.0):+.1f} %)")
            rows.append(["table 3", f"echo peak, {source}", "", mach, "V", printed[mach], ""])
        for density, by_mach in cases.items():
            case, still = by_mach[mach].ideal, by_mach[0].ideal
            drop = case.peak_voltage / still.peak_voltage - 1.0
            row += [f"{case.peak_voltage:.3f} ({100 * drop:+.1f} %)", f"{case.mean_strehl:.4f}"]
            rows.append(["table 3", "echo peak", density, mach, "V", TABLE_3[mach], case.peak_voltage])
            rows.append(["table 3", "Strehl ratio of the way back", density, mach, "1", "", case.mean_strehl])
        cells.append(row)
    heading = ["Mach", "paper, test [V]", "paper, simulated [V]", "ours, tunnel [V]", "Strehl ratio"]
    return Table(markdown_table([*heading, "ours, atmospheric [V]", "Strehl ratio"], cells), rows)


def table_4(cases: Cases) -> Table:
    """Relative peak errors (test - simulated) / simulated."""
    cells, rows = [], []
    for mach in MACH:
        thin, dense = (cases[density][mach].ideal.peak_voltage for density in ("tunnel", "atmospheric"))
        errors = {
            "paper's test against ours, tunnel": TABLE_3[mach] / thin - 1.0,
            "paper's test against ours, atmospheric": TABLE_3[mach] / dense - 1.0,
            "ours, tunnel against ours, atmospheric": thin / dense - 1.0,
        }
        cells.append([str(mach), f"{100 * TABLE_4[mach]:.2f} %", *(f"{100 * e:+.2f} %" for e in errors.values())])
        rows += [["table 4", words, "", mach, "1", TABLE_4[mach], error] for words, error in errors.items()]
    heading = ["Mach", "paper", "its test / our tunnel", "its test / our atmospheric", "our tunnel / our atmospheric"]
    return Table(markdown_table(heading, cells), rows)


def table_5() -> Table:
    """Degrees of correlation, as half-open intervals."""
    bounds = [*(bound for bound, _ in DEGREES)]
    tops = ["1.00]", *(f"{bound:.2f})" for bound in bounds[:-1])]
    cells = [[f"[{bound:.2f}, {top}", degree] for (bound, degree), top in zip(DEGREES, tops, strict=True)]
    rows = [["table 5", degree, "", "", "1", bound, bound] for bound, degree in DEGREES]
    return Table(markdown_table(["absolute r", "degree"], cells[::-1], text_columns=2), rows)


def table_6(cases: Cases) -> Table:
    """Correlation coefficients of the recorded echo at tunnel density and the simulated one at atmospheric density."""
    cells, rows = [], []
    for mach in MACH:
        found = compare_cases(cases["tunnel"][mach], cases["atmospheric"][mach])
        lag = lag_of_correlation(cases["tunnel"][mach], TABLE_6[mach])
        cells.append(
            [
                str(mach),
                f"{TABLE_6[mach]:.4f}",
                f"{found.correlation:.4f}",
                f"{1e9 * lag:.1f}",
            ]
        )
        rows.append(["table 6", "correlation at zero lag", "", mach, "1", TABLE_6[mach], found.correlation])
        rows.append(["table 6", "greatest correlation", "", mach, "1", "", found.best_correlation])
        rows.append(["table 6", "lag of the greatest correlation", "", mach, "s", "", found.lag])
        rows.append(["table 6", "misalignment that gives the paper's r", "", mach, "s", "", lag])
    heading = ["Mach", "paper", "ours", "lag that gives the paper's r [ns]"]
    return Table(markdown_table(heading, cells), rows)


def table_ranges(cases: Cases) -> Table:
    """Systematic and random range errors, which the paper mentions but does not print."""
    cells, rows = [], []
    for density, by_mach in cases.items():
        for mach, case in by_mach.items():
            if mach == 0 and density != "tunnel":
                continue  # the same echo
            row = [density if mach else "no flow", str(mach)]
            for method in RANGING_METHODS:
                found = case.recorded.statistics[method]
                row.append(f"{1e3 * found.systematic_error:+.2f} ± {1e3 * found.random_error:.2f}")
                for name in ("systematic_error", "random_error"):
                    words = f"{name.replace('_', ' ')}, {method}"
                    rows.append(["range", words, density, mach, "m", "", getattr(found, name)])
                for name in ("systematic_interval", "random_interval"):
                    low, high = getattr(found, name)
                    rows.append(["range", f"{name.replace('_', ' ')} low, {method}", density, mach, "m", "", low])
                    rows.append(["range", f"{name.replace('_', ' ')} high, {method}", density, mach, "m", "", high])
            bound = case.recorded.statistics[RANGING_METHODS[0]].cramer_rao_bound
            rows.append(["range", "Cramer-Rao bound", density, mach, "m", "", bound])
            cells.append([*row, f"{1e3 * bound:.2f}"])
    heading = ["density", "Mach", *(f"{method} [mm]" for method in RANGING_METHODS), "Cramér-Rao [mm]"]
    return Table(markdown_table(heading, cells), rows)


def table_walk() -> Table:
    """Range walk of a 1 V threshold on the peaks of Table 3, tau 6 ns, and of the other methods."""
    from aerokernels.lidar import GaussianPulse, estimate_range

    pulse, time = GaussianPulse(6e-9), np.arange(-40e-9, 60e-9, 0.5e-9)
    cells, rows = [], []
    for method in RANGING_METHODS:
        template = pulse if method == "matched-filter" else None
        reading = [
            estimate_range(time, TABLE_3[mach] * pulse(time - 10e-9), method, threshold=1.0, template=template)
            for mach in MACH
        ]
        shifts = [value - reading[0] for value in reading[1:]]
        cells.append([method, *(f"{1e3 * shift:+.3f}" for shift in shifts)])
        rows += [["walk", method, "", mach, "m", "", shift] for mach, shift in zip(MACH[1:], shifts, strict=True)]
    return Table(markdown_table(["method", "Mach 2 [mm]", "Mach 3 [mm]", "Mach 4 [mm]"], cells), rows)


def table_shadows(shadows: dict[int, Shadow]) -> Table:
    """Quantities measured in the schlieren pictures."""
    cells, rows = [], []
    for mach, shadow in shadows.items():
        angle = float(np.degrees(shadow.bow_angle))
        wave = float(np.degrees(np.arcsin(1.0 / mach)))
        cells.append([str(mach), f"{angle:.1f}", f"{wave:.1f}", f"{1e3 * shadow.stand_off:.1f}"])
        rows.append(["figure 5", "angle of the first shock", "tunnel", mach, "deg", "", angle])
        rows.append(["figure 5", "stand-off of the first shock", "tunnel", mach, "m", "", shadow.stand_off])
    heading = ["Mach", "first shock, 20 to 60 mm behind the nose [deg]", "Mach wave [deg]", "stand-off [mm]"]
    return Table(markdown_table(heading, cells), rows)


def table_shocks(pictures: dict[str, dict[int, Shadow]]) -> Table:
    """Strength of the three shocks in the pictures by density."""
    cells, rows = [], []
    quantities = ("deflection across the edge", "rad"), ("density step", "kg/m3")  # the first is in the Markdown
    for density, shadows in pictures.items():
        for shock in SHOCKS:
            row = [density, shock]
            for index, (words, unit) in enumerate(quantities):
                strength = {mach: shadow.shocks[shock][index] for mach, shadow in shadows.items()}
                row += [f"{1e6 * value:.0f}" for value in strength.values() if index == 0]
                rows += [["figure 5", f"{words}, {shock}", density, m, unit, "", v] for m, v in strength.items()]
            cells.append(row)
    heading = ["density", "shock", *(f"Mach {mach} [µrad]" for mach in MACH[1:])]
    return Table(markdown_table(heading, cells, text_columns=2), rows)


def table_steps(steps: dict[int, Steps]) -> Table:
    """Steps and errors of the OPD by eq 5, by fixed steps of the same count, and by error control."""
    cells, rows = [], []
    for mach, found in steps.items():
        rules = ("eq 5", "fixed", "adaptive")
        counts = (f"{found.count[r]:.1f}" for r in ("eq 5", "adaptive"))
        cells.append([str(mach), *counts, *(f"{found.error[r]:.1e}" for r in rules)])
        for rule in rules:
            rows.append(["eq 5", f"steps a ray, {rule}", "tunnel", mach, "1", "", found.count[rule]])
            rows.append(["eq 5", f"rms error of the OPD, {rule}", "tunnel", mach, "wave", "", found.error[rule]])
    heading = ["Mach", "steps, eq 5", "error control", "rms error, eq 5 [waves]", "fixed", "error control"]
    return Table(markdown_table(heading, cells), rows)


def table_scheme(peaks: dict[str, dict[int, dict[str, float]]]) -> Table:
    """Echo peaks by the paper's whole scheme beside ours."""
    cells, rows = [], []
    for density, by_mach in peaks.items():
        for mach, peak in by_mach.items():
            others = {name: value for name, value in peak.items() if name != "ours"}
            change = {name: value / peak["ours"] - 1.0 for name, value in others.items()}
            cells.append(
                [density, str(mach), f"{peak['ours']:.3f}"]
                + [f"{others[name]:.3f} ({100 * change[name]:+.1f} %)" for name in list(others)[1:]]
            )
            rows += [["scheme", f"echo peak, {name}", density, mach, "V", "", value] for name, value in peak.items()]
    heading = ["density", "Mach", "ours [V]", "eq 5, 6, 7 [V]", "eq 6, 7, error control [V]"]
    return Table(markdown_table(heading, cells), rows)


def table_figure1(outcomes: list) -> Table:
    """Greatest errors of Figure 1 at its own start height."""
    cells, rows = [], []
    for outcome in outcomes:
        scheme, error = outcome.scheme, float(outcome.error[:, 0].max())
        printed = FIGURE_1 if scheme.rule == "eq 5" and not scheme.name.startswith("ours") else None
        cells.append([scheme.name, scheme.rule, f"{printed:.2e}" if printed else "", f"{error:.1e}"])
        rows.append(["figure 1", f"{scheme.name}: {scheme.rule}", "", "", "1", printed or "", error])
    return Table(markdown_table(["scheme", "step rule", "paper", "greatest error"], cells, text_columns=2), rows)
