"""Mutants of the numerical core: one operator, comparison, number or condition changed, and the module's tests run.

A mutant is caught where a test fails, an exception gets out, or the tests take five times as long. Drawn at random of
all that a module has; texts, annotations and messages of exceptions are left alone. The share that is caught is given
with its standard error. The sources are not touched: each mutant lives in a forked process. Needs `fork`.
"""

import argparse
import ast
import contextlib
import copy
import importlib.abc
import importlib.util
import itertools
import os
import random
import resource
import sys
import time
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CORE: dict[str, list[str]] = tomllib.loads((ROOT / "scripts" / "mutated_modules.toml").read_text(encoding="utf-8"))
OTHER: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Div, ast.Mod: ast.Mult,
    ast.Pow: ast.Mult, ast.MatMult: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.Lt: ast.LtE,
    ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot,
    ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And, ast.UAdd: ast.USub,
    ast.USub: ast.UAdd,
}  # fmt: skip
TURNED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}


def changes(tree: ast.Module) -> list[tuple[int, str, Callable[[], ast.Module]]]:
    """Every mutant of a module: line, what is changed, and what makes its tree."""
    found: list[tuple[int, str, Callable[[], ast.Module]]] = []
    left_alone: set[int] = set()
    for node in ast.walk(tree):
        hidden: list[ast.AST | None] = []
        if isinstance(node, ast.Raise):
            hidden = [node]
        elif isinstance(node, ast.FunctionDef):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            hidden = [node.returns, *(one.annotation for one in arguments), *node.decorator_list]
            hidden += [node] if node.name in ("__repr__", "_repr_html_", "plot") else []
        elif isinstance(node, ast.ClassDef):  # what a dataclass refuses is no answer
            hidden = [*node.decorator_list]
        elif isinstance(node, ast.AnnAssign):
            hidden = [node.annotation]
        elif isinstance(node, (ast.JoinedStr, ast.If)) and "TYPE_CHECKING" in ast.dump(node):
            hidden = [node]
        elif isinstance(node, ast.JoinedStr):
            hidden = [node]
        for one in hidden:
            left_alone |= {id(inner) for inner in ast.walk(one)} if one is not None else set()
    for number, node in enumerate(ast.walk(tree)):
        if id(node) in left_alone:
            continue
        for told, change in _of(node):
            found.append((getattr(node, "lineno", 0), told, partial(_mutant, tree, number, change)))
    return found


def _mutant(tree: ast.Module, number: int, change: Callable[[ast.AST], None]) -> ast.Module:
    mutant = copy.deepcopy(tree)
    change(next(inner for k, inner in enumerate(ast.walk(mutant)) if k == number))
    return mutant


def _of(node: ast.AST):
    def swapped(field: str, kind: type, at: int | None = None):
        def change(inner) -> None:
            if at is None:
                setattr(inner, field, kind())
            else:
                getattr(inner, field)[at] = kind()

        return change

    def number(value: float):
        return lambda inner: setattr(inner, "value", value)

    if isinstance(node, (ast.BinOp, ast.AugAssign, ast.BoolOp, ast.UnaryOp)) and type(node.op) in OTHER:
        other = OTHER[type(node.op)]
        yield f"{type(node.op).__name__} -> {other.__name__}", swapped("op", other)
    elif isinstance(node, ast.Compare):
        for at, one in enumerate(node.ops):
            for table in (OTHER, TURNED):
                if type(one) in table:
                    other = table[type(one)]
                    yield f"{type(one).__name__} -> {other.__name__}", swapped("ops", other, at)
    elif isinstance(node, ast.Constant) and type(node.value) is bool:
        yield f"{node.value} -> {not node.value}", number(not node.value)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        value = node.value + 1 if isinstance(node.value, int) else (2.0 * node.value or 1.0)
        yield f"{node.value} -> {value}", number(value)
    elif isinstance(node, (ast.If, ast.IfExp, ast.While)):
        yield "condition -> not", lambda inner: setattr(inner, "test", ast.UnaryOp(ast.Not(), inner.test))


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


