"""What tests of tracing share."""

import pytest

from aerokernels.tracing.leapfrog import pilot
from tests.moved_air import CHANGES, Moved


@pytest.fixture(autouse=True)
def small_bundles_are_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some thousand rays are sampled evenly, as a million would be: a test of samples need not trace a million."""
    monkeypatch.setattr(pilot, "EVALUATIONS_OF_NODE", {False: 0.0, True: 0.0})


@pytest.fixture(params=list(CHANGES))
def changed(request: pytest.FixtureRequest) -> Moved:
    """Each way of moving, mirroring or turning air and rays together."""
    return CHANGES[request.param]
