"""Machines on which the usual folders for kernels cannot be used: full, read-only, or named in another encoding."""

import pytest

from ..opencl_stands import need_opencl, run_python

pytestmark = pytest.mark.slow

# Free space and rights as Python sees them, in place of a full or read-only disk, which only root can mount.
STAND = """
import os
from pathlib import Path
from aerokernels.process import quiet_warp
real = quiet_warp.why_unusable
def why_unusable(folder):
    return f"the disk of {folder} is full" if any(str(folder).startswith(one) for one in %r) else real(folder)
quiet_warp.why_unusable = why_unusable
"""
START = """
from aerokernels.process.quiet_warp import start_warp
import warp as wp
start_warp()
print(wp.config.kernel_cache_dir)
"""
CHOOSE = "from aerokernels.tracing.engines.choice import choose_backend; print(choose_backend({!r}, 'cpu')[0])\n"


def test_a_full_disk_gives_warp_a_cache_of_its_own(tmp_path):
    """It ended in an OSError from Warp."""
    full, temporary = tmp_path / "full", tmp_path / "temporary"
    temporary.mkdir()
    places = {"WARP_CACHE_PATH": str(full), "TMPDIR": str(temporary)}
    done = run_python(STAND % [str(full)] + START, tmp_path, **places)
    assert done.stdout.startswith(str(temporary)), done.stderr
    assert "is full: kernels are built in" in done.stderr and not list(temporary.iterdir())


@pytest.mark.parametrize("backend", ["warp", "opencl", "auto"])
def test_where_no_folder_takes_kernels_a_sentence_says_what_to_set(backend, tmp_path):
    """PoCL and LLVM ended the process by SIGABRT, and Warp raised an error of its own."""
    if backend == "opencl" and "PoCL" not in need_opencl().info.description:
        pytest.skip("no PoCL here")
    places = dict.fromkeys(("XDG_CACHE_HOME", "POCL_CACHE_DIR", "WARP_CACHE_PATH", "TMPDIR"), str(tmp_path))
    start = "from aerokernels.process.quiet_warp import start_warp; start_warp()\n" if backend == "auto" else ""
    done = run_python(STAND % [str(tmp_path)] + CHOOSE.format(backend) + start, tmp_path, **places)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "is full" in last and "set TMPDIR to a folder" in last, done.stderr


def test_a_variable_that_is_empty_leaves_pocl_its_cache(tmp_path):
    """PoCL took "" for a folder's name, and the message asked for a variable that was set."""
    if "PoCL" not in need_opencl().info.description:
        pytest.skip("no PoCL here")
    places = {"POCL_CACHE_DIR": "", "XDG_CACHE_HOME": "", "HOME": str(tmp_path)}
    done = run_python(CHOOSE.format("opencl"), tmp_path, PYOPENCL_NO_CACHE="1", **places)
    assert (done.returncode, done.stdout) == (0, "opencl\n"), done.stderr
    assert (tmp_path / ".cache" / "pocl" / "kcache").is_dir()


def test_a_kernel_that_cannot_be_written_names_the_cache_and_the_remedy():
    """As with `ulimit -f`, or a disk that fills while the process runs: only "[Errno 27] File too large" before."""
    from aerokernels.device_arrays import launching
    from aerokernels.process.quiet_warp import NoCacheError, start_warp

    class Module:
        def load(self, device, block_size):
            raise OSError(launching.errno.EFBIG, "File too large")

    start_warp()
    with pytest.raises(NoCacheError, match=r"File too large.*ulimit -f.*WARP_CACHE_PATH"):
        launching.load_module(Module(), "cpu", 1)
