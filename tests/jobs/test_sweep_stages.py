"""What a process keeps from one case of a sweep to the next, and in which order cases come."""

import numpy as np
import pytest

from aerokernels import simulate
from aerokernels.jobs.sweeps.case import Stages, make_cases
from aerokernels.jobs.sweeps.executors import worker_environments
from aerokernels.scene import Scene

SMALL = {
    "strehl.ray_count": 1024,
    "beam.ray_count": 16,
    "receiver.ray_count": 16,
    "receiver.return_factor": "none",
    "grid.spacing": "0.4 mm",
}


def scene(**changes) -> Scene:
    return Scene.load("wind-tunnel-mach3", {**SMALL, **{key.replace("__", "."): v for key, v in changes.items()}})


def test_tilts_share_flow_index_and_strehl_ratio():
    """Two tilts of two receivers: one flow, one index field, a Strehl ratio a receiver, and four echoes."""
    scenes = [
        scene(receiver__diameter=diameter, target__tilt=tilt)
        for diameter in ("10 mm", "12 mm")
        for tilt in ("0 deg", "20 deg")
    ]
    stages = Stages()
    found = [stages.run(case).summary for case in make_cases(scenes)]
    assert stages.counts == {"flow": 1, "index": 1, "strehl": 2, "echo": 4}
    assert found[0]["strehl"] == found[1]["strehl"]
    assert found[0]["range_m"] != found[1]["range_m"]
    alone = simulate(scenes[3]).summary
    for key in ("strehl", "opd_rms_m", "echo_peak_v", "range_m"):  # far within the error that it reports
        assert abs(found[3][key] - alone[key]) < 0.3 * alone["errors"][key], key


def test_another_wavelength_takes_the_flow_and_another_density_does_not():
    stages = Stages()
    scenes = [scene(), scene(flow__wavelength="532 nm"), scene(flow__density="sea-level")]
    found = {case.number: stages.run(case) for case in make_cases(scenes)}
    assert stages.counts == {"flow": 2, "index": 3, "strehl": 3, "echo": 3}
    flows = [found[number].prepared.density for number in (0, 2)]
    assert flows[0] is not flows[1] and flows[0].mesh is flows[1].mesh and flows[0].body is flows[1].body
    (case,) = make_cases(scenes[2:])
    alone, shared = (run.summary for run in (Stages().run(case), found[2]))
    assert all(repr(alone[key]) == repr(shared[key]) for key in ("strehl", "opd_rms_m", "range_m", "errors"))


def test_each_worker_has_a_gpu_of_its_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("aerokernels.jobs.sweeps.executors.visible_gpus", lambda: ["0", "3"])
    places = [one["CUDA_VISIBLE_DEVICES"] for one in worker_environments(None, 10, {None})]
    assert places == ["0", "3"]
    assert [one["CUDA_VISIBLE_DEVICES"] for one in worker_environments(4, 10, {None})] == ["0", "3", "0", "3"]
    assert all("CUDA_VISIBLE_DEVICES" not in one for one in worker_environments(2, 10, {"cpu"}))
    assert len(worker_environments(None, 1, {None})) == 1
    monkeypatch.setattr("aerokernels.jobs.sweeps.executors.visible_gpus", list)
    assert 1 <= len(worker_environments(None, 100, {None})) <= 8
    assert np.prod([len(one) for one in worker_environments(1, 10, {None})]) == 0
