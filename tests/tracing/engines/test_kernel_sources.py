"""Numbers and arguments that both backends' kernels have: one source, and the checks that keep them alike can fail."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from aerokernels.tracing import scheme
from aerokernels.tracing.engines import layout
from aerokernels.tracing.engines.kernel_table import KERNELS
from aerokernels.tracing.engines.opencl.headers import HEADERS
from aerokernels.tracing.engines.opencl.program import expand
from aerokernels.tracing.status import RayStatus


def run_script(root: Path, name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(root / "scripts" / name), *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
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


def defined(name: str) -> dict[str, str]:
    """The macros of a header that is made from Python."""
    return dict(re.findall(r"^#define (\w+) +(\S+)", "\n".join(HEADERS[name]()), flags=re.MULTILINE))


def test_a_changed_constant_is_in_the_next_source(monkeypatch: pytest.MonkeyPatch):
    """Nothing is kept of a header: both engines follow scheme.py without a step between."""
    before = expand("trace.cl")
    monkeypatch.setattr(scheme, "FACE_TOLERANCE", 2.0 * scheme.FACE_TOLERANCE)
    after = expand("trace.cl")
    changed = [pair for pair in zip(before.splitlines(), after.splitlines(), strict=True) if pair[0] != pair[1]]
    assert changed == [("#define FACE_TOLERANCE R(0.0001)", "#define FACE_TOLERANCE R(0.0002)")]


def test_headers_hold_every_status_and_the_tableau_to_the_last_digit():
    """RKN4(3)4FM from its fractions: the numbers in the header are the float64 next to them."""
    status = defined("ray_status.h")
    assert {name: int(value) for name, value in status.items()} == {f"RAY_{s.name}": int(s) for s in RayStatus}
    constants = defined("constants.h")
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
    "argument renamed": (
        "include/wall.h",
        "double t_enter, double t_exit, double margin",
        "double t_enter, double t_exit, double by",
    ),
    "argument left out": ("include/box.h", "double3 p, double3 d, double guess)", "double3 p, double3 d)"),
    "of another type": (
        "include/event_location.h",
        "rising_root(real v0, real v1, real v2)",
        "rising_root(int v0, real v1, real v2)",
    ),
    "of another width": (
        "include/motion.h",
        "deflection(double ambient, double3 d,",
        "deflection(double ambient, double4 d,",
    ),
    "swapped": (
        "include/grid.h",
        "real place, int base, int last, real *fraction",
        "real place, int last, int base, real *fraction",
    ),
    "arguments of its own": ("sum_rays.cl", "SUM_RAYS_ARGUMENTS", "__global double *sums_out"),
    "kernel renamed": ("sum_rays.cl", "__kernel void sum_rays(", "__kernel void add_rays("),
}


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_changed_argument_is_reported(name: str, arguments: ModuleType, kernels: Path):
    """Each change brings a finding about the function or kernel where it was made, and none elsewhere."""
    file, old, new = MUTATIONS[name]
    assert arguments.differences(kernels) == []
    replace_once(kernels / file, old, new)
    found = arguments.differences(kernels)
    told = re.findall(r"(?:kernel|function) (\w+)", " ".join(found))
    expected = {
        "argument renamed": {"has_clearance"},
        "argument left out": {"meeting"},
        "of another type": {"rising_root"},
        "of another width": {"deflection"},
        "swapped": {"split"},
        "arguments of its own": {"sum_rays"},
        "kernel renamed": {"sum_rays", "add_rays"},
    }
    assert found and set(told) == expected[name]


LAYOUT_CHANGES = {
    "member": (layout.STRUCTS, "Bounds", -1, "types.h"),
    "argument": (KERNELS, "reduce_sums", -1, "arguments.h"),
}


@pytest.mark.parametrize("name", LAYOUT_CHANGES)
@pytest.mark.parametrize("change", ["renamed", "of another type", "left out"])
def test_a_changed_layout_changes_its_header(name: str, change: str, monkeypatch: pytest.MonkeyPatch):
    """The headers follow from the tables, and so do Warp's structs; Warp's kernels with other arguments are refused."""
    before = {name: make() for name, make in HEADERS.items()}
    table, key, number, header = LAYOUT_CHANGES[name]
    values = list(table[key])
    last = values.pop(number)
    if change == "renamed":
        values.append(last._replace(name="another"))
    elif change == "of another type":
        values.append(last._replace(kind="int"))
    monkeypatch.setitem(table, key, tuple(values))
    assert [name for name, make in HEADERS.items() if make() != before[name]] == [header]


def test_a_warp_kernel_with_arguments_of_its_own_is_refused():
    pytest.importorskip("warp")
    from aerokernels.tracing.engines.warp.types import takes

    with pytest.raises(TypeError, match=r"reduce_sums are row_count, .*kernel_table\.py"):
        takes("reduce_sums")(lambda row_count, first_sum, reduced_count, sums_in, sums_out: None)


def test_structs_are_laid_out_as_the_table_says():
    """Warp's structs have the members of the table in its order, in both precisions."""
    pytest.importorskip("warp")
    from aerokernels.tracing.engines.layout import STRUCTS
    from aerokernels.tracing.engines.warp.types import types

    for precision in ("float32", "float64"):
        for name, members in STRUCTS.items():
            struct = getattr(types(precision), name)
            assert list(struct.vars) == [member.name for member in members]


