"""The size of the package as a test: lines by folder, the path of an answer, and no circles of packages in tracing.

These limits may only fall, except by what an issue grants.
"""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "aerokernels"
# Lines of Python in the modules of each folder and in folders below it.
LINES = {
    ".": 1640,
    "benches": 2280,
    "benchmark": 610,
    "commands": 1340,
    "device_arrays": 1190,
    "display": 997,
    "files": 430,
    "fldi": 620,
    "flow": 13090,
    "focus": 600,
    "hardware": 2380,
    "imaging": 1470,
    "inputs": 1110,
    "jobs": 5890,
    "lidar": 3100,
    "medium": 3670,
    "process": 1150,
    "pupils": 1020,
    "scene": 1580,
    "series": 2840,
    "tracing": 17770,
    "wavefronts": 2620,
    "waves": 1050,
}
FILES = 342
# What a call passes through in a new process: files, calls of functions, changes of file; more on some machines.
WATCHED = """
import contextlib, os, sys, warnings
warnings.simplefilter("ignore")
import aerokernels as ak
base, files, state = os.path.dirname(ak.__file__) + os.sep, set(), [0, 0, None]
def see(frame, event, argument):
    name = frame.f_code.co_filename
    if event == "call" and name.startswith(base):
        files.add(name)
        state[0] += 1
        if name != state[2]:
            state[1:] = state[1] + 1, name
"""
COLD_STREHL = """
field = ak.flow.shipped("mach3").index_field(wavelength=905e-9).resample(1e-4, region=((0, -9e-3), (9e-3, 6e-3)))
pupil = ak.Disc(radius=6e-3, center=(0, 0, -8e-3))
sys.setprofile(see)
ak.estimate_strehl(field, pupil, wavelength=905e-9, ray_count=200_000)
"""
COLD_RUN = """
sys.setprofile(see)
ak.simulate("wind-tunnel-mach3")
"""


def lines_of(folder: Path) -> int:
    """Count the lines of a folder's modules."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in folder.rglob("*.py"))


def test_no_folder_grows():
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and lines_of(path)}
    assert folders == set(LINES) - {"."}, "a new folder needs a limit in this test"
    own = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in PACKAGE.glob("*.py"))
    sizes = {".": own} | {name: lines_of(PACKAGE / name) for name in folders}
    assert not {name: (size, LINES[name]) for name, size in sizes.items() if size > LINES[name]}
    assert len(list(PACKAGE.rglob("*.py"))) <= FILES


@pytest.mark.parametrize(
    ("body", "limits"),
    [
        pytest.param(COLD_STREHL, (84, 3_700, 1_200), id="estimate_strehl"),
        pytest.param(COLD_RUN, (196, 24_900, 11_800), id="simulate", marks=pytest.mark.slow),
    ],
)
def test_the_path_of_an_answer_grows_no_longer(body, limits):
    code = WATCHED + body + "sys.setprofile(None)\nprint('PATH', len(files), *state[:2])\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", env=os.environ)
    (path,) = (line.split()[1:] for line in done.stdout.splitlines() if line.startswith("PATH"))
    assert all(int(size) <= limit for size, limit in zip(path, limits, strict=True)), path


def imported_packages(path: Path) -> set[str]:
    """Return the packages of tracing that one of its modules imports."""
    inside = ("aerokernels", "tracing")
    base = path.relative_to(PACKAGE.parent).parts[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            start = base[: len(base) - node.level + 1] if node.level else ()
            name = (*start, *(node.module or "").split("."))
            if name[:2] == inside and len(name) > 2 and (PACKAGE / "tracing" / name[2]).is_dir():
                found.add(name[2])
    return found


def test_packages_of_tracing_import_each_other_in_no_circle():
    tracing = PACKAGE / "tracing"
    packages = {path.name for path in tracing.iterdir() if path.is_dir() and any(path.glob("*.py"))}
    below = {name: set[str]().union(*map(imported_packages, (tracing / name).rglob("*.py"))) for name in packages}
    while below:
        lowest = [name for name, others in below.items() if not (others - {name}) & set(below)]
        assert lowest, f"a circle among {sorted(below)}"
        below = {name: others for name, others in below.items() if name not in lowest}
