"""Kernel caches cut short, zeroed or overwritten, and a PATH without a linker: for real, in processes of their own.

PoCL ends the process by a signal for the first kinds and for the last, so that the exit status is what shows it.
"""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aerokernels.tracing.engines.opencl.pocl import CHECKED, remove_damaged

from ..opencl_stands import need_opencl, run_python

pytestmark = pytest.mark.slow

LAUNCH = (
    "import numpy as np\n"
    "from aerokernels.tracing.engines.opencl.devices import import_pyopencl, session\n"
    "from aerokernels.tracing.engines.opencl.engine import Engine\n"
    "from aerokernels.tracing.engines.opencl.session import Kernel\n"
    "cl, on = import_pyopencl(), Engine(None)\n"
    "source = '__kernel void fill(int a, int b, __global float *x) { x[get_global_id(0)] = 3.0f; }'\n"
    "program = on.session.programs['fill'] = cl.Program(on.session.context, source).build(list(on.session.options))\n"
    "buffer, out = on.empty(64, kind=np.float32), np.zeros(64, np.float32)\n"
    "on.launch(Kernel(on.session, program, 'fill'), [], [buffer], 64)\n"
    "on.get(buffer, out); print(out[5])\n"
)


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> Path:
    """The caches of PoCL and PyOpenCL after one launch of one kernel."""
    if "PoCL" not in need_opencl().info.description or not sys.platform.startswith("linux"):
        pytest.skip("no PoCL here")
    place = tmp_path_factory.mktemp("caches")
    assert launched(place) == ""
    return place


def launched(place: Path) -> str:
    """Launch a kernel with the caches in a folder; what stands on stderr."""
    done = run_python(LAUNCH, place, XDG_CACHE_HOME=str(place), POCL_CACHE_DIR=str(place / "pocl"))
    assert (done.returncode, done.stdout) == (0, "3.0\n"), (done.returncode, done.stderr)
    return done.stderr


