"""scripts/peers: other libraries trace the benchmark's cone scene, and an absent one says how to get it."""

from pathlib import Path

import pytest

from scripts import peers


def test_peers_that_are_here_trace_the_same_scene(root: Path):
    page = (root / "docs" / "performance-bench.md").read_text(encoding="utf-8")
    found = list(peers.cone_runs(64, 2))
    assert {"scipy", "diffrax", "drjit"} == {run["peer"] for run in found}
    for run in found:
        assert len(peers.table_row(run)) == len(peers.COLUMNS)
        for key in run:
            assert f"`{key}`" in page, f"docs/performance-bench.md does not tell of {key}"
        if not run["available"]:
            assert "pip install" in run["reason"] or "failed" in run["reason"]
            continue
        assert run["error"]["lost_ray_count"] == 0 and run["error"]["opd_rms_waves"] < 0.1
        if run["peer"] == "scipy":
            assert run["error"]["direction_max_urad"] < 0.1 and run["error"]["opd_max_waves"] < 1e-4


def test_absent_peers_say_how_to_get_them(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(peers, "NEEDS", dict.fromkeys(peers.NEEDS, ("no_such_package",)))
    found = list(peers.cone_runs(16, 1))
    assert len(found) == 3
    for run in found:
        assert not run["available"] and "no_such_package" in run["reason"] and "pip install" in run["reason"]
