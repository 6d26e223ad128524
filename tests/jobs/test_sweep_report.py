"""The page of a sweep: what no key changes, figures over what changes a number, and reasons for failures."""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import aerokernels
from aerokernels.commands._output import output
from aerokernels.commands.scene_jobs import _finish
from aerokernels.jobs.pages.sweep_page import sweep_page
from aerokernels.jobs.sweeps.definition import define

SMALL = ["strehl.ray_count=64", "beam.ray_count=16", "receiver.ray_count=16", 'receiver.return_factor="none"']


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory):
    """A sweep without flow over distance and tilt; at 4 m the echo is below the threshold."""
    out = tmp_path_factory.mktemp("sweep") / "out"
    scene = aerokernels.Scene.load("wind-tunnel-static", dict(text.split("=") for text in SMALL[:3]))
    vary = {"target.distance": [1.0, 1.5, 4.0], "target.tilt": [0.0, 0.5]}
    with ThreadPoolExecutor(1) as here:
        found = aerokernels.sweep(scene, vary, out=out, executor=here)
    return found, (out / "report.html").read_text(), out


def figures(page: str) -> dict[str, str]:
    """What is said of each figure, by its name."""
    return dict(re.findall(r'<figure class="panel" id="([\w.-]+)">.*?<p class="says">(.*?)</p>', page, re.DOTALL))


def test_numbers_that_no_key_changes_are_told_once(finished):
    _, page, _ = finished
    same = page[page.index("<caption>The same in every case") : page.index("<caption>Cases, each")]
    assert re.search(r"Strehl ratio</th><td>1[., ]", same) and "Boresight error" in same
    assert set(figures(page)) == {"echo_peak_v", "range_error_m"}
    assert figures(page)["echo_peak_v"] == "Over target.distance and target.tilt."
    cases = page[page.index("Cases, each number") : page.index("Repeat this")]
    assert "Strehl ratio" not in cases and cases.count("<tr>") == 7


def test_reasons_are_given_once(finished):
    found, page, _ = finished
    assert list(found.failed.values.ravel()) == [False] * 6 and np.isnan(found.range_m.values[2]).all()
    reasons = re.findall("<li>(.*?)</li>", page)
    assert len(reasons) == 1 and reasons[0].startswith("Case 4 and 1 more: range: ") and "threshold" in reasons[0]


def test_a_figure_is_over_the_keys_that_change_it(finished):
    """Echoes that both keys change, and that one of them does not."""
    found, _, _ = finished

    def page_of(tilts: int, value) -> dict[str, str]:
        distance, tilt = np.linspace(1.0, 2.0, 9), np.linspace(0.0, 0.5, tilts)
        wide = found.isel({"target.distance": [0] * 9, "target.tilt": [0] * tilts})
        wide = wide.assign_coords({"target.distance": distance, "target.tilt": tilt})
        for key in ("target.distance", "target.tilt"):
            wide[key].attrs = found[key].attrs
        wide["echo_peak_v"] = wide["echo_peak_v"] * 0.0 + value(*np.meshgrid(distance, tilt, indexing="ij"))
        wide["echo_peak_v_error"] = 0.0 * wide["echo_peak_v_error"] + 0.01
        definition = define("wind-tunnel-static", {"target.distance": list(distance), "target.tilt": list(tilt)})
        return figures(sweep_page(wide, definition).html())

    assert page_of(9, lambda d, t: d) == {"echo_peak_v": "Over target.distance; target.tilt does not change it."}
    assert page_of(9, lambda d, t: d + t) == {"echo_peak_v": "Over target.distance and target.tilt."}
    assert page_of(3, lambda d, t: t) == {"echo_peak_v": "Over target.tilt; target.distance does not change it."}


def test_the_command_tells_of_cases_without_some_numbers(finished, monkeypatch, capsys):
    _, _, out = finished
    _finish(6, Path(out))
    told = capsys.readouterr()
    assert told.out.startswith("6 of 6 cases succeeded: ")
    assert told.err.startswith("warning: 2 of 6 cases lack some numbers; the first, case 4: range: ")
    monkeypatch.setattr(output, "as_json", True)
    _finish(6, Path(out))
    facts = json.loads(capsys.readouterr().out)
    assert facts["failed"] == {} and list(facts["incomplete"]) == ["4", "5"]
