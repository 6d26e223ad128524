"""Mutants of the numerical core: one operator, comparison, number or condition changed, and tests that run it.

The tests of a mutant are those that scripts/mutated_tests found to run its function, the quickest first, some
seconds of them at most; of a constant of a module or a class, those of the functions that name it. A mutant is caught
where a test fails, an exception gets out, or the tests take three times as long; what caught it is run once without
the mutant, and must pass. Drawn at random of all that a module has; scripts/mutants.py says what is not drawn.

Survivors that were read and cannot change a result either stand in scripts/mutants_without_effect.toml, with the
reason; two shares are given with their standard errors, of all that were drawn and without those. The sources are not
touched: each mutant lives in a forked process. Needs `fork`.
"""

import argparse
import ast
import contextlib
import gc
import importlib.abc
import importlib.util
import itertools
import json
import os
import random
import resource
import sys
import time
import tomllib
import types
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from mutants import ROOT, Mutant, changes, places

CORE: list[str] = tomllib.loads((ROOT / "scripts" / "mutated_modules.toml").read_text(encoding="utf-8"))["modules"]
MADE = ROOT / "scripts" / "mutated_tests.json"  # by scripts/mutated_tests
SECONDS = 6.0  # of tests for one mutant
BROKEN = 99  # status of a process in which no test could be run
OPTIONS = ("-q", "-p", "no:cacheprovider", "--hypothesis-seed=0")


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives the mutant in place of its module."""

    def __init__(self, name: str, path: Path, tree: ast.Module | None):
        self.name, self.path, self.tree = name, path, tree

    def find_spec(self, name, path=None, target=None):
        """Only the one module."""
        return importlib.util.spec_from_loader(name, self, origin=str(self.path)) if name == self.name else None

    def exec_module(self, module) -> None:
        """Run the mutant."""
        module.__file__ = str(self.path)
        tree = self.tree if self.tree is not None else ast.parse(self.path.read_text(encoding="utf-8"))
        exec(compile(ast.fix_missing_locations(tree), str(self.path), "exec"), module.__dict__)


class _Fast:
    """Plugin of pytest: each mutant of a function in a fork of the process that has collected the tests.

    Only its code is changed: what was called when modules were imported may stand in a constant.
    """

    def __init__(self, waiting: list[tuple[Mutant, list[str], float]], end: float, tell: int):
        self.waiting, self.end, self.tell = waiting, end, tell
        self.called: set[tuple[str, str]] = set()
        self.sound: dict[tuple[str, ...], bool] = {}

    def pytest_sessionstart(self) -> None:
        """Note what is called from now on."""
        core = str(ROOT / "aerokernels")

        def note(frame, event, _) -> None:
            if event == "call" and frame.f_code.co_filename.startswith(core):
                self.called.add((frame.f_code.co_filename, frame.f_code.co_qualname.split(".<locals>")[0]))

        sys.setprofile(note)
        for module in CORE:
            importlib.import_module(_dotted(module))
        sys.setprofile(None)

    def pytest_runtestloop(self, session) -> bool:
        """All mutants in turn."""
        items = {item.nodeid: item for item in session.items}
        gc.unfreeze()
        places = {}
        for one in gc.get_objects():
            if type(one) is types.FunctionType:
                places.setdefault((one.__code__.co_filename, one.__code__.co_qualname), []).append(one)
        gc.freeze()
        with os.fdopen(self.tell, "w", encoding="utf-8") as out:
            for place, (mutant, names, limit) in enumerate(self.waiting):
                if time.monotonic() > self.end:
                    break
                tests = {name: items[name] for name in names if name in items}  # one may be gone since
                functions = places.get((str(ROOT / "aerokernels" / mutant.module), mutant.function), [])
                print(json.dumps([place, *self._answer(mutant, functions, tests, limit)]), file=out, flush=True)
        return True

    def _answer(self, mutant: Mutant, functions: list, tests: dict, limit: float) -> tuple[str, str]:
        """What becomes of a mutant, and the test that tells."""
        if not tests or not functions or mutant.names:
            return "slow", ""
        outcome, failed = _forked(partial(_swapped, mutant, functions, list(tests.values())), limit)
        if outcome == "passed":
            code = functions[0].__code__
            return "slow" if (code.co_filename, code.co_qualname) in self.called else "alive", ""
        key = (failed,) if failed else tuple(tests)  # all, where they took too long
        if key not in self.sound:
            again = [one for name, one in tests.items() if name in key]
            self.sound[key] = _forked(partial(_swapped, mutant, [], again), limit)[0] == "passed"
        return "caught" if self.sound[key] else "fails without a mutant", failed


def _swapped(mutant: Mutant, functions: list[types.FunctionType], tests: list, tell: int) -> int:
    """Run tests with another code in a function."""
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
    """Plugin of pytest: tests in the order of their cost, and the name of the one that fails."""

    def __init__(self, names: list[str], tell: int):
        self.rank = {_test_of(name): place for place, name in reversed([*enumerate(names)])}
        self.tell, self.failed = tell, False

    def pytest_collection_finish(self, session) -> None:
        """Those asked for alone, all their cases, the quick ones first."""
        session.items[:] = sorted(
            (item for item in session.items if _test_of(item.nodeid) in self.rank),
            key=lambda item: self.rank[_test_of(item.nodeid)],
        )

    def pytest_runtest_logreport(self, report) -> None:
        """Tell what fails."""
        if report.failed:
            self.failed = True
            os.write(self.tell, report.nodeid.encode())


def _imported(mutant: Mutant, tree: ast.Module | None, names: list[str], tell: int) -> int:
    """Run tests with a tree in place of the mutant's module, in a process that has not imported the package."""
    import pytest

    sys.meta_path.insert(0, _Mutated(_dotted(mutant.module), ROOT / "aerokernels" / mutant.module, tree))
    files = dict.fromkeys(name.partition("::")[0] for name in names)
    return int(pytest.main(["-x", *OPTIONS, *files], plugins=[_Watch(names, tell)]))


