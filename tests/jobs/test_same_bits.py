"""The same scene gives the same bits in result.nc, in another process and on another number of threads."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from aerokernels.jobs.run import simulate
from aerokernels.jobs.store import write_result

from .small_scene import SMALL_SCENE

SCENE = f"""{SMALL_SCENE}
detector.noise = true
detector.bandwidth = "100 MHz"
"""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POCL_MAX_PTHREAD_COUNT")


def test_two_processes_write_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """This process on the threads that it has (the suite gives linear algebra one), and another on three.

    Times of the clock are the file's only other content: SOURCE_DATE_EPOCH fixes the one that it holds.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")
    Path("small.toml").write_text(SCENE, encoding="utf-8")
    write_result(Path("here.nc"), simulate("small.toml").to_xarray())
    code = (
        "from pathlib import Path; import aerokernels as ak; "
        "from aerokernels.jobs.store import write_result; "
        "write_result(Path('there.nc'), ak.simulate('small.toml').to_xarray())"
    )
    environment = {**os.environ, **dict.fromkeys(THREADS, "3")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, encoding="utf-8", timeout=300
    )
    assert done.returncode == 0, done.stderr
    here, there = Path("here.nc").read_bytes(), Path("there.nc").read_bytes()
    assert len(here) > 10_000 and here == there
