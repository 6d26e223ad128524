"""Kernel sources: found, expanded, built once, and built again when a header changes."""

import shutil
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from aerokernels.tracing.engines.opencl.program import (
    WORK_GROUP,
    build,
    build_options,
    expand,
    kernel_folder,
)

from ..opencl_stands import need_opencl, run_python

KERNEL = """// Writes FACTOR times the item's number.
#include "factor.h"
#include "twice.h"

__kernel void fill(__global float *out) { out[get_global_id(0)] = twice(FACTOR) * get_global_id(0); }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A kernel folder: fill.cl and two headers, one of which includes the other."""
    place = tmp_path / "sources"
    (place / "include").mkdir(parents=True)
    (place / "fill.cl").write_text(KERNEL)
    (place / "include" / "factor.h").write_text("#define FACTOR 3.0f\n")
    (place / "include" / "twice.h").write_text(
        '#include "factor.h"  // already there\ninline float twice(float x) { return 2.0f * x; }\n'
    )
    return place


def opened():
    """A session on the best device."""
    from aerokernels.tracing.engines.opencl.devices import session

    return session(need_opencl().info.device)


def filled(program, count: int = WORK_GROUP) -> np.ndarray:
    """What the kernel `fill` writes."""
    import pyopencl as cl

    on = opened()
    out = np.empty(count, np.float32)
    buffer = cl.Buffer(on.context, cl.mem_flags.WRITE_ONLY, out.nbytes)
    cl.Kernel(program, "fill")(on.queue, (count,), (WORK_GROUP,), buffer)
    cl.enqueue_copy(on.queue, out, buffer)
    return out


def test_headers_are_written_in_place_once(folder):
    text = expand("fill.cl", folder)
    assert text.count("#define FACTOR") == 1 and text.count("float twice(") == 1 and "#include" not in text
    assert text.index("#define FACTOR") < text.index("float twice(") < text.index("__kernel")


def test_a_missing_header_is_named(folder):
    (folder / "include" / "factor.h").unlink()
    with pytest.raises(RuntimeError, match=r"fill\.cl, line 2: header 'factor\.h' is not below"):
        expand("fill.cl", folder)


def test_the_sources_of_this_checkout_are_found(root: Path):
    assert kernel_folder() == root / "kernels"
    for path in kernel_folder().glob("*.cl"):
        assert "#include" not in expand(path.name)


@pytest.mark.slow
def test_installed_sources_are_found_and_missing_ones_name_both_places(root: Path, tmp_path: Path):
    """The package where a wheel would put it: kernels inside; then without them."""
    shutil.copytree(
        root / "aerokernels", tmp_path / "aerokernels", ignore=shutil.ignore_patterns("__pycache__", "data")
    )
    shutil.copytree(root / "kernels", tmp_path / "aerokernels" / "kernels")
    code = "from aerokernels.tracing.engines.opencl.program import *\nprint(kernel_folder())"
    done = run_python(code, tmp_path, PYTHONPATH=str(tmp_path))
    assert done.stdout.strip() == str(tmp_path / "aerokernels" / "kernels"), done.stderr
    shutil.rmtree(tmp_path / "aerokernels" / "kernels")
    done = run_python(code, tmp_path, PYTHONPATH=str(tmp_path))
    assert done.returncode == 1 and "install aerokernels again" in done.stderr
    assert str(tmp_path / "aerokernels" / "kernels") in done.stderr and str(tmp_path / "kernels") in done.stderr


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"precision": "float16"}, "float32"),
        ({"geometry": "sphere"}, "geometry 'sphere'.*axisymmetric"),
        ({"method": "auto"}, "method 'auto'.*adaptive"),
    ],
)
def test_unknown_options_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        build_options(**wrong)


