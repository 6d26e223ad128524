"""The writers beside these tests are modules of their own; and where files are read."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def readers_child() -> None:
    """Files are read as users' are, in a child: for damaged ones, on which a library may end its process."""


@pytest.fixture(autouse=True)
def where_files_are_read(request: pytest.FixtureRequest) -> None:
    """In this process, but for tests that ask for the child."""
    if "readers_child" not in request.fixturenames:
        request.getfixturevalue("readers_here")
