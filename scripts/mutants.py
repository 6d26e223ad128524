"""Make mutants of a module: every change of one operator, comparison, number or condition.

Changes that cannot affect a result are left out, but only by the rules in RULES: that no test notices a change is not
such a rule. `scripts/mutate --rules` counts what each rule leaves out. Two changes that give the same program are one
mutant.
"""

import ast
import copy
import tomllib
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
WITHOUT_EFFECT = tomllib.loads((ROOT / "scripts" / "mutants_without_effect.toml").read_text(encoding="utf-8"))
SPEED_ONLY = "speed only"  # at the end of a comment
SMALLEST = 1e-100  # a smaller number is a guard against 0 / 0; its double is as far below any value that occurs
WITHOUT_ANSWER = {  # arguments of calls that are a promise of the caller or affect speed only
    "zip": {"strict"}, "einsum": {"optimize"}, "setdiff1d": {"assume_unique"}, "solve_banded": {"check_finite"},
    "field": {"repr"},
}  # fmt: skip
RULES = {
    "texts": "messages of exceptions and warnings, and what is computed for them in a block that ends in an exception",
    "types": "annotations, decorators, and blocks for type checkers",
    "shown": "`__repr__`, `_repr_html_`, `plot`, and what a command tells of its progress",
    "read-only": "whether arrays can be written to",
    "keywords": "`strict` of zip, which nothing meets, `optimize` of einsum, `overwrite_..`, `assume_unique`, "
    "`check_finite`, and `repr` of a field",
    "speed": "lines whose comment ends with `speed only`: how much is computed at a time, or is kept",
    "guards": "numbers below 1e-100, which keep 0 / 0 away, whether added or subtracted",
    "reshape": "by which negative number reshape is told to find a side itself",
}
OTHER: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Div, ast.Mod: ast.Mult,
    ast.Pow: ast.Mult, ast.MatMult: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.Lt: ast.LtE,
    ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot,
    ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And, ast.UAdd: ast.USub,
    ast.USub: ast.UAdd,
}  # fmt: skip
TURNED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}


class Mutant(NamedTuple):
    """One change of a module: its position, the function it belongs to or the names it sets, and its tree."""

    module: str
    line: int
    code: str
    told: str
    function: str
    names: frozenset[str]
    tree: Callable[[], ast.Module]

    @property
    def without_effect(self) -> bool:
        """Whether the mutant was read and found unable to change a result."""
        judged = WITHOUT_EFFECT.get(self.module, ())
        return any(one["code"] == self.code and self.told in one["changes"] for one in judged)


def changes(module: str, text: str, left_out: Counter[str] | None = None) -> list[Mutant]:
    """Return every mutant of a module; `left_out` counts what each rule leaves out."""
    tree, lines = ast.parse(text), text.splitlines()
    hidden: dict[int, str] = {}
    for node in ast.walk(tree):
        for rule, one in _hidden(node):
            hidden |= {id(inner): rule for inner in ast.walk(one)}
    inside: dict[int, tuple[str, frozenset[str]]] = {}
    places(tree, "", inside)
    found = []
    for number, node in enumerate(ast.walk(tree)):
        line = getattr(node, "lineno", 0)
        last = getattr(node, "end_lineno", line)
        rule = hidden.get(id(node)) or _without_effect(node)
        if rule is None and any(one.endswith(SPEED_ONLY) for one in lines[line - 1 : last]):
            rule = "speed"
        for told, change in _of(node):
            if rule is not None:
                if left_out is not None:
                    left_out[rule] += 1
                continue
            function, names = inside.get(id(node), ("", frozenset()))
            code = lines[line - 1].strip()
            found.append(Mutant(module, line, code, told, function, names, partial(_mutant, tree, number, change)))
    return found


