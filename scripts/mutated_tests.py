"""Measure by coverage.py which tests run which functions of the numerical core, for scripts/mutate.

Each test file runs in a forked process. Each test, and each fixture that several tests share, has its own context. What
a shared fixture runs counts for every test that requests it, and caches of a test module are cleared before each of its
tests. A test that takes longer than --longest seconds of computing is aborted and left out, as is one that fails. The
measurements are stored in build/mutated_tests, one file per test file; an unchanged test file is not measured again.
From these build/mutated_tests.json is made: for each function the quickest tests that run it. Where files are named,
their tests alone are replaced in the list, and a function gets at most a quarter of its seconds and tests from them.
Only Python code is measured, not kernels. Needs `fork`.
"""

import argparse
import ast
import contextlib
import functools
import importlib
import json
import os
import signal
import sys
import time
import tomllib
from collections import defaultdict
from pathlib import Path

import pytest
from mutant_forks import silence

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "aerokernels"
MADE = ROOT / "build" / "mutated_tests.json"
MEASURED = ROOT / "build" / "mutated_tests"
MODULES = list(tomllib.loads((ROOT / "scripts" / "mutated_modules.toml").read_text(encoding="utf-8"))["modules"])
# Tests of whole commands, boards and documents are left out: they take minutes, or run the core in other processes.
FOLDERS = (
    "echo", "fldi", "flow", "imaging", "jobs", "medium", "physics", "rays", "schlieren", "series", "strehl", "stress",
    "tracing", "wavefront", "waves",
)  # fmt: skip


class TooLong(BaseException):
    """A test took longer than is useful here."""


def _too_long(*_) -> None:
    raise TooLong


class Recorder:
    """Plugin of pytest: sets coverage's context to the test, and records its computing time and whether it passed."""

    def __init__(self, coverage, longest: float, file_seconds: float):
        """Take a running coverage, and the limits of a test's and a file's computing time [s]."""
        self.coverage, self.longest, self.file_seconds = coverage, longest, file_seconds
        self.cost: dict[str, float] = {}
        self.shared: dict[str, set[str]] = defaultdict(set)
        self.passed: set[str] = set()
        self.began, self.others = 0.0, 0.0

    def pytest_sessionstart(self) -> None:
        """Start the clock of computing time, of the process and its threads."""
        signal.signal(signal.SIGPROF, _too_long)
        self.first = time.process_time()

    def pytest_runtest_protocol(self, item, nextitem):
        """Start a context and a clock for each test."""
        for cached in list(vars(item.module).values()):
            if isinstance(cached, functools._lru_cache_wrapper):
                cached.cache_clear()
        self.coverage.switch_context(item.nodeid)
        self.began, self.others = time.process_time(), 0.0
        if self.began - self.first > self.file_seconds:
            item.session.shouldstop = "long enough"
        self.item = item.nodeid
        signal.setitimer(signal.ITIMER_PROF, self.longest)

    def pytest_runtest_logreport(self, report) -> None:
        """Record a test that passed, and its time."""
        if report.when == "call" and report.passed:
            self.passed.add(report.nodeid)
        if report.when == "teardown":
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            self.cost[report.nodeid] = time.process_time() - self.began - self.others

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef, request):
        """Give a fixture of a module or wider its own context."""
        if fixturedef.scope == "function":
            return (yield)
        name = f"fixture:{fixturedef.baseid}:{fixturedef.argname}"
        began = time.process_time()
        self.coverage.switch_context(name)
        try:
            return (yield)
        finally:
            self.coverage.switch_context(self.item)
            took = time.process_time() - began
            self.others += took
            self.cost[name] = took

    def pytest_collection_finish(self, session) -> None:
        """Record which shared fixtures each test requests."""
        for item in session.items:
            manager = item._fixtureinfo
            for name, found in manager.name2fixturedefs.items():
                for one in found:
                    if one.scope != "function":
                        self.shared[item.nodeid].add(f"fixture:{one.baseid}:{name}")


