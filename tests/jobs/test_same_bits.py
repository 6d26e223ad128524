"""The same scene gives the same bits in result.nc, in another process and on another number of threads."""

import os
import subprocess
import sys
from pathlib import Path

from .small_scene import SMALL_SCENE

SCENE = f"""{SMALL_SCENE}
detector.noise = true
detector.bandwidth = "100 MHz"
"""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POCL_MAX_PTHREAD_COUNT")


def test_two_processes_write_the_same_bits(tmp_path: Path):
    """Times of the clock are the file's only other content: SOURCE_DATE_EPOCH fixes the one that it holds."""
    (tmp_path / "small.toml").write_text(SCENE, encoding="utf-8")
    code = (
        "import sys; from pathlib import Path; import aerokernels as ak; "
        "from aerokernels.jobs.store import write_result; "
        "write_result(Path(sys.argv[1]), ak.simulate('small.toml').to_xarray())"
    )
    written = []
    for threads in ("1", "3"):
        environment = {**os.environ, **dict.fromkeys(THREADS, threads), "SOURCE_DATE_EPOCH": "1000000000"}
        done = subprocess.run(
            [sys.executable, "-c", code, f"result{threads}.nc"],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            encoding="utf-8",
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        written.append((tmp_path / f"result{threads}.nc").read_bytes())
    assert len(written[0]) > 10_000 and written[0] == written[1]
