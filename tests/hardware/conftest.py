"""Frames to test with."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.frames import EchoFrame


@pytest.fixture
def frames() -> list[EchoFrame]:
    """Twelve frames of different lengths (none, short, longer than a COBS block), with zero bytes and 0xFF in them."""
    random = np.random.default_rng(7)
    found = []
    for sequence in range(12):
        samples = random.integers(-3, 4, size=(0, 1, 5, 126, 127, 300)[sequence % 6]).astype(np.int16)
        found.append(EchoFrame(sequence, 20_000 * sequence, 1000, 2.0**-12, 0.125, samples, flags=sequence))
    return found


@pytest.fixture
def run_code(tmp_path: Path, root: Path) -> Callable[..., "subprocess.CompletedProcess[str]"]:
    """Run Python code in a process of its own, in a folder, the test's by default, which holds temporary files too."""

    def run(code: str, folder: Path = tmp_path) -> "subprocess.CompletedProcess[str]":
        environment = {**os.environ, "PYTHONPATH": str(root), "TMPDIR": str(folder)}
        command = [sys.executable, "-c", code]
        return subprocess.run(command, capture_output=True, encoding="utf-8", cwd=folder, env=environment, timeout=60)

    return run
