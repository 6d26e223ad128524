"""Sweeps on Dask whose scheduler or client is lost, two that share a client, and other executors of the caller."""

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

import aerokernels
from aerokernels.jobs.sweeps import case
from aerokernels.jobs.sweeps.case import Case
from aerokernels.jobs.sweeps.executors import outcomes
from aerokernels.scene import Scene

distributed = pytest.importorskip("distributed")


def computed(executor: Any, group: str, count: int = 4, scheduler: Any = None) -> Iterator[tuple[int, dict]]:
    """Outcomes of cases of a group."""
    cases = [Case(number, Scene.load("wind-tunnel-static"), group, ()) for number in range(count)]
    started = outcomes(cases, executor, None, scheduler, set())
    next(started)
    return started


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A worker of one thread in this process, at which a case takes a tenth of a second and gives its group."""

    def compute(one: Case) -> dict[str, Any]:
        time.sleep(0.1)
        return {"summary": {"group": one.group}}

    monkeypatch.setattr(case, "compute", compute)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as made:
        yield made


def test_two_sweeps_of_one_client_at_once_get_each_its_own_answers(cluster):
    answers: dict[str, list] = {}
    with distributed.Client(cluster, set_as_default=False) as client:

        def run(name: str) -> None:
            answers[name] = list(computed("dask", name, scheduler=client))

        threads = [threading.Thread(target=run, args=name) for name in "ab"]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    for name in "ab":
        assert sorted(number for number, _ in answers[name]) == [0, 1, 2, 3]
        assert {outcome["summary"]["group"] for _, outcome in answers[name]} == {name}


@pytest.mark.parametrize("lost", ["scheduler", "client"])
def test_cases_that_nobody_computed_have_not_failed(cluster, lost):
    """After the first case the scheduler goes or the client closes: an error in words, and no outcome for the rest."""
    with distributed.Client(cluster, set_as_default=False) as client:
        some = computed("dask", "a", 50, scheduler=client)
        _, first = next(some)
        assert first == {"summary": {"group": "a"}}
        (cluster if lost == "scheduler" else client).close()
        with pytest.raises(RuntimeError, match="scheduler is gone, or its client was closed") as told:
            for _, outcome in some:
                assert outcome == first
        assert "\n" not in str(told.value)


def test_any_executor_computes_cases(cluster):
    with ThreadPoolExecutor(2) as pool:
        assert sorted(number for number, _ in computed(pool, "a")) == [0, 1, 2, 3]
        some = computed(pool, "a", 50)
        next(some)
        pool.shutdown(wait=False, cancel_futures=True)
        with pytest.raises(RuntimeError, match="the executor was shut down"):
            list(some)
    with pytest.raises(TypeError, match=r"a distributed\.Client or a cluster, got int"):
        aerokernels.sweep("wind-tunnel-static", {"target.tilt": [0.0]}, executor=3)
