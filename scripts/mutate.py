"""Mutate the numerical core: change one operator, comparison, number or condition, and run the tests concerned.

The tests of a mutant are those that scripts/mutated_tests found to run its function, the quickest first, limited to
some seconds; for a constant of a module or a class, those of the functions of any module that name it (a constant that
kernels alone read has none). A mutant is caught if a test fails, an exception gets out, or the tests take three times
as long. The test that caught it is run once without the mutant, and must pass. Mutants are chosen at random among all
of a module's; scripts/mutants.py says what is left out.

scripts/mutants_without_effect.toml lists survivors that were read and found unable to change a result, with the reason.
Two fractions are printed with their standard errors, with and without those. The sources are not touched: each mutant
lives in a forked process. Needs `fork`.
"""

import argparse
import ast
import contextlib
import itertools
import json
import os
import random
import resource
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from mutant_forks import Waiting, fast, forked, imported, in_turn
from mutants import ROOT, RULES, Mutant, changes, places

CORE: list[str] = tomllib.loads((ROOT / "scripts" / "mutated_modules.toml").read_text(encoding="utf-8"))["modules"]
MADE = ROOT / "build" / "mutated_tests.json"  # written by scripts/mutated_tests
SECONDS = 20.0  # of tests for one mutant


class Suite:
    """The tests of each mutant, and which of them pass without a mutant."""

    def __init__(self) -> None:
        """Read the list of tests.

        Raises:
            SystemExit: There is none.
        """
        if not MADE.exists():
            raise SystemExit(f"there is no {MADE.relative_to(ROOT)}: first run scripts/mutated_tests, which makes it")
        listed = json.loads(MADE.read_text(encoding="utf-8"))
        self.cost = {f"{file}::{name}": cost for file, tests in listed["tests"].items() for name, cost in tests}
        names = list(self.cost)
        self.of = {
            function: sorted((names[k] for k in numbers), key=lambda name: self.cost[name])
            for function, numbers in listed["functions"].items()
        }
        self.sound: dict[tuple[str, ...], bool] = {}
        self.named = {
            f"{module}::{name}": said for module in CORE for name, said in _named(ROOT / "aerokernels" / module).items()
        }

    def tests(self, mutant: Mutant) -> list[str]:
        """Return names of tests, the quick ones first."""
        if found := self.of.get(f"{mutant.module}::{mutant.function}"):
            return found
        using = [name for name, said in self.named.items() if said & mutant.names]
        using.sort(key=lambda name: not name.startswith(f"{mutant.module}::"))  # those of its own module first
        return self._of_all([*using, *(name for name in self.named if name.startswith(f"{mutant.module}::"))])

    def _of_all(self, functions: list[str]) -> list[str]:
        """Return tests of some functions, alternating between the functions."""
        turns = itertools.zip_longest(*(self.of.get(name, []) for name in functions))
        found, spent = [], 0.0
        for test in dict.fromkeys(one for turn in turns for one in turn if one is not None):
            if spent + self.cost[test] <= SECONDS:
                found.append(test)
                spent += self.cost[test]
        return sorted(found, key=lambda test: self.cost[test])

    def limit(self, mutant: Mutant) -> float:
        """Limit of the computing time of a mutant's tests [s]."""
        return 3.0 * sum(self.cost[name] for name in self.tests(mutant)) + 10.0

    def caught(
        self, mutants: list[Mutant], end: float, processes: int
    ) -> Iterator[tuple[Mutant, bool, str, list[str]]]:
        """Yield for each mutant whether a test notices it, the reason, and its tests; stop when the time is over."""
        waiting = [Waiting(mutant, self.tests(mutant), self.limit(mutant)) for mutant in mutants]
        slow = []
        for place, answer, failed in fast(waiting, processes, end):
            if answer == "slow" and waiting[place].names:
                slow.append(place)
            else:
                yield self._told(waiting[place], answer, failed)
        for place, answer, failed in in_turn(slow, lambda place: self._slow(*waiting[place], end), processes, end):
            yield self._told(waiting[place], answer, failed)

    def _told(self, one: Waiting, answer: str, failed: str) -> tuple[Mutant, bool, str, list[str]]:
        why = failed if answer == "caught" else "" if answer == "alive" else answer if one.names else "no test runs it"
        return one.mutant, answer == "caught", why, one.names

    def _slow(self, mutant: Mutant, names: list[str], limit: float, end: float) -> tuple[str, str]:
        """Return the answer for a mutant that must be imported with its module."""
        outcome, failed = forked(partial(imported, mutant, mutant.tree(), names), limit, end)
        if outcome == "passed":
            return "alive", ""
        if outcome not in ("failed", "killed"):
            return outcome, ""
        if outcome == "failed" and not failed:  # the module could not be imported
            return "caught", ""
        key = (failed,) if failed else tuple(names)
        if key not in self.sound:
            self.sound[key] = forked(partial(imported, mutant, None, list(key)), limit, end)[0] == "passed"
        return "caught" if self.sound[key] else "fails without a mutant", failed


