"""Run every shipped scene against Mach number; see aerokernels/validation/paper/mach_sweep.py."""

import argparse
from pathlib import Path

from aerokernels.validation.paper.mach_sweep import SCENES, draw, run_scene, table
from aerokernels.validation.paper.printed import SIMULATED, TABLE_3
from aerokernels.validation.report import filled, write_csv

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "sweep-mach.md"


def main() -> None:
    """Run the scenes and write table, CSV and picture."""
    parser = argparse.ArgumentParser(prog="scripts/sweep_mach", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "sweep_mach")
    parser.add_argument("--rays", type=int, metavar="COUNT", help="rays for each Strehl ratio, fewer for a quick look")
    parser.add_argument("--page", action="store_true", help="put the table into docs/sweep-mach.md too")
    options = parser.parse_args()
    points = []
    try:
        if options.page:  # fail before the work, not after it
            filled(PAGE, {"sweep_mach": ""})
        for number, name in enumerate(SCENES, start=1):
            print(f"{number}/{len(SCENES)} {name}", flush=True)
            points.append(run_scene(name, options.rays))
        text = table(points)
        if options.page:
            PAGE.write_text(filled(PAGE, {"sweep_mach": text}), encoding="utf-8")
    except ValueError as fault:
        parser.error(str(fault))
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "table.md").write_text(text, encoding="utf-8")
    heading = ["scene", "mach", "ambient_density_kg_m3", "true_range_m", "strehl", "strehl_marechal", "opd_rms_m"]
    heading += ["boresight_rad", "echo_peak_v", "range_leading_edge_m", "range_constant_fraction_m"]
    heading += ["paper_test_peak_v", "paper_simulated_peak_v"]
    rows = [[*vars(point).values(), TABLE_3[point.mach], round(SIMULATED[point.mach], 3)] for point in points]
    write_csv(options.out / "table.csv", heading, rows)
    draw(points, options.out / "sweep_mach.png")
    print(f"\n{text}\nwrote {options.out}/table.md, table.csv and sweep_mach.png")


if __name__ == "__main__":
    main()
