"""A quarter-size run of scripts/flows against the shipped field: a minute of OpenFOAM, where it is installed."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from aerokernels import flow

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("rhoCentralFoam") is None, reason="OpenFOAM is not installed")
def test_a_quarter_size_run_gives_the_shipped_field(tmp_path):
    """Set-up: Mach 3 on 62 x 20 cells. Expected: the shipped density at its cells' middles.

    Errors: a captured shock is four times as wide; elsewhere second order in cells four times as large. The median
    change says how the smooth flow agrees (0.012 was seen), the mean how the shock is smeared (0.057).
    """
    out = tmp_path / "mach3.npz"
    script = str(ROOT / "scripts" / "flows" / "make.py")
    subprocess.run([sys.executable, script, "3", str(out), "--scale", "0.25"], check=True, cwd=tmp_path)
    with np.load(out) as data:
        r, x, density, ambient = (data[name].astype(float) for name in ("r", "x", "rho", "rho_inf"))
    middle = [0.25 * (v[1:, 1:] + v[1:, :-1] + v[:-1, 1:] + v[:-1, :-1]).ravel() for v in (r, x)]
    shipped = flow.shipped("mach3")
    fine = shipped.density_at(np.stack([0.0 * middle[0], middle[0], -middle[1]], axis=1))
    known = np.isfinite(fine)
    change = np.abs(density.ravel()[known] - fine[known]) / ambient
    assert known.mean() > 0.95
    assert np.median(change) < 0.02 and change.mean() < 0.08
