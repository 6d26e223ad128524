"""What every test may ask for."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# Processes that tests start, in other folders, take this checkout too where it is not installed.
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
# Where a test leaves the backend to "auto", it is the same one in every run; tests of OpenCL ask for it by name.
os.environ.setdefault("AEROKERNELS_CPU_BACKEND", "warp")
os.environ.setdefault("AEROKERNELS_GPU_BACKEND", "warp")


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture
def aerokernels(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command line in a process of its own, in an empty folder: `aerokernels("run", scene, "--out", out)`."""

    def run(*arguments: object, timeout: float = 300.0) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "aerokernels", *map(str, arguments)],
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=timeout,
        )

    return run
