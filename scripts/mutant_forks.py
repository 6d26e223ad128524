"""Run the tests of mutants, each mutant in a forked process, several at a time. Needs `fork`."""

import ast
import contextlib
import gc
import importlib.abc
import importlib.util
import json
import os
import resource
import sys
import time
import types
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from mutants import ROOT, Mutant

BROKEN = 99  # status of a process that could run no test
LATE = "late"  # ended because the total time was over: no answer
OPTIONS = ("-q", "-p", "no:cacheprovider", "--hypothesis-seed=0")


class Waiting(NamedTuple):
    """A mutant, its tests, and the limit of their computing time [s]."""

    mutant: Mutant
    names: list[str]
    limit: float


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Import hook that loads the mutant in place of its module."""

    def __init__(self, name: str, path: Path, tree: ast.Module | None):
        self.name, self.path, self.tree = name, path, tree

    def find_spec(self, name, path=None, target=None):
        """Find only the one module."""
        return importlib.util.spec_from_loader(name, self, origin=str(self.path)) if name == self.name else None

    def exec_module(self, module) -> None:
        """Run the mutant."""
        module.__file__ = str(self.path)
        tree = self.tree if self.tree is not None else ast.parse(self.path.read_text(encoding="utf-8"))
        exec(compile(ast.fix_missing_locations(tree), str(self.path), "exec"), module.__dict__)


class _Fast:
    """Plugin of pytest that runs each mutant of a function in a fork of the process that has collected the tests.

    Only the function's code is replaced; a value computed at import may be stored in a constant.
    """

    def __init__(self, waiting: list[Waiting], processes: int, end: float, tell: int):
        self.waiting, self.processes, self.end, self.tell = waiting, processes, end, tell
        self.called: set[tuple[str, str]] = set()
        self.sound: dict[tuple[str, ...], bool] = {}

    def pytest_sessionstart(self) -> None:
        """Record the functions that are called during import."""
        core = str(ROOT / "aerokernels")

        def note(frame, event, _) -> None:
            if event == "call" and frame.f_code.co_filename.startswith(core):
                self.called.add((frame.f_code.co_filename, frame.f_code.co_qualname.split(".<locals>")[0]))

        sys.setprofile(note)
        for module in sorted({mutant.module for mutant, _, _ in self.waiting}):
            importlib.import_module(dotted(module))
        sys.setprofile(None)

    def pytest_runtestloop(self, session) -> bool:
        """Run all mutants, some of them at a time."""
        items = {item.nodeid: item for item in session.items}
        gc.unfreeze()
        places = {}
        for one in gc.get_objects():
            if type(one) is types.FunctionType:
                places.setdefault((one.__code__.co_filename, one.__code__.co_qualname), []).append(one)
        gc.freeze()

        def work(place: int) -> tuple[str, str]:
            mutant, names, limit = self.waiting[place]
            tests = {name: items[name] for name in names if name in items}  # a test may have been removed since
            functions = places.get((str(ROOT / "aerokernels" / mutant.module), mutant.function), [])
            return self._answer(mutant, functions, tests, limit)

        for answer in in_turn(range(len(self.waiting)), work, self.processes, self.end):
            os.write(self.tell, (json.dumps(answer) + "\n").encode())
        return True

    def _answer(self, mutant: Mutant, functions: list, tests: dict, limit: float) -> tuple[str, str]:
        """Return the outcome of a mutant, and the test that decides it."""
        if not tests or not functions or mutant.names:
            return "slow", ""
        outcome, failed = forked(partial(_swapped, mutant, functions, list(tests.values())), limit, self.end)
        if outcome == LATE:
            return LATE, ""
        if outcome == "passed":
            code = functions[0].__code__
            return "slow" if (code.co_filename, code.co_qualname) in self.called else "alive", ""
        if outcome not in ("failed", "killed"):
            return outcome, ""
        key = (failed,) if failed else tuple(tests)  # all tests, if they took too long
        if key not in self.sound:
            again = [one for name, one in tests.items() if name in key]
            self.sound[key] = forked(partial(_swapped, mutant, [], again), limit, self.end)[0] == "passed"
        return "caught" if self.sound[key] else "fails without a mutant", failed


def _swapped(mutant: Mutant, functions: list[types.FunctionType], tests: list, tell: int) -> int:
    """Run tests with a mutant's code in a function."""
    codes = [compile(ast.fix_missing_locations(mutant.tree()), str(ROOT / "aerokernels" / mutant.module), "exec")]
    for one in codes:
        codes += [inner for inner in one.co_consts if isinstance(inner, types.CodeType)]
    for function in functions:
        old = function.__code__
        function.__code__ = next(
            one for one in codes if (one.co_qualname, one.co_firstlineno) == (old.co_qualname, old.co_firstlineno)
        )
    watch = _Watch([], tell)
    tests[0].config.pluginmanager.register(watch)
    for item, following in zip(tests, [*tests[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if watch.failed:
            return 1
    return 0


class _Watch:
    """Plugin of pytest: runs tests in the order of their cost, and reports the name of the one that fails."""

    def __init__(self, names: list[str], tell: int):
        self.rank = {_test_of(name): place for place, name in reversed([*enumerate(names)])}
        self.tell, self.failed = tell, False

    def pytest_collection_finish(self, session) -> None:
        """Select the requested tests alone, all their cases, the quick ones first."""
        session.items[:] = sorted(
            (item for item in session.items if _test_of(item.nodeid) in self.rank),
            key=lambda item: self.rank[_test_of(item.nodeid)],
        )

    def pytest_runtest_logreport(self, report) -> None:
        """Report a failure."""
        if report.failed:
            self.failed = True
            os.write(self.tell, report.nodeid.encode())


def imported(mutant: Mutant, tree: ast.Module | None, names: list[str], tell: int) -> int:
    """Run tests with a tree in place of the mutant's module, in a process that has not imported the package."""
    import pytest

    sys.meta_path.insert(0, _Mutated(dotted(mutant.module), ROOT / "aerokernels" / mutant.module, tree))
    files = dict.fromkeys(name.partition("::")[0] for name in names)
    return int(pytest.main(["-x", *OPTIONS, *files], plugins=[_Watch(names, tell)]))


def _test_of(name: str) -> str:
    return name.partition("[")[0]


def dotted(module: str) -> str:
    """Return the module name of a file of the package."""
    return "aerokernels." + module.removesuffix(".py").replace("/", ".")


def silence(*streams: int) -> None:
    """Connect standard streams to the null device."""
    null = os.open(os.devnull, os.O_RDWR)
    for stream in streams:
        os.dup2(null, stream)


def _answers(pipe: int) -> Iterator[tuple[int, str, str]]:
    """Yield the answers that forked processes write to a pipe, until they close it."""
    with os.fdopen(pipe, encoding="utf-8") as lines:
        for line in lines:
            place, outcome, failed = json.loads(line)
            yield place, outcome, failed


def forked(run: Callable[[int], int], seconds: float, end: float) -> tuple[str, str]:
    """Run a function in a fork: "passed", "failed", "killed" after so many seconds, or "late"; and its output."""
    told, tell = os.pipe()
    child = os.fork()
    if not child:
        status = 1
        with contextlib.suppress(BaseException):
            os.setsid()  # processes that its tests start end with it
            silence(0, 1, 2)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            status = BROKEN
            status = run(tell)
        os._exit(min(status, 100))
    os.close(tell)
    latest = time.monotonic() + 10.0 * seconds + 60.0
    while not os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
        if time.monotonic() > min(latest, end):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(child, 9)
            os.kill(child, 9)
            break
        time.sleep(0.01)
    _, status = os.waitpid(child, 0)
    failed = os.read(told, 10_000).decode()
    os.close(told)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) == BROKEN:
        return "its tests could not be run", ""
    if os.WIFSIGNALED(status) and end < min(latest, time.monotonic()):
        return LATE, ""
    return "killed" if os.WIFSIGNALED(status) else "failed" if status else "passed", failed


def in_turn(
    places: Iterable[int], work: Callable[[int], tuple[str, str]], processes: int, end: float
) -> Iterator[tuple[int, str, str]]:
    """Yield the answer for each position, as they arrive, from forked processes that each take the next position."""
    queue, give = os.pipe()
    told, tell = os.pipe()
    give_all = b"".join(place.to_bytes(2, "little") for place in places)
    assert len(give_all) <= 65_536, "more than a pipe holds"
    os.write(give, give_all)
    os.close(give)
    children = []
    for _ in range(processes):
        if child := os.fork():
            children.append(child)
            continue
        status = 1
        with contextlib.suppress(BaseException):
            while time.monotonic() < end and (taken := os.read(queue, 2)):
                place = int.from_bytes(taken, "little")
                answer = work(place)
                if answer[0] != LATE:
                    os.write(tell, (json.dumps([place, *answer]) + "\n").encode())
            status = 0
        os._exit(status)
    os.close(queue)
    os.close(tell)
    yield from _answers(told)
    if sum(os.waitpid(child, 0)[1] for child in children):
        raise SystemExit("the tests could not be run: run them without mutants")


def fast(waiting: list[Waiting], processes: int, end: float) -> Iterator[tuple[int, str, str]]:
    """Yield the answers of the forks of one process that has collected the tests."""
    told, tell = os.pipe()
    child = os.fork()
    if not child:
        status = 1
        with contextlib.suppress(BaseException):
            os.close(told)
            silence(0, 1)
            import pytest

            files = sorted({name.split("::")[0] for _, names, _ in waiting for name in names})
            plugins = [_Fast(waiting, processes, end, tell)]
            status = int(pytest.main([*OPTIONS, "-s", *files], plugins=plugins))
        os._exit(min(status, 100))
    os.close(tell)
    yield from _answers(told)
    if os.waitpid(child, 0)[1]:
        raise SystemExit("the tests could not be collected: run them without mutants")
