"""Which backend "auto" takes, and that it goes on with what there is when OpenCL or Warp is not."""

import json
import math
from dataclasses import replace

import pytest

from aerokernels.tracing import available_backends, device_choice
from aerokernels.tracing.backend_info import BackendInfo
from aerokernels.tracing.backends import choose_backend
from aerokernels.tracing.device_choice import MARGIN, NOT_MEASURED, faster_of, remembered_choice

from .opencl_stands import bare_pyopencl, before_path, driver, need_opencl, run_python, vendors

WARP = BackendInfo("warp", "cpu", "2 cores", "1.9", True, True, None, "no CUDA device")
OPENCL = BackendInfo("opencl", "Some CPU", "CPU, 2 compute units", "2026.1", True, True, None, "can")

# Takes "auto" and traces with it.
AUTO = (
    "import numpy as np\nfrom aerokernels.tracing.backends import choose_backend\nfrom aerokernels import *\n"
    "print(*choose_backend('auto', None), sep='|')\n"
    "field = IndexField.from_samples(np.zeros((9, 9)), origin=(0, 0), spacing=(1e-3, 1e-3), geometry='planar')\n"
    "result = trace(field, RayBundle([[0, 4e-3, -1e-3]], [[0, 0, 1]]))\n"
    "assert result.ok[0], result.status\nprint(result.plan.backend)"
)


class Speeds:
    """Measured speeds, and what was asked."""

    def __init__(self, **rates):
        """Rays per second of each backend; an exception is raised."""
        self.rates, self.asked = rates, []

    def __call__(self, backend, device):
        """As `rays_per_second`."""
        self.asked.append((backend, device))
        rate = self.rates[backend]
        if isinstance(rate, Exception):
            raise rate
        return rate


@pytest.fixture(autouse=True)
def measuring(monkeypatch):
    """These tests are about what is measured."""
    for variable in ("AEROKERNELS_CPU_BACKEND", "AEROKERNELS_GPU_BACKEND"):
        monkeypatch.delenv(variable, raising=False)


@pytest.fixture
def forgetful(tmp_path, monkeypatch):
    """An empty cache folder, and a function that forgets what the process has in memory."""
    monkeypatch.setenv("AEROKERNELS_CACHE_DIR", str(tmp_path / "cache"))

    def forget():
        monkeypatch.setattr(device_choice, "_in_memory", {})
        monkeypatch.setattr(device_choice, "_failures", {})

    forget()
    return forget


@pytest.mark.parametrize(
    ("ratio", "backend"), [(5.0, "opencl"), (1.001 * MARGIN, "opencl"), (0.999 * MARGIN, "warp"), (0.2, "warp")]
)
def test_the_faster_is_taken_and_the_ratio_told(forgetful, ratio, backend):
    choice = faster_of(WARP, OPENCL, Speeds(warp=1e5, opencl=ratio * 1e5))
    assert (choice.backend, choice.device) == (backend, {"warp": "cpu", "opencl": "Some CPU"}[backend])
    assert f"{ratio:.2f} times" in choice.reason


def test_it_is_measured_once_for_all_processes(forgetful):
    speeds = Speeds(warp=1e5, opencl=3e5)
    assert remembered_choice(WARP, OPENCL) is None
    first = faster_of(WARP, OPENCL, speeds)
    assert faster_of(WARP, OPENCL, speeds) == first
    forgetful()  # as a new process would
    assert faster_of(WARP, OPENCL, speeds) == first == remembered_choice(WARP, OPENCL)
    assert sorted(speeds.asked) == [("opencl", "Some CPU"), ("warp", "cpu")]


@pytest.mark.parametrize("which", ["version", "description"])
def test_another_version_or_device_is_measured_anew(forgetful, which):
    faster_of(WARP, OPENCL, Speeds(warp=1e5, opencl=3e5))
    for warp, opencl in ((replace(WARP, **{which: "new"}), OPENCL), (WARP, replace(OPENCL, **{which: "new"}))):
        assert remembered_choice(warp, opencl) is None
        assert faster_of(warp, opencl, Speeds(warp=1e5, opencl=1e4)).backend == "warp"
    assert faster_of(WARP, OPENCL, Speeds()).backend == "opencl"  # the first is remembered still


