"""What every test may ask for."""

import functools
import gc
import importlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from unittest import mock

import pytest
from hypothesis import settings

from tests.command import command

if TYPE_CHECKING:
    from aerokernels import RunResult

ROOT = Path(__file__).resolve().parents[1]
# Processes that tests start, in other folders, take this checkout too where it is not installed.
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
# Most of the tests' time goes into compiling kernels: see quiet_warp.py. Compilers need not search for loops and
# statements that fit vectors: the tests' few rays are traced as quickly. The bits are those of the usual flags.
os.environ.setdefault("AEROKERNELS_WARP_FLAGS", "-march=native -fno-vectorize -fno-slp-vectorize")
# On a machine that other work shares, an example of half a millisecond took 277: time says nothing about the answer.
settings.register_profile("at any load", settings(), deadline=None)
settings.load_profile("at any load")

# Files that take longest, first: with two processes none of them is left to one alone at the end (see scripts/test).
LONGEST = (
    "tests/tracing/engines/test_generated_kernels.py",
    "tests/tracing/leapfrog/test_leapfrog.py",
    "tests/fldi/test_fldi.py",
    "tests/tracing/engines/test_backends_agree.py",
    "tests/commands/test_cli.py",
    "tests/tracing/test_along_faces.py",
    "tests/tracing/engines/test_backends.py",
    "tests/tracing/engines/test_cross_backend.py",
    "tests/jobs/test_sweep.py",
    "tests/jobs/test_unfinished.py",
    "tests/echo/test_cut_beam.py",
    "tests/echo/test_echo_errors.py",
    "tests/tracing/bundle/test_bundles.py",
    "tests/tracing/engines/test_opencl_devices.py",
    "tests/tracing/test_gaps_in_meshes.py",
    "tests/tracing/engines/test_opencl_program.py",
    "tests/rays/test_pupils.py",
)


class _FromTheEnd:
    """A folder of tests that is read from its last file to its first."""

    def collect(self) -> list[pytest.Item | pytest.Collector]:
        return list(super().collect())[::-1]  # type: ignore[misc]


class _Folder(_FromTheEnd, pytest.Dir):
    pass


class _Package(_FromTheEnd, pytest.Package):
    pass


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Every second process reads the files from the end.

    Where nothing has been compiled yet, compiling all files takes a process twenty seconds: two that meet in the middle
    compile half of them each.
    """
    number = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    if not number.isdecimal() or int(number) % 2 == 0:
        return None
    kind = _Package if (path / "__init__.py").is_file() else _Folder
    return kind.from_parent(parent, path=path)


# Warp's tracer on a processor has the bits of the generated OpenCL one (test_generated_kernels.py), and takes long to
# compile: the other tests of tracing take it with --all, but for the transfers and calls that are its own.
OF_WARP = ("test_device_arrays", "test_repeated_work")
FOLDERS_OF_KERNELS = ("tracing", "physics", "stress", "strehl", "rays", "wavefront")


def is_slow(item: pytest.Item) -> bool:
    """Whether a test waits for `scripts/test --all`."""
    # OpenCL's kernels are generated from Warp's and compared bit by bit, so that one of the two is enough.
    is_warps = "warp" in item.name.partition("[")[2] and item.nodeid.split("/")[1] in FOLDERS_OF_KERNELS
    return item.get_closest_marker("slow") is not None or (is_warps and item.path.stem not in OF_WARP)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Longest files first, the others by their names; each as a whole. Slow tests are left out without --all."""
    if "AEROKERNELS_SLOW" not in os.environ:
        for item in filter(is_slow, items):
            item.add_marker(pytest.mark.skip(reason="slow: scripts/test --all"))
    rank = {name: place for place, name in enumerate(LONGEST)}
    files = [item.nodeid.split("::")[0] for item in items]
    order = sorted(range(len(items)), key=lambda number: (rank.get(files[number], len(rank)), files[number]))
    items[:] = [items[number] for number in order]


# What is collected lives to the end: the garbage collector, a fifth of collecting's time, need not look through it.
gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(params=["opencl", "warp"])
def both_backends(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The test runs twice, and "auto" takes OpenCL at first and then Warp; skipped where there is only one of them."""
    from aerokernels.tracing.engines import choice

    usual = choice.preferred

    def other_first(warp: list, opencl: list) -> list:
        return sorted(usual(warp, opencl), key=lambda info: info.backend != request.param)

    monkeypatch.setattr(choice, "preferred", other_first)
    taken, _, reason = choice.choose_backend("auto", None)
    if taken != request.param:
        pytest.skip(reason)
    return taken


@pytest.fixture
def aerokernels(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command line in a process of its own, in an empty folder: `aerokernels("run", scene, "--out", out)`."""

    def run(*arguments: object, timeout: float = 300.0) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "aerokernels", *map(str, arguments)],
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            timeout=timeout,
        )

    return run


@pytest.fixture
def command_line(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """As `aerokernels`, but in this process: see command.py."""
    return functools.partial(command, tmp_path)


@pytest.fixture
def full_disk() -> Iterator[Callable[[int | None], None]]:
    """A function that limits the bytes of a file: beyond them it fails with EFBIG, as on a full disk with ENOSPC.

    None ends the limit, and so does the end of the test.
    """
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size: int | None) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft if size is None else size, hard))

    yield limit
    limit(None)


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> tuple["RunResult", Path]:
    """A run of a shipped scene with few rays, and the folder that it is written to: for tests that only read it."""
    from aerokernels import Scene, simulate
    from aerokernels.jobs.run import write_run

    few = {"strehl.ray_count": 2000, "beam.ray_count": 32, "receiver.ray_count": 32, "grid.spacing": "0.2 mm"}
    run, folder = simulate(Scene.load("wind-tunnel-mach3", few)), tmp_path_factory.mktemp("small") / "run"
    write_run(run, folder)
    return run, folder


@pytest.fixture
def readers_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that need a child to read them are read in this process: for sound ones, and those that we refuse.

    A file that is refused ends the child, and the next one takes a second to start.
    """
    from aerokernels.process import fragile

    class Here:
        is_late = False
        process = mock.Mock(poll=lambda: None)

        def ask(self, request: tuple, time_limit: float) -> tuple[bool, object]:
            _, path, _, function, arguments = request
            try:
                fragile.check_own_files(path)
                module, _, name = function.partition(":")
                return False, pickle.loads(pickle.dumps(getattr(importlib.import_module(module), name)(*arguments)))
            except Exception as fault:
                return True, fragile._sent(fault)

        def end(self) -> int:
            return 0

    monkeypatch.setattr(fragile, "_Child", Here)
    monkeypatch.setattr(fragile, "_idle", list)