def measure(file: Path, longest: float, file_seconds: float) -> dict:
    """Return what each test of a file runs; runs in this process."""
    import coverage

    core = {str(PACKAGE / module): module for module in MODULES}
    watch = coverage.Coverage(data_file=None, include=list(core), config_file=False)
    watch.start()
    recorder = Recorder(watch, longest, file_seconds)
    with contextlib.suppress(TooLong):
        pytest.main(["-q", "-p", "no:cacheprovider", str(file)], plugins=[recorder])
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    watch.stop()
    lines: dict[str, dict[str, set[int]]] = defaultdict(lambda: defaultdict(set))
    data = watch.get_data()
    for path in data.measured_files():
        if path in core:
            for line, contexts in data.contexts_by_lineno(path).items():
                for context in contexts:
                    lines[context][core[path]].add(line)
    spans = {module: functions(module) for module in MODULES}
    tests = {}
    for name in sorted(recorder.passed):
        ran: dict[str, set[int]] = defaultdict(set)
        contexts = [name, *sorted(recorder.shared[name])]
        for context in contexts:
            for module, found in lines[context].items():
                for function, first, last in spans[module]:
                    if inside := {line - first for line in found if first <= line <= last}:
                        ran[f"{module}::{function}"] |= inside
        cost = sum(recorder.cost.get(context, 0.0) for context in contexts)
        tests[name] = {"cost": round(cost, 3), "ran": {function: sorted(found) for function, found in ran.items()}}
    return tests


def functions(module: str) -> list[tuple[str, int, int]]:
    """Return a module's functions with their first and last lines, inner ones as part of the outer ones."""
    found = []

    def walk(node: ast.AST, prefix: str) -> None:
        for inner in ast.iter_child_nodes(node):
            if isinstance(inner, (ast.FunctionDef, ast.AsyncFunctionDef)):
                found.append((prefix + inner.name, inner.body[0].lineno, inner.end_lineno or inner.lineno))
            elif isinstance(inner, ast.ClassDef):
                walk(inner, f"{prefix}{inner.name}.")
            elif isinstance(inner, (ast.If, ast.With, ast.Try)):
                walk(inner, prefix)

    walk(ast.parse((PACKAGE / module).read_text(encoding="utf-8")), "")
    return found


def chosen(tests: dict[str, dict], seconds: float, most: int) -> dict[str, list[str]]:
    """Return for each function the quickest tests that run all its lines, then again of the other tests, and so on."""
    ran: dict[str, list[tuple[float, str, set[int]]]] = defaultdict(list)
    for name, one in tests.items():
        for function, lines in one["ran"].items():
            ran[function].append((one["cost"] + 0.02, name, set(lines)))
    return {
        function: _covers(ran[function], seconds, most)
        for module in MODULES
        for function in (f"{module}::{name}" for name, _, _ in functions(module))
    }


def _covers(tests: list[tuple[float, str, set[int]]], seconds: float, most: int) -> list[str]:
    """Select repeatedly the quickest case of each test, first those that run lines not covered yet."""
    groups: dict[str, list[tuple[float, str, set[int]]]] = defaultdict(list)
    for one in sorted(tests, key=lambda one: one[:2]):
        groups[one[1].split("[")[0]].append(one)
    picked: list[tuple[float, str, set[int]]] = []
    seen: set[int] = set()
    spent = 0.0
    while groups and len(picked) < most:
        for name in sorted(groups, key=lambda name: groups[name][0][0]):
            waiting = groups[name]
            one = max(waiting, key=lambda one: (len(one[2] - seen), -one[0]))
            waiting.remove(one)
            if len(picked) < most and (not picked or spent + one[0] <= seconds):
                picked.append(one)
                spent += one[0]
                seen |= one[2]
        groups = {name: waiting for name, waiting in groups.items() if waiting}
        if spent > 0.5 * seconds:
            break
    return [name for _, name, _ in sorted(picked, key=lambda one: one[:2])]


