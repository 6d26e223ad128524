"""Make the source paper's Figure 1, on a medium with exactly known rays, and the same on one that no polynomial fits.

docs/paper.md has the figure and its table for one start height.
"""

import argparse
from pathlib import Path

import numpy as np

from aerokernels.inputs.units import quantity
from scripts.studies.paper import figure1
from scripts.studies.report import markdown_table, write_csv


def main() -> None:
    """Run all schemes and write table, CSV and picture."""
    parser = argparse.ArgumentParser(prog="scripts/figure1", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/figure1"))
    parser.add_argument("--planes", type=int, default=124, help="planes along z at which the error is taken")
    parser.add_argument("--height", default="0.5 mm", help='start height x0 of the curves, such as "1.6 mm"')
    options = parser.parse_args()
    try:
        first = quantity(options.height, "length")
    except ValueError as fault:
        parser.error(f"--height: {fault}")
    if options.planes < 2:
        parser.error(f"--planes: {options.planes} is too few, give at least 2")
    if not figure1.CELL / 10 <= first <= figure1.HALF_HEIGHT - figure1.MARGIN / 4:
        parser.error(f"--height: {first:g} m lies outside 0.025 to 3.5 mm, the sampled region")

    height = np.array([first, *(h for h in figure1.HEIGHTS if abs(h - first) > 1e-9)])
    off_node = int(np.argmin(np.abs(height - figure1.OFF_NODE)))
    planes = np.linspace(0.0, figure1.LENGTH, options.planes + 1)[1:]
    outcomes = figure1.run_medium(figure1.PARABOLA, height, planes)
    control = figure1.run_medium(figure1.SECH, height[[0, off_node]], planes)

    options.out.mkdir(parents=True, exist_ok=True)
    greatest = [outcome.error.max(axis=0) for outcome in outcomes]
    shown = [f"{1e3 * height[k]:.3g} mm" for k in (0, off_node)]
    heading = ["scheme", "step rule", *(f"error, x0 = {x0}" for x0 in shown), "steps", "evaluations"]
    heading += [f"sech, {x0}" for x0 in shown]
    rows = [
        [
            outcome.scheme.name,
            outcome.scheme.rule,
            *(f"{worst[k]:.1e}" for k in (0, off_node)),
            str(outcome.step_count),
            str(outcome.evaluation_count),
            *(f"{error:.1e}" for error in other.error.max(axis=0)),
        ]
        for outcome, worst, other in zip(outcomes, greatest, control, strict=True)
    ]
    text = markdown_table(heading, rows, text_columns=2)
    (options.out / "table.md").write_text(text, encoding="utf-8")
    names = [f"{outcome.scheme.name}: {outcome.scheme.rule}" for outcome in outcomes]
    write_csv(
        options.out / "error_along_z.csv",
        ["z_m", *names],
        np.column_stack([planes, *(o.error[:, 0] for o in outcomes)]).tolist(),
    )
    order = np.argsort(height)
    write_csv(
        options.out / "greatest_error.csv",
        ["x0_m", *names],
        np.column_stack([height, *greatest])[order].tolist(),
    )
    figure1.draw(outcomes, height, planes, options.out / "figure1.png")
    print(text)
    print(f"wrote {options.out}/table.md, error_along_z.csv, greatest_error.csv and figure1.png")


if __name__ == "__main__":
    main()