def _test_of(name: str) -> str:
    return name.partition("[")[0]


def _dotted(module: str) -> str:
    return "aerokernels." + module.removesuffix(".py").replace("/", ".")


def _forked(run: Callable[[int], int], seconds: float) -> tuple[str, str]:
    """Whether it "passed" in a forked process, "failed", or was "killed" after so many seconds; and what it told."""
    told, tell = os.pipe()
    child = os.fork()
    if not child:
        status = 1
        with contextlib.suppress(BaseException):
            hush = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(hush, stream)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            status = BROKEN
            status = run(tell)
        os._exit(min(status, 100))
    os.close(tell)
    end = time.monotonic() + 10.0 * seconds + 60.0
    while not os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
        if time.monotonic() > end:
            os.kill(child, 9)
        time.sleep(0.01)
    _, status = os.waitpid(child, 0)
    failed = os.read(told, 10_000).decode()
    os.close(told)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) == BROKEN:
        raise SystemExit("tests could not be run")
    return "killed" if os.WIFSIGNALED(status) else "failed" if status else "passed", failed


class Suite:
    """The tests of each mutant, and which of them pass without one."""

    def __init__(self, every: dict[str, list[Mutant]]):
        """Read the list."""
        listed = json.loads(MADE.read_text(encoding="utf-8"))
        self.cost = {f"{file}::{name}": cost for file, tests in listed["tests"].items() for name, cost in tests}
        names = list(self.cost)
        self.of = {
            function: sorted((names[k] for k in numbers), key=lambda name: self.cost[name])
            for function, numbers in listed["functions"].items()
        }
        self.sound: dict[tuple[str, ...], bool] = {}
        self.named = {module: _named(ROOT / "aerokernels" / module) for module in every}

    def tests(self, mutant: Mutant) -> list[str]:
        """Names of tests, the quick ones first."""
        if found := self.of.get(f"{mutant.module}::{mutant.function}"):
            return found
        named = self.named[mutant.module]
        using = [name for name, said in named.items() if said & mutant.names]
        return self._of_all(mutant.module, [*using, *named])

    def _of_all(self, module: str, functions: list[str]) -> list[str]:
        """Tests of some functions of a module in turn."""
        turns = itertools.zip_longest(*(self.of.get(f"{module}::{name}", []) for name in functions))
        found, spent = [], 0.0
        for test in dict.fromkeys(one for turn in turns for one in turn if one is not None):
            if spent + self.cost[test] <= SECONDS:
                found.append(test)
                spent += self.cost[test]
        return sorted(found, key=lambda test: self.cost[test])

    def limit(self, mutant: Mutant) -> float:
        """Seconds of computing that they may take."""
        return 3.0 * sum(self.cost[name] for name in self.tests(mutant)) + 10.0

    def caught(self, mutants: list[Mutant], end: float) -> Iterator[tuple[Mutant, bool, str]]:
        """Whether a test notices each mutant, and which; fewer than there are where the time is over."""
        waiting = [(mutant, self.tests(mutant), self.limit(mutant)) for mutant in mutants]
        for place, answer, failed in list(_fast(waiting, end)):
            mutant, names, limit = waiting[place]
            if answer == "slow" and names:
                answer, failed = self._slow(mutant, names, limit)
            why = failed if answer == "caught" else "" if answer == "alive" else answer if names else "no test runs it"
            yield mutant, answer == "caught", why

    def _slow(self, mutant: Mutant, names: list[str], limit: float) -> tuple[str, str]:
        """The answer where the module is imported with the mutant in it."""
        outcome, failed = _forked(partial(_imported, mutant, mutant.tree(), names), limit)
        if outcome == "passed":
            return "alive", ""
        if outcome == "failed" and not failed:  # it could not be imported
            return "caught", ""
        key = (failed,) if failed else tuple(names)
        if key not in self.sound:
            self.sound[key] = _forked(partial(_imported, mutant, None, list(key)), limit)[0] == "passed"
        return "caught" if self.sound[key] else "fails without a mutant", failed