def test_a_program_is_built_once_and_runs(folder):
    built = []
    on = opened()
    threads = [threading.Thread(target=lambda: built.append(build(on, "fill.cl", (), folder))) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(built) == 6 and all(program is built[0] for program in built)
    assert np.array_equal(filled(built[0]), 6.0 * np.arange(WORK_GROUP))
    assert build(on, "fill.cl", ("-DOTHER=1",), folder) is not built[0]


def test_a_build_failure_names_file_line_and_options(folder):
    (folder / "include" / "twice.h").write_text("\n\ninline float twice(float x) { return nonsense; }\n")
    with pytest.raises(RuntimeError, match=r"fill\.cl does not build") as refused:
        build(opened(), "fill.cl", ("-DSOME=1",), folder)
    text = str(refused.value)
    assert "include/twice.h:3" in text and "nonsense" in text and "-DSOME=1" in text


def test_warnings_of_the_compiler_stay_away_from_users(folder, capfd, recwarn):
    """A program that its compiler warns of builds without a word in Python or on stderr; its name is in no cache."""
    text = f"#warning look here\ninline float twice(float x) {{ int y; return x; }}  // {folder}\n"
    (folder / "include" / "twice.h").write_text(text)
    assert filled(build(opened(), "fill.cl", (), folder))[1] == 3.0
    assert capfd.readouterr() == ("", "") and not recwarn.list


BUILD = (
    "import os, pathlib, numpy as np\n"
    "from aerokernels.tracing.engines.opencl.devices import import_pyopencl, session\n"
    "from aerokernels.tracing.engines.opencl.program import *\n"
    "cl = import_pyopencl()\n"
    "on = session(); out = np.empty(128, np.float32)\n"
    "program = build(on, 'fill.cl', (), pathlib.Path(os.environ['SOURCES']))\n"
    "buffer = cl.Buffer(on.context, cl.mem_flags.WRITE_ONLY, out.nbytes)\n"
    "cl.Kernel(program, 'fill')(on.queue, (128,), (64,), buffer)\n"
    "cl.enqueue_copy(on.queue, out, buffer); print(out[1])"
)


def test_a_second_process_builds_nothing_and_a_changed_header_something(folder, tmp_path):
    """What the drivers and PyOpenCL keep on disk: the same after a second process, more after a header has changed."""
    if "PoCL" not in need_opencl().info.description or not sys.platform.startswith("linux"):
        pytest.skip("the folder where this driver keeps programs is not known")
    cache = tmp_path / "cache"
    cache.mkdir()

    def run() -> tuple[str, dict[Path, int]]:
        done = run_python(
            BUILD, tmp_path, SOURCES=str(folder), POCL_CACHE_DIR=str(cache), XDG_CACHE_HOME=str(tmp_path / "xdg")
        )
        assert done.returncode == 0, done.stderr
        # PoCL leaves lock files and marks when it last used a program: only what holds code counts.
        kept = {path for path in cache.rglob("*") if path.suffix in (".bc", ".so")}
        return done.stdout.strip(), {path: path.stat().st_mtime_ns for path in kept}

    first, second = run(), run()
    assert first[0] == "6.0" and first[1] and second == first
    (folder / "include" / "factor.h").write_text("#define FACTOR 4.0f\n")
    third = run()
    assert third[0] == "8.0" and set(third[1]) > set(first[1])


def blocked(folder: Path) -> str:
    """A folder that cannot be made, not even by root."""
    (folder / "file").write_text("no folder")
    return str(folder / "file" / "cache")


def test_a_cache_of_pyopencl_that_cannot_be_written_does_not_stop_a_launch(folder, tmp_path):
    need_opencl()
    settings = {"SOURCES": str(folder), "XDG_CACHE_HOME": blocked(tmp_path), "POCL_CACHE_DIR": str(tmp_path)}
    done = run_python(BUILD, tmp_path, **settings)
    assert (done.returncode, done.stdout, done.stderr) == (0, "6.0\n", "")


def test_pocl_without_a_place_for_its_cache_gets_one_of_the_process(folder, tmp_path):
    if "PoCL" not in need_opencl().info.description:
        pytest.skip("no PoCL here")
    done = run_python(BUILD, tmp_path, SOURCES=str(folder), POCL_CACHE_DIR=blocked(tmp_path))
    assert done.returncode == 0 and "cannot be written" in done.stderr and "kernels are built in" in done.stderr
