"""The scripts that write figures for the docs still run, and still say what the docs say."""

import ast
import csv
import importlib
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from scripts import paper as paper_script
from scripts import questions
from scripts.studies.report import filled


def run_script(root: Path, name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(root / "scripts" / name), *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=300.0,
    )


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def is_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000


OURS = ("aerokernels", "scripts", "tests")


def test_scripts_import_names_that_are_there(root: Path):
    """Those that no other test runs, too."""
    missing = []
    for path in sorted((root / "scripts").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OURS:
                module = importlib.import_module(node.module)
                missing += [
                    f"{path.name}: {node.module}.{alias.name}"
                    for alias in node.names
                    if not hasattr(module, alias.name)
                    and importlib.util.find_spec(f"{node.module}.{alias.name}") is None
                ]
    assert not missing


def test_each_link_is_to_a_script(root: Path):
    """`scripts/NAME` runs NAME.py in the environment; modules that scripts import are in folders."""
    links = {path.name for path in (root / "scripts").iterdir() if path.is_symlink()}
    scripts = {path.stem for path in (root / "scripts").glob("*.py")}
    assert links == scripts
    assert {str(os.readlink(root / "scripts" / name)) for name in links} == {"in_environment"}


@pytest.fixture(scope="module")
def figure1(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("figure1")
    # Four planes: 46.5 mm, the third, is near the greatest error of every scheme.
    done = run_script(root, "figure1.py", "--planes", 4, "--out", out)
    assert done.returncode == 0, done.stderr
    assert (out / "table.md").read_text(encoding="utf-8") in done.stdout
    return out


@pytest.mark.slow
def test_figure1_writes_table_curves_and_picture(figure1: Path):
    curves = read_csv(figure1 / "error_along_z.csv")
    assert [round(1e3 * float(row["z_m"]), 6) for row in curves] == [15.5, 31.0, 46.5, 62.0]
    assert len(read_csv(figure1 / "greatest_error.csv")) == 15
    assert is_picture(figure1 / "figure1.png")


@pytest.mark.slow
def test_figure1_errors(figure1: Path):
    """Greatest error of each scheme over four planes, at every start height.

    Set-up: n^2 = n0^2 (1 - g^2 y^2), n0 = 1.5, g = 0.1/mm, 0.25 mm cells (g h = 0.025), 62 mm, almost one period.
    Formula: bilinear interpolation takes the mean of n too low by g^2 h^2 / 12 = 5.2e-5 of it and its gradient too
        high by 3 g^2 h^2 / 12 = 1.6e-4: the phase advances too fast by half the sum, 5.2e-5, of 4.7 rad at 46.5 mm,
        where its sine is 1: 2.4e-4. A start between nodes adds up to g^2 h^2 / 8 = 7.8e-5 of the phase, 3.7e-4.
    Expected: 2.4e-4 on nodes (less where the ray spans few cells), up to 6.1e-4 + between them; IDW, which does not
        even hold a linear field, ten times more; ours holds the parabola, so float64 shows the steps alone, float32
        its rounding: a relative 6e-8 over some hundred steps.
    Tolerance: a factor of 2 about the estimate; for ours the bounds that the project promises.
    """
    for row in read_csv(figure1 / "greatest_error.csv"):
        error = {name: float(value) for name, value in row.items() if name != "x0_m"}
        assert len(error) == 13
        for rule in ("fixed 0.5 mm", "fixed 0.2 mm", "eq 5"):
            barron = error[f"bilinear Barron gradients: {rule}"]
            assert 1e-4 < barron < 1.2e-3, (row["x0_m"], rule)
            assert error[f"paper as printed (IDW): {rule}"] > 5.0 * barron, (row["x0_m"], rule)
        assert max(value for name, value in error.items() if name.startswith("ours, float32")) < 3e-6
        assert error["ours, float64: fixed 0.2 mm"] < 1e-8
        assert error["ours, float64: eq 5"] < 1e-10
        if float(row["x0_m"]) >= 0.5e-3:
            assert error["ours, float64: adaptive 1e-4 waves"] < 1e-8


@pytest.mark.slow
def test_sweep_mach(root: Path, tmp_path: Path):
    """The sweep's rows: no flow is perfect, thin air spoils little, sea-level air more with every Mach number."""
    done = run_script(root, "sweep_mach.py", "--rays", 1024, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "table.md").read_text(encoding="utf-8") in done.stdout
    assert is_picture(tmp_path / "sweep_mach.png")
    rows = {
        row["scene"]: {k: float(v) for k, v in row.items() if k != "scene"} for row in read_csv(tmp_path / "table.csv")
    }
    assert len(rows) == 7
    static = rows["wind-tunnel-static"]
    assert abs(static["strehl"] - 1.0) < 1e-6
    assert abs(static["range_leading_edge_m"] - static["true_range_m"]) < 1e-3
    sea_level = [rows[f"sea-level-mach{mach}"] for mach in (2, 3, 4)]
    for thin, thick in zip((rows[f"wind-tunnel-mach{mach}"] for mach in (2, 3, 4)), sea_level, strict=True):
        assert thick["strehl"] < 0.9 < 0.96 < thin["strehl"] < 1.0
        # the peak follows the Strehl ratio; the discriminator's walk, not the path, moves the leading edge
        assert thick["range_leading_edge_m"] > thin["range_leading_edge_m"] > static["range_leading_edge_m"]
        assert abs(thick["range_constant_fraction_m"] - thick["true_range_m"]) < 1e-3
    for quantity in ("strehl", "echo_peak_v"):
        assert [row[quantity] for row in sea_level] == sorted((row[quantity] for row in sea_level), reverse=True)


@pytest.fixture(scope="module")
def paper(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("paper")
    done = run_script(root, "paper.py", "--quick", "--out", out)
    assert done.returncode == 0, done.stderr
    assert (out / "tables.md").read_text(encoding="utf-8") in done.stdout
    return out


@pytest.mark.slow
def test_paper_writes_pictures_numbers_and_waveforms(paper: Path):
    for name in ("figure1", "figure5", "figure6", "figure7", "figure8"):
        assert is_picture(paper / f"{name}.png")
    waveforms = read_csv(paper / "waveforms.csv")
    assert len(waveforms) > 100 and len(waveforms[0]) == 1 + 2 * 7
    rows = read_csv(paper / "paper.csv")
    items = {row["item"] for row in rows}
    assert items >= {"figure 1", "figure 5", "range", "walk", *(f"table {number}" for number in range(2, 7))}
    assert all(np.isfinite(float(row[side])) for row in rows for side in ("paper", "ours") if row[side])


PAGES = {
    "docs/paper.md": paper_script.TABLES,
    "docs/accuracy.md": ("evaluations", "default", "reported", "peers"),
    "docs/questions.md": ("sweep_mach", *questions.QUESTIONS),
}


@pytest.mark.parametrize("page", PAGES)
def test_pages_have_the_marks_of_their_tables(root: Path, page: str):
    """`filled` refuses a page without them; and no page has marks that no script fills."""
    text = (root / page).read_text(encoding="utf-8")
    assert filled(root / page, dict.fromkeys(PAGES[page], "TABLE\n")).count("TABLE\n") == len(PAGES[page])
    assert text.count(":begin -->") == len(PAGES[page])