def _fast(waiting: list[tuple[Mutant, list[str], float]], end: float) -> list[tuple[int, str, str]]:
    """What the forks of one process find."""
    told, tell = os.pipe()
    child = os.fork()
    if not child:
        status = 1
        with contextlib.suppress(BaseException):
            os.close(told)
            hush = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1):
                os.dup2(hush, stream)
            import pytest

            files = sorted({name.split("::")[0] for _, names, _ in waiting for name in names})
            status = int(pytest.main([*OPTIONS, "-s", *files], plugins=[_Fast(waiting, end, tell)]))
        os._exit(min(status, 100))
    os.close(tell)
    with os.fdopen(told, encoding="utf-8") as lines:
        found = [tuple(json.loads(line)) for line in lines]
    if os.waitpid(child, 0)[1]:
        raise SystemExit("the tests could not be collected: run them without mutants")
    return found


def _named(path: Path) -> dict[str, set[str]]:
    """The names that each function of a module says."""
    inside: dict[int, tuple[str, frozenset[str]]] = {}
    tree = ast.parse(path.read_text(encoding="utf-8"))
    places(tree, "", inside)
    said: dict[str, set[str]] = {}
    for node in ast.walk(tree):
        if (function := inside.get(id(node), ("", ()))[0]) and isinstance(node, (ast.Name, ast.Attribute)):
            said.setdefault(function, set()).add(node.id if isinstance(node, ast.Name) else node.attr)
    return said


def share(good: int, total: int) -> str:
    """A share with its standard error."""
    part = good / max(total, 1)
    return f"{good} of {total} caught, {100 * part:.1f} +- {100 * (part * (1.0 - part) / max(total, 1)) ** 0.5:.1f} %"


def main() -> int:
    """Draw mutants, of each module in turn or of all together, until the count or the time is reached."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=f"of {', '.join(CORE)}; all of them")
    parser.add_argument("--count", type=int, default=40, help="mutants of each module")
    parser.add_argument("--total", type=int, help="instead: so many of all their mutants, each as likely as another")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further mutant after this long")
    parser.add_argument("--verbose", action="store_true", help="tell which test catches which mutant")
    given = parser.parse_args()
    if unknown := set(given.modules) - set(CORE):
        parser.error(f"no module {', '.join(sorted(unknown))}: choose of {', '.join(CORE)}")
    _prepare()
    chosen = given.modules or CORE
    every = {module: changes(module, (ROOT / "aerokernels" / module).read_text("utf-8")) for module in chosen}
    draw, end = random.Random(given.seed), time.monotonic() + 60.0 * given.minutes
    if given.total is None:
        parts = [draw.sample(found, min(given.count, len(found))) for found in every.values()]
        waiting = [one for turn in itertools.zip_longest(*parts) for one in turn if one is not None]
    else:
        pool = [one for found in every.values() for one in found]
        waiting = draw.sample(pool, min(given.total, len(pool)))
    tried = []
    for mutant, caught, why in Suite(every).caught(waiting, end):
        tried.append((mutant, caught))
        if not caught or given.verbose:
            told = "caught" if caught else "without effect" if mutant.without_effect else "survives"
            why = f" ({why})" if why else ""
            print(f"  {told}: {mutant.module}:{mutant.line}: {mutant.told}: {mutant.code}{why}", flush=True)
    for stage in sorted({mutant.module.split("/")[0] for mutant, _ in tried}):
        print(f"{stage}: {_shares([one for one in tried if one[0].module.split('/')[0] == stage])}")
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"all: {_shares(tried)}; of {sum(map(len, every.values()))} mutants of {len(every)} modules, "
          f"{(spent.ru_utime + spent.ru_stime) / max(len(tried), 1):.1f} s of computing each")  # fmt: skip
    return 0


def _shares(tried: list[tuple[Mutant, bool]]) -> str:
    told = share(sum(caught for _, caught in tried), len(tried))
    left = [caught for mutant, caught in tried if caught or not mutant.without_effect]
    return told if len(left) == len(tried) else f"{told}; without those of no effect {share(sum(left), len(left))}"


def _prepare() -> None:
    """What tests import is there when a process forks; the package is not."""
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    import hypothesis
    import hypothesis.internal.conjecture.engine
    import numpy  # noqa: F401
    import pytest  # noqa: F401
    import scipy.interpolate
    import scipy.optimize
    import scipy.signal
    import scipy.special  # noqa: F401

    with contextlib.suppress(ImportError):
        import warp  # noqa: F401 - imported, and not begun: that is the child's
        import xarray  # noqa: F401
    hypothesis.settings.register_profile("mutants", database=None)  # what fails here is no example for later
    hypothesis.settings.load_profile("mutants")


if __name__ == "__main__":
    raise SystemExit(main())
