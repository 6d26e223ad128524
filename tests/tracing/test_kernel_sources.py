"""Numbers and arguments that both backends' kernels have: one source, and the checks that keep them alike can fail."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from aerokernels.tracing.status import RayStatus


def run_script(root: Path, name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(root / "scripts" / name), *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300.0,
    )


@pytest.fixture
def kernels(root: Path, tmp_path: Path) -> Path:
    """A copy of the OpenCL sources, to be spoilt."""
    return shutil.copytree(root / "kernels", tmp_path / "kernels")


@pytest.fixture
def arguments(root: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(root / "scripts"))
    import kernel_arguments

    return kernel_arguments


def replace_once(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, (path, old)
    path.write_text(text.replace(old, new), encoding="utf-8")


def defined(path: Path) -> dict[str, str]:
    return dict(re.findall(r"^#define (\w+) +(\S+)", path.read_text(encoding="utf-8"), flags=re.MULTILINE))


def test_headers_are_what_python_says(root: Path):
    done = run_script(root, "kernel_headers.py", "--check")
    assert done.returncode == 0, done.stderr


def test_header_check_names_what_is_stale_and_writing_mends_it(root: Path, kernels: Path):
    include = kernels / "include"
    replace_once(include / "ray_status.h", "RAY_HIT_BODY           3", "RAY_HIT_BODY           4")
    (include / "constants.h").unlink()
    before = sorted(include.iterdir())
    check = ("kernel_headers.py", "--check", "--folder", include)
    done = run_script(root, *check)
    assert done.returncode == 1
    assert "ray_status.h is stale" in done.stderr and "constants.h is stale" in done.stderr
    assert sorted(include.iterdir()) == before
    assert run_script(root, "kernel_headers.py", "--folder", include).returncode == 0
    assert run_script(root, *check).returncode == 0
    for name in ("ray_status.h", "constants.h"):
        assert (include / name).read_bytes() == (root / "kernels" / "include" / name).read_bytes()


def test_a_changed_constant_makes_its_header_stale(root: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(root / "scripts"))
    import kernel_headers

    from aerokernels.tracing import scheme

    assert kernel_headers.stale(kernel_headers.INCLUDE) == []
    monkeypatch.setattr(scheme, "FACE_TOLERANCE", 2.0 * scheme.FACE_TOLERANCE)
    assert kernel_headers.stale(kernel_headers.INCLUDE) == ["constants.h"]


def test_headers_hold_every_status_and_the_tableau_to_the_last_digit(root: Path):
    """RKN4(3)4FM from its fractions: the numbers in the header are the float64 next to them."""
    include = root / "kernels" / "include"
    status = defined(include / "ray_status.h")
    assert {name: int(value) for name, value in status.items()} == {f"RAY_{s.name}": int(s) for s in RayStatus}
    constants = defined(include / "constants.h")
    for name, value in {
        "RKN_C2": 1 / 4,
        "RKN_C3": 7 / 10,
        "RKN_A21": 1 / 32,
        "RKN_A32": 119 / 500,
        "RKN_B3": 25 / 189,
        "RKN_V4": 5 / 54,
        "RKN_E4": 1 / 20,
        "RKN_F1": 1 / 14 - 13 / 21,
    }.items():
        literal = re.fullmatch(r"R\((.*)\)", constants[name])
        assert literal is not None and abs(float(literal[1]) - value) <= 2e-16 * abs(value), name
    # A step of constant force 1 from rest: the position moves by 1/2, the momentum by 1.
    sums = {
        letter: sum(float(constants[n][2:-1]) for n in constants if n.startswith(f"RKN_{letter}")) for letter in "BV"
    }
    assert abs(sums["B"] - 0.5) < 1e-15 and abs(sums["V"] - 1.0) < 1e-15


def test_kernel_arguments_agree(root: Path):
    done = run_script(root, "kernel_arguments.py")
    assert done.returncode == 0, done.stdout + done.stderr


MUTATIONS = {
    "renamed": ("launch_pupil.cl", "const int per_replicate,", "const int replicate_size,", "replicate_size"),
    "left out": ("sum_moments.cl", "__global const double *step_error_in,", "", "step_error_in"),
    "no bound": ("trace.cl", "    const int ray_count,\n", "", "int ray_count"),
    "of another type": ("sum_phasors.cl", "const double wave_number", "const float wave_number", "float wave_number"),
    "of another width": (
        "trace.cl",
        "__global int *step_count_out",
        "__global long *step_count_out",
        "long* step_count",
    ),
    "swapped": (
        "sum_moments.cl",
        "__global const double *opd_in,\n    __global const double *step_error_in,",
        "__global const double *step_error_in,\n    __global const double *opd_in,",
        "double* opd_in",
    ),
    "swapped in a struct": (
        "include/types.h",
        "double low[3];            // box [m]\n    double high[3];",
        "double high[3];\n    double low[3];",
        "struct Bounds",
    ),
    "shorter in a struct": ("include/types.h", "real face_low[3];", "real face_low[2];", "real[2] face_low"),
    "kernel renamed": ("sum_phasors.cl", "__kernel void sum_phasors(", "__kernel void add_phasors(", "add_phasors"),
}


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_changed_argument_is_reported(name: str, arguments: ModuleType, kernels: Path):
    """Each change brings a finding that names it, and only in the kernel or struct where it was made."""
    file, old, new, word = MUTATIONS[name]
    before = set(arguments.differences(kernels))
    replace_once(kernels / file, old, new)
    found = [text for text in arguments.differences(kernels) if text not in before]
    assert len(found) == (2 if name == "kernel renamed" else 1)
    assert any(word in text for text in found)


def test_comments_layout_and_conditions_do_not_matter(arguments: ModuleType, kernels: Path):
    before = arguments.differences(kernels)
    replace_once(
        kernels / "sum_phasors.cl",
        "const double3 plane,",
        "/* of the\n wavefront, */ double3\n#if 0 \\\n + 1\n   const plane, // at the pupil,\n#endif\n",
    )
    assert arguments.differences(kernels) == before


def test_script_reports_and_refuses(root: Path, kernels: Path, tmp_path: Path):
    replace_once(kernels / "launch_pupil.cl", "const double3 look,", "const double3 gaze,")
    done = run_script(root, "kernel_arguments.py", "--kernels", kernels)
    assert done.returncode == 1
    assert "- double3 look" in done.stdout and "+ double3 gaze" in done.stdout
    done = run_script(root, "kernel_arguments.py", "--kernels", tmp_path)
    assert done.returncode == 2 and "types.h" in done.stderr


def test_launches_of_the_pupil_take_one_work_item_a_moment():
    """sum_moments writes its moments by one work-item each, and groups.h leaves the work-group's size to the host."""
    from aerokernels.tracing.engines.opencl.program import WORK_GROUP
    from aerokernels.tracing.pupil_sums import MOMENT_COUNT

    assert WORK_GROUP >= MOMENT_COUNT
