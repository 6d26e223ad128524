"""scripts/work_precision: what it measures against is right, and what it writes is complete and true."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

WAVE = 905e-9
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def quick(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
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