@pytest.mark.parametrize("rate", [RuntimeError("does not build"), KeyError("x"), math.nan, 0.0])
def test_a_failure_takes_warp_and_is_tried_again_by_the_next_process(forgetful, rate):
    speeds = Speeds(warp=1e5, opencl=rate)
    choice = faster_of(WARP, OPENCL, speeds)
    assert choice.backend == "warp" and "failed" in choice.reason
    assert faster_of(WARP, OPENCL, speeds) == choice
    assert speeds.asked.count(("opencl", "Some CPU")) == 1
    assert remembered_choice(WARP, OPENCL) is None
    forgetful()
    assert faster_of(WARP, OPENCL, Speeds(warp=1e5, opencl=1e6)).backend == "opencl"


@pytest.mark.parametrize("held", ["", "{", "[1, 2]", "null", '{"a": 1}', "wrong", b"\xff\xfe", "nested"])
def test_a_damaged_file_is_measured_again_and_mended(forgetful, tmp_path, held):
    (tmp_path / "cache").mkdir()
    path = tmp_path / "cache" / "cpu-choice.json"
    key = device_choice._key(WARP, OPENCL)
    if held == "wrong":
        held = json.dumps({key: {"warp": "fast", "opencl": -1}})
    elif held == "nested":
        held = "[" * 100_000
    path.write_bytes(held if isinstance(held, bytes) else held.encode())
    assert faster_of(WARP, OPENCL, Speeds(warp=1e5, opencl=3e5)).backend == "opencl"
    assert json.loads(path.read_text()) == {key: {"warp": 1e5, "opencl": 3e5}}
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_a_folder_that_cannot_be_written_is_no_error(forgetful, tmp_path):
    (tmp_path / "cache").write_text("a file, no folder")
    speeds = Speeds(warp=1e5, opencl=3e5)
    assert faster_of(WARP, OPENCL, speeds) == faster_of(WARP, OPENCL, speeds)
    assert len(speeds.asked) == 2


def test_the_file_holds_the_latest_few(forgetful, tmp_path):
    for number in range(device_choice.KEPT + 5):
        faster_of(WARP, replace(OPENCL, version=str(number)), Speeds(warp=1e5, opencl=2e5))
    held = json.loads((tmp_path / "cache" / "cpu-choice.json").read_text())
    assert len(held) == device_choice.KEPT and device_choice._key(WARP, replace(OPENCL, version=str(number))) in held


def test_auto_measures_both_for_real_and_keeps_to_it(forgetful):
    """The CPU's own speeds; the list then puts the one taken first among the CPU's."""
    need_opencl()
    backend, device, reason = choose_backend("auto", "cpu")
    assert "times the rays per second" in reason, reason
    assert choose_backend("auto", "cpu") == (backend, device, reason)
    on_cpu = [info for info in available_backends() if info.available and "GPU" not in info.description]
    if not any("a GPU goes before it" in info.reason for info in on_cpu):
        assert (on_cpu[0].backend, on_cpu[0].device) == (backend, device) and on_cpu[0].reason in reason


