"""What tests of tracing share."""

import pytest

from tests.moved_air import CHANGES, Moved


@pytest.fixture(params=list(CHANGES))
def changed(request: pytest.FixtureRequest) -> Moved:
    """Each way of moving, mirroring or turning air and rays together."""
    return CHANGES[request.param]
