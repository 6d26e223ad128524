"""A run finishes what can be finished: what has no result is reported with its reason, and the rest is there."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.simulator import EchoSource
from aerokernels.jobs import run
from aerokernels.jobs.explain import explanation
from aerokernels.jobs.numbers import headline_rows, remark_rows
from aerokernels.jobs.run import simulate, write_run
from aerokernels.jobs.run_folder import read_run
from aerokernels.jobs.store import read_result, to_json
from aerokernels.scene import Scene

SMALL = {"strehl.ray_count": 1024, "beam.ray_count": 32, "receiver.ray_count": 32, "grid.spacing": "0.2 mm"}


def refuse(word: str):
    raise AssertionError(f"{word} is no JSON")


def written(result, out: Path) -> tuple[dict, str]:
    """The summary and the page of a run."""
    write_run(result, out)
    return read(out)


def read(out: Path) -> tuple[dict, str]:
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"), parse_constant=refuse)
    return summary, (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "changes",
    [
        {"target.distance": "30 m"},
        pytest.param({"receiver.diameter": "6 mm"}, marks=pytest.mark.slow),
        pytest.param({"target.tilt": "80 deg"}, marks=pytest.mark.slow),
        {"detector.threshold": "5 V"},
    ],
)
def test_an_echo_that_cannot_be_ranged_is_a_result(changes, tmp_path: Path):
    """Set-up: still air, the vacuum's echo below the threshold. Expected: null for the range, the reason, and all else.

    The other methods do not need a threshold and read the distance.
    """
    scene = Scene.load("wind-tunnel-static", {**SMALL, **changes})
    result = simulate(scene)
    summary = json.loads(json.dumps(to_json(result.summary), allow_nan=False))
    assert summary["range_m"] is None and summary["range_error_m"] is None and summary["errors"]["range_m"] is None
    assert set(summary["failures"]) == {"range"} and "in vacuum" in summary["failures"]["range"]
    assert summary["strehl"] == pytest.approx(1.0) and summary["echo_peak_v"] > 0.0
    assert summary["ranges_m"]["centroid"] == pytest.approx(scene.target.distance, rel=1e-3)
    assert ("No range", summary["failures"]["range"]) in remark_rows(summary)
    reported = dict(explanation(scene))
    assert reported["predicted, range"].startswith("none: " + summary["failures"]["range"])
    if changes != {"target.distance": "30 m"}:
        return  # one of them is written out
    kept, page = written(result, tmp_path / "out")
    assert kept.pop("files") == ["report.html", "result.nc", "summary.json"]
    assert kept == summary and "No range" in page and len(re.findall("<img class", page)) >= 8
    back = read_run(str(tmp_path / "out"))
    assert back.voltage.max() == pytest.approx(summary["echo_peak_v"], rel=1e-2)
    assert back.distance == summary["true_range_m"]


def test_explain_predicts_how_much_the_flow_may_take():
    reported = dict(explanation(Scene.load("wind-tunnel-static", SMALL)))
    share = float(re.search(r"at least ([\d.]+) of the peak", reported["predicted, range"])[1])
    assert share == pytest.approx(1.0 / 1.9948, abs=2e-3)  # the threshold of 1 V over the peak
    coarse = dict(explanation(Scene.load("wind-tunnel-mach3", {**SMALL, "grid.spacing": "7 mm"})))
    assert "not meaningful" in coarse["warning"] and "smaller spacing" in coarse["warning"]


@pytest.mark.parametrize(
    ("stage", "name", "keys", "figures"),
    [
        ("echo", "echo_through", ("echo_peak_w", "echo_peak_v", "range_m", "echo_strehl"), {"echo", "methods"}),
        ("wavefront", "scene_wavefront", (), {"parts", "opd", "cuts", "psf", "psfcuts"}),
        ("rays", "ray_fan", (), {"rays", "bending"}),
    ],
)
def test_a_stage_that_finds_nothing_leaves_the_rest(stage, name, keys, figures, tmp_path: Path, monkeypatch):
    """Set-up: a stage refuses, as where no light returns. Expected: nulls with the reason, and everything else."""

    def dark(*arguments, **options):
        raise ValueError("no ray gets out, nan <of> them")

    monkeypatch.setattr(run, name, dark)
    result = simulate(Scene.load("wind-tunnel-static", SMALL))
    summary, page = written(result, tmp_path / "out")
    assert summary["failures"] == {stage: "no ray gets out, nan <of> them"}
    assert all(summary[key] is None for key in keys) and summary["strehl"] == pytest.approx(1.0)
    assert "no ray gets out, nan &lt;of&gt; them" in page
    panels = {"density", "rays", "bending", "parts", "opd", "cuts", "psf", "psfcuts", "echo", "methods", "budget"}
    there = set(re.findall(r'<figure class="panel[^"]*" id="([\w-]+)">', page))
    assert there - {"crossing"} == panels - figures
    assert read_result(tmp_path / "out" / "result.nc").attrs["strehl"] == pytest.approx(1.0)
    if stage == "echo":
        assert ("Reported range", "none") in headline_rows(summary)
        with pytest.raises(ValueError, match="no echo to compare with: no ray gets out"):
            read_run(str(tmp_path / "out"))
        with pytest.raises(ValueError, match="holds no 'echo_voltage'"):
            EchoSource.from_result(tmp_path / "out")
    else:
        assert summary["range_m"] == pytest.approx(1.5, abs=1e-3)


def test_every_estimate_of_the_summary_has_its_error(small_run):
    """Set-up: the Mach 3 scene on a coarse grid. Expected: `errors` has keys of the summary, each above 0.

    The page writes value and error together; the budget's total is the
    Strehl ratio's, and the leading edge's systematic error is that of the reported range, without noise.
    """
    result, folder = small_run
    summary, page = read(folder)
    errors = summary["errors"]
    for key, error in errors.items():
        assert key in summary
        if key == "ranges_m":
            assert set(error) == set(summary[key]) and all(value > 0.0 for value in error.values())
        else:
            assert error > 0.0, key
    assert errors["strehl"] == summary["error"]["total"]
    assert errors["range_m"] == errors["range_error_m"]
    for name, text in headline_rows(summary):
        assert " +- " in text or text.endswith("error below rounding"), text
        assert text.replace("+-", "±") in page or name.startswith("Boresight"), text
    assert page.count(" ± ") > 8
    dataset = result.to_xarray()
    assert dataset.attrs["strehl_error"] == errors["strehl"] and np.isfinite(dataset.attrs["range_m_error"])
