"""Sweeps on Dask whose scheduler, client or workers are lost, and two that share a client; workers are threads here."""

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

import aerokernels
from aerokernels.jobs.sweeps import case, dask_cases, dask_workers
from aerokernels.jobs.sweeps.case import Case
from aerokernels.jobs.sweeps.dask_cases import run_dask
from aerokernels.scene import Scene

distributed = pytest.importorskip("distributed")


def cases(group: str, count: int = 4) -> list[Case]:
    return [Case(number, Scene.load("wind-tunnel-static"), group, ()) for number in range(count)]


def never() -> bool:
    return False


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A worker of one thread in this process, at which a case takes a tenth of a second and gives its group."""

    def compute(one: Case) -> dict[str, Any]:
        time.sleep(0.1)
        return {"summary": {"group": one.group}}

    monkeypatch.setattr(case, "compute", compute)
    monkeypatch.setattr(dask_cases, "POLL_INTERVAL", 0.05)
    monkeypatch.setattr(dask_cases, "COUNT_WORKERS_AFTER", 0.2)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as made:
        yield made


def test_two_sweeps_of_one_client_at_once_get_each_its_own_answers(cluster):
    """Processes in containers have one number as well, and share a scheduler."""
    found: dict[str, list] = {}
    with distributed.Client(cluster, set_as_default=False) as client:
        threads = [
            threading.Thread(target=lambda name=name: found.update({name: list(run_dask(client, cases(name), never))}))
            for name in "ab"
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    for name in "ab":
        assert sorted(number for number, _ in found[name]) == [0, 1, 2, 3]
        assert {outcome["summary"]["group"] for _, outcome in found[name]} == {name}


@pytest.mark.parametrize("lost", ["scheduler", "client", "cases"])
def test_cases_that_nobody_computed_have_not_failed(cluster, lost):
    """Set-up: after the first case the scheduler goes, the client closes, or it is restarted, which drops the cases.

    Expected: an error in words, and no outcome for a case that was not computed.
    """
    with distributed.Client(cluster, set_as_default=False) as client:
        outcomes = run_dask(client, cases("a", 50), never)
        _, first = next(outcomes)
        assert first == {"summary": {"group": "a"}}
        if lost == "cases":
            client.restart(wait_for_workers=False)
        else:
            (cluster if lost == "scheduler" else client).close()
        with pytest.raises(RuntimeError, match="scheduler is gone, or its client was closed") as told:
            for _, outcome in outcomes:
                assert outcome == first
        assert "\n" not in str(told.value)


def test_a_sweep_without_workers_says_that_it_waits(cluster):
    """Expected: a warning, and the answers once there are workers again; an error where none will come."""
    with distributed.Client(cluster, set_as_default=False) as client:
        cluster.scale(0)
        while client.nthreads():
            time.sleep(0.01)
        with pytest.raises(RuntimeError, match="all Dask workers of this machine have died"):
            list(run_dask(client, cases("b"), lambda: True))
        outcomes, later = run_dask(client, cases("a"), never), threading.Timer(1.0, cluster.scale, (1,))
        later.start()
        with pytest.warns(UserWarning, match="has no workers: the sweep waits") as told:
            assert len(list(outcomes)) == 4
        later.join()
        assert len(told) == 1


def test_workers_started_here_are_given_up_once_all_have_died_again_and_again(monkeypatch):
    monkeypatch.setattr(dask_workers, "RESTARTS", 1)
    with dask_workers._workers("no address", [{}]) as given_up:
        assert not given_up()
        deadline = time.monotonic() + 100.0
        while not given_up():
            assert time.monotonic() < deadline
            time.sleep(0.1)


def test_executors_that_are_no_clients_are_refused():
    with (
        ThreadPoolExecutor() as pool,
        pytest.raises(TypeError, match=r"a distributed\.Client or a cluster, got Thread"),
    ):
        aerokernels.sweep("wind-tunnel-static", {"target.tilt": [0.0]}, executor=pool)
