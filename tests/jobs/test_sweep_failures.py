"""Sweeps whose machines fail: cases that are tried again, workers that do not start, GPUs that are hidden; refusals."""

import json
from concurrent.futures import Executor, Future
from multiprocessing import resource_tracker

import numpy as np
import pytest

import aerokernels
from aerokernels.jobs import store
from aerokernels.jobs.sweeps import records
from aerokernels.jobs.sweeps.definition import define
from aerokernels.jobs.sweeps.run import check_options

SMALL = {"strehl.ray_count": 64, "beam.ray_count": 16, "receiver.ray_count": 16, "receiver.return_factor": "none"}
SCENE = aerokernels.Scene.load("wind-tunnel-static", SMALL)


def test_cases_that_failed_are_tried_again_where_that_is_asked_for(tmp_path):
    """A machine that fails at first, and two cases that make no scene.

    Expected: a dataset although all cases failed; the machine's failure is kept until `retry_failed`, then its place is
    taken; the others fail for their own reason each time, without a worker.
    """
    given: list[int] = []

    class Machine(Executor):
        def __init__(self, outcome):
            self.outcome = outcome

        def submit(self, work, case):
            given.append(case.number)
            done = Future()
            done.set_result(self.outcome)
            return done

    out = tmp_path / "out"

    def swept(**options):
        vary = {"grid.route": ["uniform", "mesh"], "grid.interpolation": ["cubic", "bilinear"]}
        found = aerokernels.sweep(SCENE, vary, out=out, **options)
        assert "grid.interpolation" in str(found.failures.values[0, 1]) and np.isnan(found.strehl.values[0, 1])
        return found

    fails = Machine({"error": "the machine was taken away"})
    works = Machine({"summary": {"range_m": 1.5, "errors": {"range_m": 0.01}}})
    assert str(swept(executor=fails).failures.values[0, 0]) == "the machine was taken away" and given == [0, 3]
    assert swept(executor=works).failed.all() and given == [0, 3]
    for _ in range(2):
        found = swept(executor=works, retry_failed=True)
        assert found.failed.values.tolist() == [[False, True], [True, False]] and given == [0, 3, 0, 3]
        assert found.range_m.values[[0, 1], [0, 1]].tolist() == [1.5, 1.5]
    assert len((out / records.CASES_FILE).read_text().splitlines()) == 4


# Python's tracker of semaphores dies with them, which its finalizer reports.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore:resource_tracker")
def test_workers_that_die_as_they_start(monkeypatch):
    resource_tracker.ensure_running()  # it is started once, with the environment of that time
    monkeypatch.setenv("PYTHONHASHSEED", "none")
    with pytest.raises(RuntimeError, match="worker processes die as they start"):
        aerokernels.sweep(SCENE, {"target.tilt": [0.0]})


@pytest.mark.parametrize(
    ("call", "fault", "told"),
    [
        (lambda: check_options("dask", 2, "tcp://x:1"), ValueError, "workers are started on this machine"),
        (lambda: check_options("local", 0, None), ValueError, "workers = 0: give a whole number of at least 1"),
        (lambda: check_options("local", True, None), ValueError, "workers = True"),
        (lambda: define(SCENE, {"target.tilt": [{}]}), TypeError, "is not a number, text or list"),
        (lambda: define(SCENE, {"target.tilt": [""]}), ValueError, "an empty value"),
        (
            lambda: aerokernels.sweep(SCENE, {}, executor=Executor(), scheduler="tcp://x:1"),
            ValueError,
            "leave scheduler out",
        ),
    ],
)
def test_options_that_do_not_go_together(call, fault, told):
    with pytest.raises(fault, match=told):
        call()


def test_folders_that_results_cannot_go_to(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match=r"file is not a folder; choose another name"):
        store.check_output_folder(tmp_path / "file" / "out")
    with pytest.raises(ValueError, match=r"the folder holds file, and no result of an earlier run"):
        store.check_output_folder(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(store.os, "access", lambda *_: False)
        with pytest.raises(ValueError, match=f"no permission to write in {tmp_path}"):
            store.check_output_folder(tmp_path / "new" / "out")
    (tmp_path / store.MAPS_FILE).write_text("")
    (tmp_path / "summary.json").write_text(json.dumps({"version": "1"}))
    with pytest.raises(ValueError, match=f"the folder holds {store.MAPS_FILE} and more"):
        store.check_output_folder(tmp_path)
    store.check_output_folder(tmp_path, own=(store.MAPS_FILE,))
