"""Make Tables 2 to 6 and Figures 1 and 5 to 8 of the source paper, at tunnel and at atmospheric density.

Writes the pictures, every number as CSV, the waveforms as CSV, and the tables as Markdown; `--page` puts the tables
into docs/paper.md, between its markers. Nothing is tuned: the scenes are the shipped ones.
"""

import argparse
from pathlib import Path

import numpy as np

from scripts.studies.paper import figure1, figures, tables
from scripts.studies.paper.cases import DENSITIES, picture_grid, run_cases, shadow
from scripts.studies.paper.printed import MACH
from scripts.studies.paper.scheme import scheme_peaks, step_rules
from scripts.studies.report import filled, write_csv

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "paper.md"
# Tables of the page; the folder's tables.md has all of them.
TABLES = ("figure1", "steps", "scheme", "table2", "figure5", "shocks", "table3", "table4", "table6", "ranges")
# Sensitivity of the bench for all of Figure 5: the strongest flow, Mach 2, nearly saturates it [1/rad].
SENSITIVITY = 400.0


def write_waveforms(cases: dict, path: Path) -> None:
    """Write recorded and noise-free voltages of every case, on their common times."""
    names, columns = ["time_s"], [cases["tunnel"][0].recorded.time]
    for density, by_mach in cases.items():
        for mach, case in by_mach.items():
            if mach == 0 and density != "tunnel":
                continue
            label = f"{density}_mach{mach}" if mach else "no_flow"
            names += [f"{label}_recorded_v", f"{label}_clean_v"]
            columns += [case.recorded.voltage, case.recorded.clean_voltage]
    write_csv(path, names, np.column_stack(columns).tolist())


def main() -> None:
    """Compute everything and write it."""
    parser = argparse.ArgumentParser(prog="scripts/paper", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "paper")
    parser.add_argument("--page", action="store_true", help="put the tables into docs/paper.md as well")
    parser.add_argument("--quick", action="store_true", help="few rays, pixels and trials, for a look")
    options = parser.parse_args()
    trials, rays, pixels, planes = (20, 64, 120, 4) if options.quick else (1000, 1024, 600, 124)
    spacing = 1e-3 if options.quick else 0.25e-3  # of the grid behind the schlieren pictures [m]

    def say(words: str) -> None:
        print(words, flush=True)

    try:
        if options.page:  # fail before the work, not after it
            filled(PAGE, dict.fromkeys(TABLES, ""))
        say("figure 1")
        height = np.array([0.5e-3, *(h for h in figure1.HEIGHTS if h != 0.5e-3)])
        z = np.linspace(0.0, figure1.LENGTH, planes + 1)[1:]
        outcomes = figure1.run_medium(figure1.PARABOLA, height, z)
        say("eq 5 to 7 on the shipped flows")
        steps = {mach: step_rules(mach, rays) for mach in MACH[1:]}
        many = 16 * rays  # eq 6 jumps from cell to cell, and so does the wavefront
        peaks = {density: {mach: scheme_peaks(density, mach, many) for mach in MACH[1:]} for density in DENSITIES}
        cases = run_cases(trials, rays, say)
        thin, dense, tuned = {}, {}, {}
        for mach in MACH[1:]:
            say(f"schlieren: Mach {mach}")
            grid = picture_grid(mach, spacing)
            thin[mach] = shadow(mach, grid, pixels, SENSITIVITY)
            tuned[mach] = shadow(mach, grid, pixels)
            dense[mach] = shadow(mach, picture_grid(mach, spacing, 1.225), pixels)
        made = {
            "figure1": tables.table_figure1(outcomes),
            "steps": tables.table_steps(steps),
            "scheme": tables.table_scheme(peaks),
            "table2": tables.table_2(),
            "figure5": tables.table_shadows(thin),
            "shocks": tables.table_shocks({"tunnel": thin, "atmospheric": dense}),
            "table3": tables.table_3(cases),
            "table4": tables.table_4(cases),
            "table5": tables.table_5(),
            "table6": tables.table_6(cases),
            "walk": tables.table_walk(),
            "ranges": tables.table_ranges(cases),
        }
        page = filled(PAGE, {name: made[name].markdown for name in TABLES}) if options.page else None
    except (OSError, ValueError) as fault:
        parser.error(str(fault))

    out = options.out
    out.mkdir(parents=True, exist_ok=True)
    figure1.draw(outcomes, height, z, out / "figure1.png")
    figures.draw_figure5(thin, out / "figure5.png")
    figures.draw_figure6(dense, tuned, out / "figure6.png")
    figures.draw_figure7(cases, out / "figure7.png")
    figures.draw_figure8(cases, out / "figure8.png")
    write_csv(out / "paper.csv", tables.HEADING, [row for table in made.values() for row in table.rows])
    write_waveforms(cases, out / "waveforms.csv")
    text = "\n".join(f"## {name}\n\n{table.markdown}" for name, table in made.items())
    (out / "tables.md").write_text(text, encoding="utf-8")
    if page is not None:
        PAGE.write_text(page, encoding="utf-8")
    say(f"\n{text}\nwrote {out}/tables.md, paper.csv, waveforms.csv and figures 1 and 5 to 8")


if __name__ == "__main__":
    main()
