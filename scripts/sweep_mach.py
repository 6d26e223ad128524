"""Every shipped scene against Mach number, in the tunnel's thin air and at sea level, beside the paper's Table 3.

The paper gives test peaks (Table 3) and their relative errors against its simulation (Table 4); the peaks of its
simulation follow from both: test / (1 + error). The scale of the voltage is fitted to its peak without flow, and no
other quantity is fitted.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerokernels.jobs.run import simulate
from aerokernels.scene import Scene
from scripts.studies.paper.printed import SIMULATED, TABLE_3
from scripts.studies.report import filled, markdown_table, saved_figure, write_csv

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "questions.md"

SCENES = ["wind-tunnel-static", *(f"{air}-mach{mach}" for air in ("wind-tunnel", "sea-level") for mach in (2, 3, 4))]
LOOK = {"wind-tunnel": ("#0b6e99", "tunnel density"), "sea-level": ("#c2410c", "sea-level density")}


@dataclass(frozen=True)
class Point:
    """Results of one scene, in SI units."""

    scene: str
    mach: int
    density: float
    true_range: float
    strehl: float
    marechal: float
    opd_rms: float
    boresight: float
    peak: float
    leading_edge: float
    constant_fraction: float


def run_scene(name: str, ray_count: int | None) -> Point:
    """Simulate one scene."""
    scene = Scene.load(name, None if ray_count is None else {"strehl.ray_count": ray_count})
    result = simulate(scene)
    summary = result.summary
    return Point(
        scene=name,
        mach=round(summary["mach"]),
        density=summary["ambient_density_kg_m3"],
        true_range=summary["true_range_m"],
        strehl=summary["strehl"],
        marechal=summary["strehl_marechal"],
        opd_rms=summary["opd_rms_m"],
        boresight=float(np.hypot(*result.strehl.boresight)),
        peak=summary["echo_peak_v"],
        leading_edge=summary["ranges_m"].get("leading-edge", np.nan),
        constant_fraction=summary["ranges_m"].get("constant-fraction", np.nan),
    )


def read_range(distance: float) -> str:
    """Format a range [m] for the table; "none" where the echo gave no range."""
    return f"{distance:.4f}" if np.isfinite(distance) else "none"


def table(points: list[Point]) -> str:
    """Return the table for the documents."""
    heading = ["scene", "Strehl ratio", "Maréchal", "OPD rms [nm]", "peak [V]"]
    heading += ["range, leading edge [m]", "range, constant fraction [m]"]
    rows = [
        [
            point.scene,
            f"{point.strehl:.4f}",
            f"{point.marechal:.4f}",
            f"{1e9 * point.opd_rms:.1f}",
            f"{point.peak:.3f}",
            read_range(point.leading_edge),
            read_range(point.constant_fraction),
        ]
        for point in points
    ]
    return markdown_table(heading, rows)


def draw(points: list[Point], path: Path) -> None:
    """Draw Strehl ratio, peak voltage and range error against Mach number."""
    with saved_figure(path, 12.0, 4.6) as figure:
        strehl, peak, ranges = figure.subplots(1, 3)
        static = points[0]
        for air, (colour, words) in LOOK.items():
            series = [static, *(point for point in points[1:] if point.scene.startswith(air))]
            mach = [point.mach for point in series]
            line = {"color": colour, "marker": "o", "markersize": 5, "linewidth": 1.8}
            hollow = {**line, "linestyle": "--", "markerfacecolor": "white"}
            strehl.plot(mach, [point.strehl for point in series], label=words, **line)
            peak.plot(mach, [point.peak for point in series], label=f"ours, {words}", **line)
            for rows, kind, look in (
                ([1e3 * (point.leading_edge - point.true_range) for point in series], "leading edge", line),
                ([1e3 * (point.constant_fraction - point.true_range) for point in series], "constant fraction", hollow),
            ):
                ranges.plot(mach, rows, label=f"{kind}, {words}", **look)
        for values, words, marker, colour in (
            (TABLE_3, "paper, measured (Table 3)", "s", "#1f2933"),
            (SIMULATED, "paper, its simulation (from Table 4)", "^", "#8a94a0"),
        ):
            peak.plot([*values], [*values.values()], ":", marker=marker, color=colour, linewidth=1.2, label=words)
        strehl.set(
            ylabel="Strehl ratio", title="Strehl ratio, 12 mm pupil", ylim=(min(0.6, strehl.get_ylim()[0]), 1.02)
        )
        peak.set(ylabel="peak of the echo [V]", title="Echo peak")
        ranges.set(ylabel="reported − true range [mm]", title="Range error at 1.5 m")
        for axes in (strehl, peak, ranges):
            axes.set(xlabel="Mach number (0: no flow)", xticks=[0, 2, 3, 4])
            axes.legend(fontsize=8.5)


def main() -> None:
    """Run the scenes and write table, CSV and picture."""
    parser = argparse.ArgumentParser(prog="scripts/sweep_mach", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "sweep_mach")
    parser.add_argument("--rays", type=int, metavar="COUNT", help="rays for each Strehl ratio, fewer for a quick look")
    parser.add_argument("--page", action="store_true", help="put the table into docs/questions.md too")
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
