"""Which backend "auto" takes, and that it goes on with what there is when OpenCL or Warp is not."""

import re
from dataclasses import replace

import pytest

from aerokernels.tracing import available_backends
from aerokernels.tracing.engines import choice
from aerokernels.tracing.engines.choice import choose_backend
from aerokernels.tracing.engines.info import BackendInfo

from ..opencl_stands import bare_pyopencl, before_path, driver, need_opencl, run_python, vendors

WARP = BackendInfo("warp", "cpu", "2 cores", "1.9", True, True, None, "no CUDA device")
OPENCL = BackendInfo("opencl", "Some CPU", "CPU, 2 compute units", "2026.1", True, True, None, "can")

# What "auto" takes.
CHOICE = (
    "from aerokernels.tracing.engines.choice import choose_backend\nprint(*choose_backend('auto', None), sep='|')\n"
)
# The same, and a trace by it.
AUTO = CHOICE + (
    "import numpy as np\nfrom aerokernels import *\n"
    "field = IndexField.from_samples(np.zeros((9, 9)), origin=(0, 0), spacing=(1e-3, 1e-3), geometry='planar')\n"
    "result = trace(field, RayBundle([[0, 4e-3, -1e-3]], [[0, 0, 1]]))\n"
    "assert result.ok[0], result.status\nprint(result.plan.backend)"
)


def test_opencl_goes_first_where_it_can_trace():
    """The same device every time, first in the list among those of its kind, and the reason in both places."""
    name = need_opencl("cpu").info.device
    backend, device, reason = choose_backend("auto", "cpu")
    assert (backend, device) == ("opencl", name) and "preferred to Warp" in reason
    assert choose_backend("auto", "cpu") == (backend, device, reason)
    on_cpu = [info for info in available_backends() if info.available and "GPU" not in info.description]
    if not any("a GPU is preferred" in info.reason for info in on_cpu):
        assert (on_cpu[0].backend, on_cpu[0].device) == (backend, device) and on_cpu[0].reason in reason
        assert on_cpu[1].reason == "opencl is preferred"


def test_the_list_has_every_backend():
    assert {info.backend for info in available_backends()} == {"warp", "opencl", "reference"}


def test_auto_with_a_name_takes_the_backend_that_has_it():
    name = need_opencl().info.device
    assert choose_backend("auto", name)[:2] == choose_backend("opencl", name)[:2] == ("opencl", name)
    assert choose_backend("opencl", None)[0] == "opencl"
    with pytest.raises(ValueError, match=r"'cuda:7' is not there: backend 'warp' has .*cpu.*'opencl' has") as refused:
        choose_backend("auto", "cuda:7")
    assert name in str(refused.value)
    with pytest.raises(ValueError, match="backend 'opencl' has"):
        choose_backend("opencl", "cuda:7")


def test_auto_without_pyopencl_goes_on_with_warp(tmp_path):
    done = run_python("import sys; sys.modules['pyopencl'] = None\n" + CHOICE, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("warp|")
    assert "pip install" in done.stdout or "cuda" in done.stdout


@pytest.mark.parametrize("broken", ["import", "platform", "float64"])
def test_auto_with_a_broken_opencl_goes_on_with_warp(tmp_path, broken):
    if broken == "import":
        (tmp_path / "shadow" / "pyopencl").mkdir(parents=True)
        (tmp_path / "shadow" / "pyopencl" / "__init__.py").write_text("raise ImportError('libfoo.so')\n")
        settings = {"PYTHONPATH": before_path(tmp_path / "shadow")}
    else:
        drivers = {} if broken == "platform" else {"stand": driver(tmp_path, 0)}
        settings = {"PYTHONPATH": bare_pyopencl(tmp_path), "OCL_ICD_VENDORS": vendors(tmp_path, **drivers)}
    done = run_python(CHOICE, tmp_path, **settings)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("warp|") and done.stderr == ""
    words = {"import": "libfoo", "platform": "no OpenCL platform", "float64": "float64 is missing"}
    assert words[broken] in done.stdout or "cuda" in done.stdout


def test_without_warp_opencl_is_taken(tmp_path):
    need_opencl()
    done = run_python("import sys; sys.modules['warp'] = None\n" + AUTO, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("opencl|") and done.stdout.endswith("\nopencl\n")
    assert "warp-lang" in done.stdout or "a GPU is preferred" in done.stdout


def test_without_either_the_message_has_both_remedies(tmp_path):
    code = (
        "import sys; sys.modules['warp'] = sys.modules['pyopencl'] = None\n"
        "from aerokernels.tracing.engines.choice import *\n"
        "for backend in ('auto', 'warp', 'opencl'):\n"
        "    try: choose_backend(backend, None)\n"
        "    except ValueError as error: print(error)\n"
        "print(*[info.backend for info in available_backends() if info.available])"
    )
    done = run_python(code, tmp_path)
    assert done.returncode == 0, done.stderr
    auto, warp, opencl, there = done.stdout.splitlines()
    assert "pip install warp-lang" in auto and "pip install 'aerokernels[opencl]'" in auto and "reference" in auto
    assert "pip install warp-lang" in warp and "aerokernels[opencl]" in opencl and there == "reference"


def test_the_command_tells_what_auto_takes_and_why(aerokernels, command_line):
    first, second = aerokernels("backends"), command_line("backends")
    assert first.returncode == second.returncode == 0, first.stderr
    sizes = r"\d+(\.\d+)? [KMGT]iB"  # PoCL tells what is free of the memory
    assert re.sub(sizes, "", first.stdout) == re.sub(sizes, "", second.stdout) and "auto chooses" in first.stdout


@pytest.mark.parametrize("of_warp", [True, False], ids=["cuda", "opencl"])
def test_a_gpu_goes_before_a_cpu(monkeypatch, of_warp):
    """Whichever backend has it, and though a backend that has none is preferred on the CPU; it leads the list too."""
    gpu = replace(WARP, device="cuda:0") if of_warp else replace(OPENCL, device="Some GPU", description="GPU, a driver")
    warp, opencl = [WARP, *([gpu] if of_warp else [])], [OPENCL, *([] if of_warp else [gpu])]
    monkeypatch.setattr(choice, "_warp_devices", lambda **options: warp)
    monkeypatch.setattr(choice, "_opencl_devices", lambda: opencl)
    assert choose_backend("auto", None)[:2] == choose_backend("auto", "gpu")[:2] == (gpu.backend, gpu.device)
    assert choose_backend("auto", "cpu")[:2] == (OPENCL.backend, OPENCL.device)
    listed = available_backends()
    assert listed[0].device == gpu.device
    assert [info.reason for info in listed[1:3]] == ["a GPU is preferred"] * 2


@pytest.mark.gpu
def test_the_choice_of_a_backend_asks_no_gpu_for_its_memory(monkeypatch):
    """Every trace by "auto" chooses: where Warp has no context open, the question took 0.17 s. `backends` asks it."""
    import warp as wp

    if not wp.is_cuda_available():
        pytest.skip("no CUDA device here")

    def asked(device):
        raise AssertionError(f"the memory of {device} was asked for")

    monkeypatch.setattr(type(wp.get_device("cuda:0")), "total_memory", property(asked))
    assert choose_backend("auto", None)[1] != "cpu"
    with pytest.raises(AssertionError, match="was asked for"):
        available_backends()
