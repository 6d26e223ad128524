"""scripts/fuzz_budget: its truth is right, and some of its scenes are covered by their budgets, or flagged."""

import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

# Quick ones of every kind, that each hold something of their own; the even ones go to one engine, the odd ones to the
# other. Of 223, 245 and 267 the box cuts disturbed air, which would have turned rays ahead of a slanted stop.
SEEDS = (223, 245, 267, 1011, 1024, 1078, 1104, 1220, 1252, 1261, 1288, 1294)


@pytest.fixture
def fuzz(root: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(root / "scripts"))
    import fuzz_budget

    return fuzz_budget


def test_its_truth_is_that_of_a_formula(fuzz):
    """A weak Gaussian blob: OPD = A w sqrt(pi) exp(-b^2 / w^2) to first order in A = 1e-7; halved steps change nothing.

    The second order is A times that, the air beyond 12 widths exp(-144).
    """
    amplitude, width = 1e-7, 1e-3
    air = fuzz.Air("volume", np.array([[amplitude, 0, 0, 0, *[1.0 / width] * 3]]), np.zeros((0, 6)), width)
    offset = np.linspace(0.0, 2e-3, 5)
    start, ahead = np.c_[offset, 0 * offset, np.full(5, -12e-3)], np.tile([0.0, 0.0, 1.0], (5, 1))
    stop = fuzz.Plane((0.0, 0.0, 12e-3), (0.0, 0.0, 1.0))
    expected = amplitude * width * np.sqrt(np.pi) * np.exp(-((offset / width) ** 2))
    for step in (0.25e-3, 0.125e-3):
        found = fuzz.true_opd(air, start, ahead, stop, step)
        assert found == pytest.approx(expected, rel=1e-5, abs=1e-18)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_scene_is_covered_or_flagged(fuzz, seed, monkeypatch):
    """Set-up and truth: scripts/fuzz_budget. Expected: no error above the reported total without a word of it."""
    monkeypatch.setattr(fuzz, "COMPARED", 100)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        findings = fuzz.check(fuzz.draw(seed), ("opencl", "warp")[seed % 2])
    assert findings
    for finding in findings:
        assert finding.covered or finding.flagged, finding