def _named(path: Path) -> dict[str, set[str]]:
    """Return the names that each function of a module mentions."""
    inside: dict[int, tuple[str, frozenset[str]]] = {}
    tree = ast.parse(path.read_text(encoding="utf-8"))
    places(tree, "", inside)
    said: dict[str, set[str]] = {}
    for node in ast.walk(tree):
        if (function := inside.get(id(node), ("", ()))[0]) and isinstance(node, (ast.Name, ast.Attribute)):
            said.setdefault(function, set()).add(node.id if isinstance(node, ast.Name) else node.attr)
    return said


def share(good: int, total: int) -> str:
    """Return a fraction with its standard error, as text."""
    part = good / max(total, 1)
    return f"{good} of {total} caught, {100 * part:.1f} +- {100 * (part * (1.0 - part) / max(total, 1)) ** 0.5:.1f} %"


def main() -> int:
    """Test random mutants, of each module in turn or of all together, until the count or the time is reached."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=f"of {', '.join(CORE)}; all of them")
    parser.add_argument("--count", type=int, default=40, help="mutants of each module")
    parser.add_argument("--total", type=int, help="instead: so many of all their mutants, each as likely as another")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further mutant after this long")
    parser.add_argument("--processes", type=int, default=1, help="mutants at a time")
    parser.add_argument("--out", type=Path, help="write every answer to this file, a JSON object a line")
    parser.add_argument("--verbose", action="store_true", help="tell which test catches which mutant")
    parser.add_argument("--rules", action="store_true", help="count what each rule leaves out, and try nothing")
    given = parser.parse_args()
    if unknown := set(given.modules) - set(CORE):
        parser.error(f"no module {', '.join(sorted(unknown))}: choose of {', '.join(CORE)}")
    chosen = given.modules or CORE
    left_out: Counter[str] = Counter()
    texts = {module: (ROOT / "aerokernels" / module).read_text("utf-8") for module in chosen}
    every = {module: changes(module, text, left_out) for module, text in texts.items()}
    if given.rules:
        print("\n".join(f"{left_out[rule]} {rule}: {said}" for rule, said in RULES.items()))
        print(f"{sum(map(len, every.values()))} mutants are left")
        return 0
    _prepare()
    draw, end = random.Random(given.seed), time.monotonic() + 60.0 * given.minutes
    if given.total is None:
        parts = [draw.sample(found, min(given.count, len(found))) for found in every.values()]
        waiting = [one for turn in itertools.zip_longest(*parts) for one in turn if one is not None]
    else:
        pool = [one for found in every.values() for one in found]
        waiting = draw.sample(pool, min(given.total, len(pool)))
    tried = []
    for mutant, caught, why, names in Suite().caught(waiting, end, given.processes):
        tried.append((mutant, caught))
        if given.out:
            told = {"module": mutant.module, "line": mutant.line, "change": mutant.told, "code": mutant.code}
            told |= {"function": mutant.function, "caught": caught, "why": why, "tests": len(names)}
            with given.out.open("a", encoding="utf-8") as out:
                print(json.dumps(told), file=out)
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
    """Import what tests import before a process forks, but not the package."""
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
        import warp  # noqa: F401 - imported here, started in the child
        import xarray  # noqa: F401
    hypothesis.settings.register_profile("mutants", database=None)  # a failure by a mutant is no example to store
    hypothesis.settings.load_profile("mutants")


if __name__ == "__main__":
    raise SystemExit(main())