def survives(module: str, tree: ast.Module | None, seconds: float) -> bool:
    """Whether the module's tests pass with that tree in its place, within so many seconds of computing."""
    child = os.fork()
    if not child:
        status = 1
        with contextlib.suppress(BaseException):
            hush = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(hush, stream)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            name = "aerokernels." + module.removesuffix(".py").replace("/", ".")
            sys.meta_path.insert(0, _Mutated(name, ROOT / "aerokernels" / module, tree))
            import pytest

            places = [str(ROOT / one) for one in CORE[module]]
            status = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *places]))
        os._exit(min(status, 100))
    end = time.monotonic() + 10.0 * seconds + 60.0
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status == 0
        if time.monotonic() > end:
            os.kill(child, 9)
        time.sleep(0.02)


def rate(modules: list[str], caught: dict[str, int], tried: dict[str, int], sizes: dict[str, int]) -> str:
    """The share that is caught: of those drawn, with its standard error, and each module by its number of mutants."""
    modules = [module for module in modules if tried[module]]
    good, total = sum(caught[module] for module in modules), sum(tried[module] for module in modules)
    share = good / max(total, 1)
    error = (share * (1.0 - share) / max(total, 1)) ** 0.5
    whole = sum(sizes[module] for module in modules)
    weighted = sum(sizes[module] / whole * caught[module] / tried[module] for module in modules)
    return (
        f"{good} of {total} caught, {100 * share:.1f} +- {100 * error:.1f} %; "
        f"{100 * weighted:.1f} % where modules count by their {whole} mutants"
    )


def main() -> int:
    """Draw mutants, of each module in turn or of all together, until the count or the time is reached."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=f"of {', '.join(CORE)}; all of them")
    parser.add_argument("--count", type=int, default=40, help="mutants of each module")
    parser.add_argument("--total", type=int, help="instead: so many of all their mutants, each as likely as another")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no further mutant after this long")
    given = parser.parse_args()
    if unknown := set(given.modules) - set(CORE):
        parser.error(f"no module {', '.join(sorted(unknown))}: choose of {', '.join(CORE)}")
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    import hypothesis.internal.conjecture.engine  # noqa: F401 - what tests import is there when a process forks
    import numpy  # noqa: F401
    import pytest  # noqa: F401
    import scipy.interpolate
    import scipy.optimize
    import scipy.signal
    import scipy.special  # noqa: F401

    with contextlib.suppress(ImportError):
        import warp  # noqa: F401 - imported, and not begun: that is the child's
        import xarray  # noqa: F401

    draw, end = random.Random(given.seed), time.monotonic() + 60.0 * given.minutes
    chosen, limits = given.modules or list(CORE), {}
    every = {module: changes(ast.parse((ROOT / "aerokernels" / module).read_text("utf-8"))) for module in chosen}
    sizes = {module: len(found) for module, found in every.items()}
    if given.total is None:
        parts = [[(module, one) for one in draw.sample(found, min(given.count, len(found)))]
                 for module, found in every.items()]  # fmt: skip
        waiting = [one for turn in itertools.zip_longest(*parts) for one in turn if one is not None]
    else:
        pool = [(module, one) for module, found in every.items() for one in found]
        waiting = draw.sample(pool, min(given.total, len(pool)))
    tried, caught = dict.fromkeys(chosen, 0), dict.fromkeys(chosen, 0)
    for module, (line, told, make) in waiting:
        if time.monotonic() > end:
            break
        if module not in limits:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            if not survives(module, None, 300.0):
                parser.error(f"the tests of {module} fail without a mutant")
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            limits[module] = 5.0 * took + 2.0
            print(f"{module}: {sizes[module]} mutants, tests take {took:.1f} s", flush=True)
        alive = survives(module, make(), limits[module])
        tried[module] += 1
        caught[module] += not alive
        if alive:
            print(f"  survives: {module}:{line}: {told}", flush=True)
    chosen = [module for module in chosen if tried[module]]
    for module in chosen:
        print(f"{module}: {caught[module]} of {tried[module]} caught")
    for stage in sorted({module.split("/")[0] for module in chosen}):
        print(f"{stage}: {rate([one for one in chosen if one.split('/')[0] == stage], caught, tried, sizes)}")
    print(f"all: {rate(chosen, caught, tried, sizes)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