def written(seconds: float, most: int, files: list[Path]) -> None:
    """Write the list from all measurements, or replace the tests of some files in it."""
    tests: dict[str, dict] = {}
    for place in [_place(file) for file in files] or sorted(MEASURED.glob("*.json")):
        tests |= json.loads(place.read_text(encoding="utf-8"))
    if files:
        functions_tests = chosen(tests, 0.25 * seconds, most // 4)
        kept, before = _kept({str(file.relative_to(ROOT)) for file in files})
        tests |= kept
        for function, names in functions_tests.items():
            names += before.get(function, [])
    else:
        functions_tests = chosen(tests, seconds, most)
    files: dict[str, list[str]] = defaultdict(list)
    for name in sorted({name for names in functions_tests.values() for name in names}):
        files[name.partition("::")[0]].append(name)
    number = {name: place for place, name in enumerate(name for names in files.values() for name in names)}

    def row(one: object) -> str:
        return json.dumps(one, separators=(",", ":"))

    rows = [
        f"{row(file)}: {row([[name.partition('::')[2], tests[name]['cost']] for name in names])}"
        for file, names in files.items()
    ]
    lists = [f"{row(name)}: {row(sorted(number[one] for one in names))}" for name, names in functions_tests.items()]
    text = '{"tests": {\n' + ",\n".join(rows) + '\n},\n"functions": {\n' + ",\n".join(lists) + "\n}}\n"
    MADE.write_text(text, encoding="utf-8")
    bare = [name for name, names in functions_tests.items() if not names]
    print(f"{len(functions_tests)} functions, {len(number)} tests; {len(bare)} functions that none of them runs")


def _kept(replaced: set[str]) -> tuple[dict[str, dict], dict[str, list[str]]]:
    """Return the tests of the list that are not of replaced files, and the functions' tests among them."""
    listed = json.loads(MADE.read_text(encoding="utf-8")) if MADE.exists() else {"tests": {}, "functions": {}}
    names = [(f"{file}::{name}", cost) for file, tests in listed["tests"].items() for name, cost in tests]
    kept = {name: {"cost": cost} for name, cost in names if name.partition("::")[0] not in replaced}
    functions_tests = {
        function: [name for name, _ in (names[k] for k in numbers) if name in kept]
        for function, numbers in listed["functions"].items()
    }
    return kept, functions_tests


def _place(file: Path) -> Path:
    """Return the file that holds the measurement of a test file."""
    return MEASURED / (str(file.relative_to(ROOT)).replace("/", "+") + ".json")


def measured(files: list[Path], longest: float, file_seconds: float, seconds: float, processes: int) -> None:
    """Measure test files, some at a time and the largest first, until the time is over."""
    end = time.monotonic() + seconds
    MEASURED.mkdir(parents=True, exist_ok=True)
    running: dict[int, tuple[Path, float]] = {}
    for file in sorted(files, key=lambda file: -file.stat().st_size):
        place = _place(file)
        if place.exists() and place.stat().st_mtime > file.stat().st_mtime:
            continue
        if len(running) == processes:
            _wait(running)
        if time.monotonic() > end:
            break
        child = os.fork()
        if not child:
            status = 1
            try:
                silence(0, 1)
                tests = measure(file, longest, file_seconds)
                written = place.with_suffix(".part")
                written.write_text(json.dumps(tests), encoding="utf-8")
                written.replace(place)
                status = 0
            finally:
                os._exit(status)
        running[child] = (file, time.monotonic())
    while running:
        _wait(running)


def _wait(running: dict[int, tuple[Path, float]]) -> None:
    """Wait until one of the processes ends, and print its time."""
    child, status, used = os.wait4(-1, 0)
    file, began = running.pop(child)
    told = f"{used.ru_utime + used.ru_stime:.0f} s of computing in {time.monotonic() - began:.0f} s, status {status}"
    print(f"{file.relative_to(ROOT)}: {told}", flush=True)


def main() -> int:
    """Measure what is not measured yet, and write the list."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="*", type=Path, help="files of tests; all that concern the core")
    parser.add_argument("--longest", type=float, default=10.0, help="seconds of computing that a test may take")
    parser.add_argument("--file-seconds", type=float, default=60.0, help="of a file; the rest of it is left out")
    parser.add_argument("--seconds", type=float, default=20.0, help="of tests for a function")
    parser.add_argument("--most", type=int, default=48, help="tests for a function")
    parser.add_argument("--processes", type=int, default=1, help="files at a time")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further file after this long")
    given = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    for module in MODULES:
        importlib.import_module("aerokernels." + module.removesuffix(".py").replace("/", "."))
    import hypothesis.internal.conjecture.engine  # noqa: F401 - imported before processes fork
    import numpy  # noqa: F401
    import scipy.interpolate
    import scipy.optimize
    import scipy.signal
    import scipy.special  # noqa: F401
    import warp  # noqa: F401
    import xarray  # noqa: F401

    tests = ROOT / "tests"
    every = [
        *sorted(tests.glob("test_*.py")),
        *(file for name in FOLDERS for file in (tests / name).rglob("test_*.py")),
    ]
    files = [file.resolve() for file in given.files] or every
    measured(files, given.longest, given.file_seconds, 60.0 * given.minutes, given.processes)
    written(given.seconds, given.most, [file.resolve() for file in given.files])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
