"""The fixture by which a test compares the answers of a case with its record, or writes the record."""

from collections.abc import Callable
from typing import Any

import pytest

from .records import NUDGE, RECORDS, TRIES, Nudge, changed, differences, read, write, written
from .watch import watched

Case = Callable[[Nudge], Any]


@pytest.fixture
def answers(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Run a case and compare what the functions of the core answer in it with the record of the test.

    A case takes a `Nudge`, which changes the inputs a little where the record is written (`--record`).
    """
    stages = request.module.STAGES
    path = RECORDS / f"{request.path.stem.removeprefix('test_')}.json"
    name = request.node.name.removeprefix("test_")

    def check(case: Case, nudge: float = NUDGE) -> None:
        found = watched(lambda: case(Nudge()), stages)
        before = read(path)
        if not request.config.getoption("--record"):
            assert name in before, f"no record of {name} in {path.name}: write it by --record"
            lines = differences(before[name], found)
            assert not lines, "\n".join([f"{len(lines)} answers changed; --record if on purpose", *lines[:40]])
            return
        assert not hasattr(request.config, "workerinput"), "write records in one process: leave out -n"
        others = [watched(lambda seed=seed: case(Nudge(nudge, seed)), stages) for seed in range(TRIES)]
        record = written(found, others, nudge)
        reporter = request.config.pluginmanager.getplugin("terminalreporter")
        for line in changed(before.get(name, {}), record):
            reporter.write_line(f"{name}: {line}")
        write(path, {**before, name: record})

    return check