def test_listing_measures_nothing(forgetful, tmp_path):
    found = available_backends()
    assert not (tmp_path / "cache").exists()
    assert {info.backend for info in found} == {"warp", "opencl", "reference"}
    on_cpu = [info for info in found if info.available and info.backend != "reference"]
    if len(on_cpu) == 2 and on_cpu[0].device == "cpu":
        assert [info.reason for info in on_cpu] == [NOT_MEASURED] * 2


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
    done = run_python("import sys; sys.modules['pyopencl'] = None\n" + AUTO, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("warp|") and done.stdout.endswith("\nwarp\n")
    assert "pip install" in done.stdout or "cuda" in done.stdout


@pytest.mark.parametrize("broken", ["import", "platform", "driver", "float64"])
def test_auto_with_a_broken_opencl_goes_on_with_warp(tmp_path, broken):
    if broken == "import":
        (tmp_path / "shadow" / "pyopencl").mkdir(parents=True)
        (tmp_path / "shadow" / "pyopencl" / "__init__.py").write_text("raise ImportError('libfoo.so')\n")
        settings = {"PYTHONPATH": before_path(tmp_path / "shadow")}
    else:
        drivers = {"platform": {}, "driver": {"broken": "libm.so.6"}}.get(broken)
        drivers = {"stand": driver(tmp_path, 0)} if drivers is None else drivers
        settings = {"PYTHONPATH": bare_pyopencl(tmp_path), "OCL_ICD_VENDORS": vendors(tmp_path, **drivers)}
    done = run_python(AUTO, tmp_path, **settings)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("warp|") and done.stdout.endswith("\nwarp\n") and done.stderr == ""
    words = {"import": "libfoo", "platform": "no OpenCL platform", "driver": "libm", "float64": "float64 is missing"}
    assert words[broken] in done.stdout or "cuda" in done.stdout


def test_without_warp_opencl_is_taken(tmp_path):
    need_opencl()
    done = run_python("import sys; sys.modules['warp'] = None\n" + AUTO, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("opencl|") and done.stdout.endswith("\nopencl\n") and "warp-lang" in done.stdout


def test_without_either_the_message_has_both_remedies(tmp_path):
    code = (
        "import sys; sys.modules['warp'] = sys.modules['pyopencl'] = None\n"
        "from aerokernels.tracing.backends import *\n"
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


def test_the_command_tells_what_auto_takes_and_why(aerokernels, monkeypatch, tmp_path):
    monkeypatch.setenv("AEROKERNELS_CACHE_DIR", str(tmp_path / "cache"))
    first, second = aerokernels("backends"), aerokernels("backends")
    assert first.returncode == second.returncode == 0, first.stderr
    assert first.stdout.splitlines()[-1] == second.stdout.splitlines()[-1]
    assert "auto takes" in second.stdout and "measuring" not in second.stderr
    if "measuring" in first.stderr:
        assert "times the rays per second" in first.stdout


@pytest.mark.parametrize("backend", ["warp", "opencl"])
def test_a_variable_decides_without_measuring(forgetful, monkeypatch, backend):
    monkeypatch.setenv("AEROKERNELS_CPU_BACKEND", backend)
    speeds = Speeds(warp=1.0, opencl=1.0)
    choice = faster_of(WARP, OPENCL, speeds)
    assert choice.backend == backend and "AEROKERNELS_CPU_BACKEND" in choice.reason and not speeds.asked


def test_a_gpu_has_a_variable_and_a_measurement_of_its_own(forgetful, monkeypatch):
    cuda, gpu = replace(WARP, device="cuda:0"), replace(OPENCL, device="Some GPU", description="GPU, some driver")
    faster_of(WARP, OPENCL, Speeds(warp=1e5, opencl=1e4))
    monkeypatch.setenv("AEROKERNELS_CPU_BACKEND", "warp")
    choice = faster_of(cuda, gpu, Speeds(warp=1e9, opencl=2e9))
    assert (choice.backend, choice.device) == ("opencl", "Some GPU") and "2.00 times" in choice.reason
    monkeypatch.setenv("AEROKERNELS_GPU_BACKEND", "warp")
    assert faster_of(cuda, gpu, Speeds()).device == "cuda:0"


def test_a_variable_that_names_no_backend_is_refused(forgetful, monkeypatch):
    monkeypatch.setenv("AEROKERNELS_CPU_BACKEND", "cuda")
    with pytest.raises(ValueError, match="'warp' or 'opencl'"):
        faster_of(WARP, OPENCL, Speeds(warp=1.0, opencl=1.0))