def cut(path: Path) -> None:
    with open(path, "r+b") as file:
        file.truncate(path.stat().st_size // 3)


def zero_the_end(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2] + bytes(len(content) - len(content) // 2))


@pytest.mark.parametrize("damage", [cut, zero_the_end])
@pytest.mark.parametrize("kind", ["*.bc", "*.so"])
def test_damaged_programs_are_found_and_removed_with_their_folder(filled, tmp_path, damage, kind):
    cache = tmp_path / "pocl"
    shutil.copytree(filled / "pocl", cache)
    programs = {path.parent for path in cache.rglob("program.bc")}
    assert remove_damaged(cache) == [] and len(programs) == 1
    for path in [*cache.rglob(kind)]:
        damage(path)
        os.utime(path, (time.time() - 5.0,) * 2)  # no longer being written
    os.utime(cache / CHECKED, (0.0, 0.0))
    removed = remove_damaged(cache)
    assert removed and set(removed) <= programs and not any(path.exists() for path in removed)
    assert remove_damaged(cache) == []


def test_a_process_with_damaged_caches_says_so_once_and_goes_on(filled, tmp_path):
    """Bitcode and library cut: SIGABRT or SIGBUS without the check."""
    place = tmp_path / "caches"
    shutil.copytree(filled, place)
    for path in [*place.rglob("*.so"), *place.rglob("*.bc")]:
        cut(path)
    said = launched(place)
    assert said.count("RuntimeWarning") == 1 and "had a program with damaged files" in said
    assert launched(place) == ""


@pytest.mark.parametrize("linker", ["none", "without its libraries"])
def test_without_a_linker_auto_takes_warp_and_says_why(tmp_path, linker):
    """As on a machine with Debian's binutils and no compiler of C, where PoCL ends the process at its first kernel."""
    if "PoCL" not in need_opencl().info.description or not sys.platform.startswith("linux"):
        pytest.skip("no PoCL here")
    if linker != "none":
        (tmp_path / "ld").write_text("#!/bin/sh\necho cannot find -lc >&2\nexit 1\n")
        (tmp_path / "ld").chmod(0o755)
    code = "from aerokernels.tracing.engines.choice import choose_backend; print(choose_backend('auto', 'cpu'))"
    caches = {"XDG_CACHE_HOME": str(tmp_path), "POCL_CACHE_DIR": str(tmp_path / "pocl")}
    done = run_python(code, tmp_path, PATH=str(tmp_path), **caches)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("('warp', 'cpu'") and "apt install gcc" in done.stdout and not done.stderr
    reason = "no `ld` on PATH" if linker == "none" else "not find the libraries of GCC"
    assert reason in done.stdout


@pytest.mark.parametrize("backend", ["warp", "opencl"])
def test_a_home_that_takes_no_files_gives_the_process_caches_of_its_own(backend, tmp_path):
    """As for a user of a service whose home is /nonexistent: both engines trace, say where kernels are, and tidy up."""
    if backend == "opencl" and "PoCL" not in need_opencl().info.description:
        pytest.skip("no PoCL here")
    code = (
        f"from aerokernels.tracing.engines.choice import choose_backend; print(choose_backend({backend!r}, 'cpu')[:1])"
    )
    nowhere = {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null/caches", "POCL_CACHE_DIR": ""}
    done = run_python(code, tmp_path, TMPDIR=str(tmp_path), PYOPENCL_NO_CACHE="1", **nowhere)
    assert done.returncode == 0 and done.stdout == f"('{backend}',)\n", done.stderr
    assert "kernels are built in" in done.stderr and not list(tmp_path.iterdir())


def test_a_full_disk_gives_the_process_a_cache_of_its_own(tmp_path, monkeypatch):
    from aerokernels.process import quiet_warp
    from aerokernels.tracing.engines.opencl import pocl

    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    real, full = shutil.disk_usage, shutil.disk_usage(tmp_path)._replace(free=0)
    monkeypatch.setattr(quiet_warp.shutil, "disk_usage", lambda folder: full if folder == tmp_path else real(folder))
    with pytest.warns(RuntimeWarning, match="is full: kernels are built in"):
        pocl.make_safe()
    assert pocl.cache_folder() != tmp_path and pocl.cache_folder().is_dir()
    pocl.cache_folder().rmdir()


def test_what_a_crash_left_of_warps_kernels_is_compiled_again(tmp_path: Path):
    """Set-up: a whole module, one being made, and five that are not whole. Expected: those five go, and no other."""
    from aerokernels.process.quiet_warp import remove_damaged

    contents = {"wp_whole": b"{}", "wp_made_p12_t34": b"", "wp_empty": b"", "wp_list": b"[]", "wp_bytes": b"\xff",
                "wp_deep": b"[" * 100_000}  # fmt: skip
    for name, described in contents.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.meta").write_bytes(described)
        (tmp_path / name / f"{name}.o").write_bytes(b"code")
    # Code of 64 bits cut short: a header that places its table of sections beyond the end. It failed at a later launch.
    (tmp_path / "wp_cut").mkdir()
    (tmp_path / "wp_cut" / "wp_cut.o").write_bytes(
        b"\x7fELF\x02".ljust(40, b"\1") + (5000).to_bytes(8, "little") + bytes(952)
    )
    removed = {path.name for path in remove_damaged(tmp_path)}
    assert removed == {"wp_empty", "wp_list", "wp_bytes", "wp_deep", "wp_cut"}
    assert {path.name for path in tmp_path.iterdir()} == {"wp_whole", "wp_made_p12_t34"}
    assert remove_damaged(tmp_path / "none") == []
    # And where Warp itself keeps its kernels: a module without a byte is gone once it has started.
    code = (
        "import sys, warp as wp; from pathlib import Path; wp.config.kernel_cache_dir = sys.argv[1]\n"
        "from aerokernels.process.quiet_warp import start_warp; start_warp()\n"
        "print(sorted(path.name for path in Path(wp.config.kernel_cache_dir).iterdir()))\n"
    )
    (tmp_path / "wp_whole" / "wp_whole.o").write_bytes(b"")
    done = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, encoding="utf-8", timeout=120)
    assert done.returncode == 0 and "wp_whole" not in done.stdout, done.stderr
