"""scripts/peers: this package and Dr.Jit trace the same bundles, and an absent peer says how to get it."""

from pathlib import Path

import pytest

from scripts import peers


def test_peers_that_are_here_trace_the_same_bundles(root: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(peers, "KINDS", ("slanted",))
    page = (root / "docs" / "performance-bench.md").read_text(encoding="utf-8")
    found = list(peers.bundle_runs(64, 2))
    assert {run["peer"] for run in found} == {"aerokernels", "drjit"}
    for run in found:
        assert len(peers.table_row(run)) == len(peers.COLUMNS)
        for key in run:
            assert f"`{key}`" in page, f"docs/performance-bench.md does not tell of {key}"
        if not run["available"]:
            assert "pip install" in run["reason"]
            continue
        assert run["error"]["lost_ray_count"] == 0 and run["error"]["opd_rms_waves"] < 1e-3