def _hidden(node: ast.AST) -> list[tuple[str, ast.AST]]:
    """Return the parts of a node that cannot change a result, with the rule for each."""
    if isinstance(node, (ast.Raise, ast.JoinedStr)):
        return [("texts", node)]
    if isinstance(node, ast.FunctionDef):
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        types = [node.returns, *(one.annotation for one in arguments), *node.decorator_list]
        shown = [("shown", node)] if node.name in ("__repr__", "_repr_html_", "plot") else []
        return [*(("types", one) for one in types if one is not None), *shown]
    if isinstance(node, ast.ClassDef):  # options of a dataclass do not change results
        return [("types", one) for one in node.decorator_list]
    if isinstance(node, ast.AnnAssign):
        return [("types", node.annotation)]
    if isinstance(node, ast.Call):
        return _hidden_of_call(node)
    if not isinstance(node, ast.If):
        return []
    if ast.unparse(node.test) == "TYPE_CHECKING":
        return [("types", node)]
    return [("texts", one) for block in (node.body, node.orelse) if _only_refuses(block) for one in block]


def _hidden_of_call(node: ast.Call) -> list[tuple[str, ast.AST]]:
    name = ast.unparse(node.func).rpartition(".")[2]
    if ast.unparse(node.func) in ("warnings.warn", "_warn"):
        return [("texts", node)]
    if name == "progress":
        return [("shown", node)]
    if isinstance(node.func, ast.Attribute) and name == "setflags":
        return [("read-only", node)]
    if isinstance(node.func, ast.Attribute) and name == "reshape":
        negative = [one for one in node.args if isinstance(one, ast.UnaryOp) and isinstance(one.op, ast.USub)]
        return [("reshape", one.operand) for one in negative]
    told = WITHOUT_ANSWER.get(name, set())
    return [
        ("keywords", one.value)
        for one in node.keywords
        if isinstance(one.value, ast.Constant) and one.arg and (one.arg in told or one.arg.startswith("overwrite_"))
    ]


def _without_effect(node: ast.AST) -> str | None:
    """Return the rule by which a node itself is left out, but not its parts."""

    def is_guard(one: ast.AST) -> bool:
        return isinstance(one, ast.Constant) and isinstance(one.value, float) and 0.0 < one.value < SMALLEST

    added = isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Sub)) and is_guard(node.right)
    return "guards" if is_guard(node) or added else None


def _only_refuses(block: list[ast.stmt]) -> bool:
    """Return whether a block always ends in an exception: all that it computes is for the message."""
    ways_out = (ast.Return, ast.Break, ast.Continue, ast.Yield)
    inside = (inner for one in block for inner in ast.walk(one))
    return bool(block) and isinstance(block[-1], ast.Raise) and not any(isinstance(one, ways_out) for one in inside)


def places(node: ast.AST, prefix: str, inside: dict[int, tuple[str, frozenset[str]]]) -> None:
    """Record for each node its function, inner ones as part of the outer, or the names that its statement sets."""
    for inner in ast.iter_child_nodes(node):
        early: dict[int, tuple[str, frozenset[str]]] = {}
        if isinstance(inner, (ast.FunctionDef, ast.AsyncFunctionDef)):
            place = (prefix + inner.name, frozenset())
            for default in filter(None, [*inner.args.defaults, *inner.args.kw_defaults]):
                early |= {id(one): (place[0], frozenset([inner.name])) for one in ast.walk(default)}
        elif isinstance(inner, ast.ClassDef):
            places(inner, f"{prefix}{inner.name}.", inside)
            continue
        elif isinstance(inner, (ast.If, ast.With, ast.Try)):
            places(inner, prefix, inside)
            continue
        else:
            set_here = (one for one in ast.walk(inner) if isinstance(getattr(one, "ctx", None), ast.Store))
            place = ("", frozenset(one.id for one in set_here if isinstance(one, ast.Name)))
        inside |= {id(one): place for one in ast.walk(inner)} | early


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
    elif isinstance(node, (ast.If, ast.IfExp, ast.While)) and not _is_turned_already(node.test):
        yield "condition -> not", lambda inner: setattr(inner, "test", ast.UnaryOp(ast.Not(), inner.test))


def _is_turned_already(test: ast.expr) -> bool:
    """Return whether a condition is one comparison, which other mutants invert."""
    return isinstance(test, ast.Compare) and len(test.ops) == 1
