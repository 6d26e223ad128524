"""OpenCL's devices by name, sessions, and the ways in which OpenCL can be missing or broken, for real, in processes."""

import ctypes
import os
import platform
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from aerokernels import tracing
from aerokernels.commands.listing import backends
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.engines.info import BackendInfo
from aerokernels.tracing.engines.opencl import devices as opencl_devices
from aerokernels.tracing.engines.opencl import pocl as opencl_pocl
from aerokernels.tracing.engines.opencl.devices import (
    FoundDevice,
    OpenCLUnavailable,
    find_device,
    list_devices,
    session,
)
from tests.slow import first_of

from ..opencl_stands import bare_pyopencl, before_path, driver, need_opencl, run_python, vendors

LIST = (
    "from aerokernels.tracing.engines.opencl.devices import *\n"
    "for info in list_devices(): print(info.available, info.float64, info.device, info.reason, sep='|')\n"
    "for name in (None, 'cpu'):\n"
    "    try: print('found', find_device(name).info.device)\n"
    "    except ValueError as error: print(type(error).__name__, error)\n"
)


def listed(folder: Path, **environment: str) -> str:
    """What LIST prints; it never ends in a traceback and never speaks on stderr."""
    done = run_python(LIST, folder, **environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_a_device_is_found_by_any_of_its_names():
    found = need_opencl()
    info = found.info
    assert info in list_devices() and info.backend == "opencl" and info.float64 and info.memory > 2**20
    assert str(found.compute_units) in info.description
    assert find_device(info.device.upper()) is found and find_device(info.device[:-1]) is found
    assert find_device(found.kind).kind == found.kind


def test_an_unknown_name_lists_what_there_is():
    found = need_opencl()
    for name in ("no such device", ""):
        with pytest.raises(ValueError, match="is not there") as refused:
            find_device(name)
        assert found.info.device in str(refused.value)


def several(monkeypatch) -> list[FoundDevice]:
    """Two CPUs of one name, a small and a large GPU, and a GPU without float64."""
    blank = BackendInfo("opencl", "", "", "", True, True, None, "")

    def device(name, kind, units, available=True):
        reason = "" if available else f"float64 is missing on {name}"
        return FoundDevice(replace(blank, device=name, available=available, reason=reason), None, kind, units)

    devices = opencl_devices.with_unique_names(
        [
            device("Large GPU", "gpu", 100),
            device("Small GPU", "gpu", 10),
            device("Plain CPU", "cpu", 8),
            device("Plain CPU", "cpu", 8),
            device("Single GPU", "gpu", 999, available=False),
        ]
    )
    monkeypatch.setattr(opencl_devices, "survey", lambda: (devices, []))
    return devices


def test_names_are_made_unique_and_parts_of_names_must_be(monkeypatch):
    devices = several(monkeypatch)
    assert [found.info.device for found in devices[2:4]] == ["Plain CPU", "Plain CPU #2"]
    assert find_device() is devices[0] and find_device("GPU") is devices[0] and find_device("cpu") is devices[2]
    assert find_device("small") is devices[1] and find_device("plain cpu") is devices[2]
    assert find_device("#2") is devices[3]
    with pytest.raises(ValueError, match=r"ambiguous.*'Plain CPU', 'Plain CPU #2'"):
        find_device("plain")


def test_a_device_without_float64_is_refused_by_name(monkeypatch):
    several(monkeypatch)
    with pytest.raises(OpenCLUnavailable, match="float64 is missing on Single GPU"):
        find_device("Single GPU")


def test_one_session_a_device_for_all_threads():
    need_opencl()
    opened = []
    threads = [threading.Thread(target=lambda: opened.append(session())) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(opened) == 8 and all(one is opened[0] for one in opened)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_is_refused_and_leaves_the_parents_session_alone(tmp_path):
    """Drivers' threads do not survive a fork: without the refusal the child hangs in its first build."""
    need_opencl()
    code = (
        "import os, sys\nfrom aerokernels.tracing.engines.opencl.devices import *\n"
        "from aerokernels.tracing.engines.choice import choose_backend\n"
        "opened = session()\n"
        "if os.fork() == 0:\n"
        "    try: session()\n"
        "    except OpenCLUnavailable as error: print(error, flush=True)\n"
        "    print(choose_backend('auto', 'cpu')[:2], flush=True)\n"
        "    release_all(); sys.exit(7)\n"
        "print(os.waitstatus_to_exitcode(os.wait()[1]), session() is opened)"
    )
    done = run_python(code, tmp_path)
    assert done.returncode == 0, done.stderr
    refusal, auto, parent = done.stdout.splitlines()
    status, is_same = parent.split()
    assert "spawn" in refusal and auto == "('warp', 'cpu')" and is_same == "True"
    # NVIDIA's driver ends a forked process by a signal when the process exits.
    assert status == "7" or ("NVIDIA" in need_opencl().info.device and status == "-11")


def test_pyopencl_is_not_installed(tmp_path):
    done = run_python("import sys; sys.modules['pyopencl'] = None\n" + LIST, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("pip install 'aerokernels[opencl]'") == 3 and "found" not in done.stdout


@pytest.mark.parametrize("error", first_of(["OSError('bad magic')", "ImportError('libfoo.so.1')", "KeyError('x')"]))
def test_pyopencl_does_not_import(tmp_path, error):
    (tmp_path / "shadow" / "pyopencl").mkdir(parents=True)
    (tmp_path / "shadow" / "pyopencl" / "__init__.py").write_text(f"raise {error}\n")
    text = listed(tmp_path, PYTHONPATH=before_path(tmp_path / "shadow"))
    assert "its import fails with " + error.split("(")[0] in text and str(tmp_path / "shadow") in text
    assert "force-reinstall" in text and "found" not in text


def test_no_platform_names_the_remedies(tmp_path):
    text = listed(tmp_path, PYTHONPATH=bare_pyopencl(tmp_path), OCL_ICD_VENDORS=vendors(tmp_path))
    assert "pip install 'pyopencl[pocl]'" in text and "OCL_ICD_VENDORS" in text and "found" not in text


@pytest.mark.parametrize(
    ("code", "words"), first_of([(-1, "'Stand Platform' has no devices"), (-6, "'Stand Platform' fails")])
)
def test_a_platform_without_devices_or_that_fails(tmp_path, code, words):
    folder = vendors(tmp_path, stand=driver(tmp_path, code))
    text = listed(tmp_path, PYTHONPATH=bare_pyopencl(tmp_path), OCL_ICD_VENDORS=folder)
    assert words in text and "no OpenCL device is here" in text
    beside = listed(tmp_path, OCL_ICD_VENDORS=folder)
    assert words in beside and ("\nfound" in beside) == ("True|True" in beside)


def test_a_real_device_without_float64_is_listed_and_refused(tmp_path):
    folder = vendors(tmp_path, stand=driver(tmp_path, 0))
    text = listed(tmp_path, PYTHONPATH=bare_pyopencl(tmp_path), OCL_ICD_VENDORS=folder)
    assert "False|False|Stand GPU|float64 is missing on Stand GPU" in text and "backend 'warp'" in text
    assert "no OpenCL device here can trace: Stand GPU: float64 is missing" in text


def test_a_processor_that_pocl_does_not_know_is_named_for_it(tmp_path):
    """Left alone, this PoCL builds nothing, and that is said; named, it is what the other tests run on."""
    found = need_opencl()
    if "does not know" not in opencl_pocl.workaround(found.device, found.options):
        pytest.skip("this PoCL knows this processor, or is no PoCL 3.0")
    assert found.options == ("-DPROCESSOR_" + opencl_pocl.processor_name().replace("-", "_"),)
    assert opencl_pocl.name_processor(found.device) == found.options
    text = listed(tmp_path, AEROKERNELS_POCL_CPU="off")
    assert "does not know this CPU, and is left unchanged" in text and "found" not in text


def unknown_device(kept: list, name: str = "generic"):
    """What PoCL 3.0 shows of a processor that it does not know, with a record that holds the name's address."""
    word = ctypes.create_string_buffer(name.encode())
    record = (ctypes.c_uint64 * opencl_pocl.RECORD_WORDS)()
    record[80] = ctypes.addressof(word)
    kept += [word, record]
    version = f"OpenCL 3.0 PoCL HSTR: pthread-x86_64-unknown-linux-gnu-{name}"
    platform = SimpleNamespace(version="OpenCL 3.0 PoCL 3.0-rc2  Linux, RelWithDebInfo, LLVM 14.0.6")
    return SimpleNamespace(version=version, platform=platform, int_ptr=ctypes.addressof(record)), record


@pytest.mark.skipif(sys.platform != "linux" or platform.machine() != "x86_64", reason="the work-around is for these")
def test_the_work_around_is_told_and_one_variable_turns_it_off(monkeypatch):
    """Expected: the name in the record is exchanged; "off" leaves the record alone; either is reported."""
    kept: list = []
    monkeypatch.setenv("AEROKERNELS_POCL_CPU", "haswell")
    device, record = unknown_device(kept)
    options = opencl_pocl.name_processor(device)
    assert options == ("-DPROCESSOR_haswell",) and ctypes.string_at(record[80]) == b"haswell"
    reported = opencl_pocl.workaround(device, options)
    assert "'haswell'" in reported and "AEROKERNELS_POCL_CPU=off" in reported and "\n" not in reported
    monkeypatch.setenv("AEROKERNELS_POCL_CPU", "off")
    device, record = unknown_device(kept)
    options = opencl_pocl.name_processor(device)
    assert options == () and ctypes.string_at(record[80]) == b"generic"
    assert "left unchanged: AEROKERNELS_POCL_CPU is 'off'" in opencl_pocl.workaround(device, options)
    known = SimpleNamespace(version=device.version.replace("generic", "haswell"), platform=device.platform)
    assert opencl_pocl.workaround(known, ()) == ""


@pytest.mark.skipif(sys.platform != "linux" or platform.machine() != "x86_64", reason="the work-around is for these")
def test_a_processor_that_the_library_was_not_compiled_for_is_named_as_it_was(monkeypatch):
    """Expected: "icelake-client" becomes "skylake-avx512"; not another name, and nothing if off."""
    kept: list = []
    for asked, found in (
        ("skylake-avx512", b"skylake-avx512"),
        ("znver3", b"icelake-client"),
        ("off", b"icelake-client"),
    ):
        monkeypatch.setenv("AEROKERNELS_POCL_CPU", asked)
        device, record = unknown_device(kept, "icelake-client")
        options = opencl_pocl.name_processor(device)
        assert ctypes.string_at(record[80]) == found
        assert (
            bool(options)
            == (asked == "skylake-avx512")
            == ("does not inline" in opencl_pocl.workaround(device, options))
        )


def test_backends_shows_a_work_around(monkeypatch, capsys):
    """One line for the device that it is for, none where there is none."""
    reported = BackendInfo("opencl", "Some CPU", "", "1", True, True, None, "", workaround="PoCL is told something")
    for found, lines in (
        ([reported], ["work-around on Some CPU: PoCL is told something"]),
        ([replace(reported, workaround="")], []),
    ):
        monkeypatch.setattr(tracing, "available_backends", lambda found=found: found)
        backends()
        shown = capsys.readouterr().out.splitlines()
        assert [line for line in shown if line.startswith("work-around")] == lines
        assert sum(line.startswith("auto chooses ") for line in shown) == 1


def test_without_opencl_backends_says_so_in_one_line(tmp_path):
    """The last line names Warp, and why it is not OpenCL; the plan of a trace says the same."""
    code = (
        "from aerokernels.commands.listing import backends; backends()\n"
        "from aerokernels.tracing.engines.choice import choose_backend; print(choose_backend('auto', 'cpu')[2])"
    )
    done = run_python("import sys; sys.modules['pyopencl'] = None\n" + code, tmp_path)
    assert done.returncode == 0, done.stderr
    auto, reason = done.stdout.splitlines()[-2:]
    assert "no OpenCL: the package pyopencl is not installed: pip install 'aerokernels[opencl]'" in reason
    if auto.startswith("auto chooses warp on cpu: "):  # no GPU goes before it
        assert reason.removeprefix("backend warp on cpu: ") in auto


def test_threads_do_not_wait_for_what_others_launched_on_a_processor():
    """Each has a queue of its own, always the same; what one made and settled is there for the other."""
    if need_opencl().kind != "cpu":
        pytest.skip("no processor for OpenCL here")
    engine = engine_of("opencl", "cpu")
    queues, made = [], []

    def work() -> None:
        queues.extend([engine.session.queue, engine.session.queue])
        made.append(engine.put(np.arange(5000.0)))
        engine.settle()

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert queues[0] is queues[1]
    assert queues[0] is not engine.session.queue
    assert engine.session.queue is engine.session.queue
    found = np.empty(5000)
    engine.get(made[0], found)
    assert np.array_equal(found, np.arange(5000.0))