def test_comments_layout_and_conditions_do_not_matter(arguments: ModuleType, kernels: Path):
    replace_once(
        kernels / "include" / "wall.h",
        "double t_enter, double t_exit, double margin",
        "/* between\n two */ double t_enter,\n#if 0 \\\n + 1\n   double t_exit, // distances\n#endif\n double margin",
    )
    assert arguments.differences(kernels) == []


def test_script_reports_and_refuses(root: Path, kernels: Path, tmp_path: Path):
    replace_once(
        kernels / "include" / "box.h", "double3 p, double3 d, double guess)", "double3 p, double3 d, double gaze)"
    )
    done = run_script(root, "kernel_arguments.py", "--kernels", kernels)
    assert done.returncode == 1
    assert "double guess" in done.stdout and "double gaze" in done.stdout
    done = run_script(root, "kernel_arguments.py", "--kernels", tmp_path)
    assert done.returncode == 2 and "include" in done.stderr


def test_launches_of_the_pupil_take_one_work_item_a_sum():
    """sum_rays writes its sums by one work-item each, and groups.h leaves the work-group's size to the host."""
    from aerokernels.tracing.engines.opencl.program import WORK_GROUP
    from aerokernels.tracing.pupil.sums import SUM_COUNT

    assert WORK_GROUP >= SUM_COUNT


@pytest.mark.parametrize("kernel", ["adaptive", "leapfrog"])
def test_warp_compiles_each_tracer_once_for_a_processor(kernel: str):
    """Its C++ calls the loop over rays once. Two calls would be two variants, for arrays with gaps and without."""
    pytest.importorskip("warp")
    from aerokernels.device_arrays.launching import _cached, load_module
    from aerokernels.process.quiet_warp import start_warp
    from aerokernels.tracing.engines.warp.kernels.leapfrog import build_leapfrog_kernel
    from aerokernels.tracing.engines.warp.kernels.trace import build_kernel
    from aerokernels.tracing.engines.warp.library import library_of

    start_warp()
    library = library_of("float32")
    if kernel == "leapfrog":
        module = build_leapfrog_kernel(library, "planar", "cubic", "plane", False).module
    else:
        module = build_kernel(library, "planar", "cubic", False, "adaptive", "plane", False, True).module
    load_module(module, "cpu", 1)
    folder = _cached(module, 1)
    assert folder is not None
    (source,) = folder.glob("*.cpp")
    assert len(re.findall(r"_cpu_forward_tasks<\w+>\(dim", source.read_text())) == 1
