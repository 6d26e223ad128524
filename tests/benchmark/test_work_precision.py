"""scripts/work_precision: what it measures against is right, and what it writes is complete and true."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from aerokernels import RayBundle
from aerokernels.benchmark.scenes import integrate, potential_of
from scripts.studies.work_precision import fields

WAVE = 905e-9


def lens_rays(slope: float):
    """A few rays from z = 0, within 2 mm of the axis."""
    rng = np.random.default_rng(4)
    across, slopes = rng.uniform(-1.4e-3, 1.4e-3, (12, 2)), slope * rng.uniform(-1.0, 1.0, (12, 2))
    return RayBundle(np.c_[across, np.zeros(12)], np.c_[slopes, np.ones(12)])


@pytest.mark.parametrize("medium", ["parabola", "sech"])
def test_two_truths_agree(medium: str):
    """The closed forms and the integrator know nothing of each other, so an error of either would show.

    Set-up: n0 = 1.5, g = 0.1 / mm, 62 mm as in fields.py; skew rays in the parabola, parallel ones in sech.
    Expected: the same position, direction and OPD.
    Tolerance: some 70 steps of a relative 1e-12 on 2 mm, 0.3 rad and 900 waves are 1.4e-13 m, 2e-11 rad and 6e-8 waves;
        ten times that.
    """
    n0, g, length = 1.5, 100.0, 62e-3

    def parabola(x, y, z):
        root = np.sqrt(1.0 - g**2 * (x**2 + y**2))
        return n0 * (root - 1.0), -n0 * g**2 * np.stack([x, y]) / root

    def sech(x, y, z):
        r = np.hypot(x, y)
        index = n0 / np.cosh(g * r)
        return index - n0, -g * np.tanh(g * r) * index * np.stack([x, y]) / r

    formula, rays = (parabola, lens_rays(0.1)) if medium == "parabola" else (sech, lens_rays(0.0))
    exact = getattr(fields, f"{medium}_truth")(rays)
    found = integrate(potential_of(formula, n0), n0, length, 1e-3, rays)
    assert np.abs(found.position - exact.position).max() < 1e-12
    assert np.abs(found.direction - exact.direction).max() < 1e-10
    assert np.abs(found.opd - exact.opd).max() < 6e-7 * WAVE
    assert np.ptp(exact.opd) > WAVE  # rays that differ, or the comparison would be an empty one


@pytest.fixture(scope="module")
def quick(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if "AEROKERNELS_SLOW" not in os.environ:
        pytest.skip("a quarter of a minute: set AEROKERNELS_SLOW")
    out = tmp_path_factory.mktemp("work_precision")
    done = subprocess.run(
        [sys.executable, str(root / "scripts" / "work_precision.py"), "--quick", "--out", str(out)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=300.0,
    )
    assert done.returncode == 0, done.stderr
    assert (out / "table.md").read_text(encoding="utf-8") in done.stdout
    return out


def read_runs(out: Path) -> list[dict[str, str]]:
    with (out / "runs.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_quick_run_writes_table_rows_and_pictures(quick: Path):
    runs = read_runs(quick)
    assert {(row["field"], row["method"]) for row in runs} == {
        (field, method) for field in ("radial", "shock") for method in ("adaptive", "fixed", "auto")
    }
    for field in ("radial", "shock"):
        for axis in ("evaluations", "time"):
            picture = quick / f"{field}_{axis}.png"
            assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000
    for row in runs:
        assert row["ray_count_ok"] == row["ray_count"] == "64"
        assert 0.0 < float(row["kernel_us_per_ray_min"]) <= float(row["kernel_us_per_ray_median"])


def test_quick_run_measures_errors(quick: Path):
    """Errors fall with the step and with the tolerance, and the two kinds are what they should be.

    Set-up: float64, cubic; radial gradient and shock, steps of 8, 2 and 1 cells, tolerances of 1e-1, 1e-3 and 1e-5.
    Formula: the spline holds the radial gradient's n^2 exactly, so its two errors are one, and of fourth order: from 8
        cells to 2 the error falls by 4^4 = 256. Through the shock the spline's own error, 1e-7 waves as the difference
        of the tight trace and the truth, is all that is left at small steps.
    Tolerance: a factor of 1.5 on the order's 256 (8 cells are a tenth of a period); two errors that are one agree to
        1 %; a finer tolerance never gives more error or fewer evaluations.
    """
    runs = read_runs(quick)

    def column(field: str, method: str, name: str) -> np.ndarray:
        some = [row for row in runs if (row["field"], row["method"], row["precision"]) == (field, method, "float64")]
        return np.array([float(row[name]) for row in some])

    steps = column("radial", "fixed", "tracing_opd_rms_waves")
    assert 256.0 / 1.5 < steps[0] / steps[1] < 256.0 * 1.5
    for method in ("adaptive", "fixed"):
        tracing = column("radial", method, "tracing_opd_rms_waves")
        assert column("radial", method, "total_opd_rms_waves") == pytest.approx(tracing, rel=1e-2)
        for field in ("radial", "shock"):
            assert (np.diff(column(field, method, "tracing_opd_rms_waves")) < 0.0).all()
            assert (np.diff(column(field, method, "evaluations_per_ray")) > 0.0).all()
    assert column("shock", "fixed", "tracing_opd_rms_waves")[-1] < 1e-7
    assert 1e-8 < column("shock", "fixed", "total_opd_rms_waves")[-1] < 1e-6


def test_refuses_what_makes_no_sense(root: Path, tmp_path: Path):
    done = subprocess.run(
        [sys.executable, str(root / "scripts" / "work_precision.py"), "--rays", "0", "--out", str(tmp_path / "out")],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=300.0,
    )
    assert done.returncode == 2 and "few" in done.stderr
    assert not (tmp_path / "out").exists()
