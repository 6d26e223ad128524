"""The source of a device function: its syntax tree, docstring, comments, and the names that it closes over."""

import ast
import inspect
import io
import textwrap
import tokenize
from collections.abc import Callable
from types import CodeType
from typing import Any, NamedTuple

import warp as wp

from .scenes import Facet

# Names that mean something else in OpenCL C; they get an underscore.
RESERVED = {"half", "global", "local", "kernel", "constant", "private", "half4", "all", "any"}


class Unsupported(TypeError):
    """Python that has no translation; the message names module, function and line."""


class Source:
    """A function's text.

    Attributes:
        tree: The definition.
        body: Its statements without the docstring.
        doc: The docstring.
        file, first_line: Where it is.
        comments, trailing: Comments on lines of their own and behind statements, by line.
        blank: The numbers of blank lines.
        own: Names of arguments and variables.
    """

    def __init__(self, function: Callable) -> None:
        """Read the text; Warp's decorators do not matter."""
        lines, self.first_line = inspect.getsourcelines(function)
        self.file = inspect.getsourcefile(function) or "?"
        text = textwrap.dedent("".join(lines))
        tree: Any = ast.parse(text).body[0]
        self.tree = tree
        self.doc = inspect.getdoc(function) or ""
        body = tree.body
        self.body = body[1:] if isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant) else body
        self.comments: dict[int, str] = {}
        self.trailing: dict[int, str] = {}
        rows = text.splitlines()
        self.blank = {number for number, row in enumerate(rows, start=1) if not row.strip()}
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT:
                whole = rows[token.start[0] - 1].strip().startswith("#")
                (self.comments if whole else self.trailing)[token.start[0]] = token.string.lstrip("# ")
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Name) and node.id in RESERVED:
                node.id += "_"
            if isinstance(node, ast.arg) and node.arg in RESERVED:
                node.arg += "_"

        nodes = ast.walk(self.tree)
        self.own = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        self.own |= {each.arg for each in self.tree.args.args}
        self._codes: dict[int, tuple[CodeType | None, ast.AST]] = {}  # by the node's id, which the node keeps
        self._parts: dict[int, tuple[list[Any], ast.AST]] = {}  # the same

    def branches_and_calls(self, node: ast.AST) -> list[Any]:
        """Return the `if` statements of a node and its calls but wp.static, in order; an `if` is not looked into."""
        if id(node) not in self._parts:
            found, waiting = [], [node]
            while waiting:
                each = waiting.pop()
                if isinstance(each, ast.If) or (isinstance(each, ast.Call) and not is_static(each)):
                    found.append(each)
                if not isinstance(each, ast.If):
                    waiting.extend(reversed(list(ast.iter_child_nodes(each))))
            self._parts[id(node)] = found, node
        return self._parts[id(node)][0]

    def is_known(self, node: ast.AST) -> bool:
        """Whether an expression has no local names."""
        return not any(isinstance(each, ast.Name) and each.id in self.own for each in ast.walk(node))

    def compiled(self, node: ast.AST) -> CodeType | None:
        """Return Python's code of an expression, for `eval`; None for one with local names."""
        if id(node) not in self._codes:
            code: CodeType | None = None
            if self.is_known(node):
                plain = _Plain().visit(ast.parse(ast.unparse(node), mode="eval"))
                code = compile(ast.fix_missing_locations(plain), "static", "eval")
            self._codes[id(node)] = code, node
        return self._codes[id(node)][0]

    def fail(self, name: str, node: ast.AST, why: str) -> Unsupported:
        """Return the error for a node that has no translation."""
        module = self.file.replace("\\", "/").rsplit("/", 1)[-1]
        line = self.first_line + getattr(node, "lineno", 1) - 1
        return Unsupported(f"{module}, line {line}, function {name}: {why}: {ast.unparse(node)[:160]}")


class _Plain(ast.NodeTransformer):
    """Takes the argument of wp.static, which Python cannot call outside a kernel."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Replace wp.static(x) by x."""
        self.generic_visit(node)
        return node.args[0] if is_static(node) else node


def is_static(node: ast.AST) -> bool:
    """Whether a node is a call of wp.static."""
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "static"):
        return False
    return isinstance(node.func.value, ast.Name) and node.func.value.id == "wp"


def last_name(node: ast.AST) -> str:
    """Return the last name of a dotted one."""
    return ast.unparse(node).rsplit(".", 1)[-1]


class DeviceFunction:
    """Stands for a function that a builder makes: Warp would prepare each, which takes most of the time."""

    def __init__(self, func: Callable) -> None:
        """Keep Python's function."""
        self.func = func


def is_device_function(value: Any) -> bool:
    """Whether kernels may call it."""
    return isinstance(value, (DeviceFunction, wp.Function))


def module_of(function: Callable) -> str:
    """Return the last part of the name of a function's module, or of its package if that is "kernels"."""
    package, _, name = function.__module__.rpartition(".")
    return package.rsplit(".", 1)[-1] if name == "kernels" else name


class _Known(NamedTuple):
    """The value of an expression in all scenes, and those in which it has none; the node keeps its id from others."""

    facet: Facet
    without: int
    node: ast.AST


class Names:
    """The names of one function, which builders have made several times.

    Attributes:
        functions: The Python functions, each with its scenes.
        full: All their scenes.
    """

    def __init__(self, source: Source, functions: list[tuple[Callable, int]]) -> None:
        """Collect the closures of functions of one code."""
        self.source, self.functions = source, functions
        self.full = 0
        self._spaces: list[tuple[dict[str, Any], int]] = []
        for function, mask in functions:
            self.full |= mask
            cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
            own = {name: cell.cell_contents for name, cell in cells}
            self._spaces.append(({**function.__globals__, **own}, mask))
        self._known: dict[int, _Known] = {}

    def values(self, node: ast.AST, mask: int) -> Facet:
        """Return the values of an expression without local names; none if it has none in some of the scenes."""
        if id(node) not in self._known:
            self._known[id(node)] = self._evaluated(node)
        known = self._known[id(node)]
        if known.without & mask:
            return []
        return [(value, where & mask) for value, where in known.facet if where & mask]

    def _evaluated(self, node: ast.AST) -> _Known:
        code = self.source.compiled(node)
        if code is None:
            return _Known([], self.full, node)
        found: dict[Any, tuple[Any, int]] = {}
        without = 0
        for space, where in self._spaces:
            try:
                value = eval(code, space)
            except Exception:  # in these scenes it is not reached
                without |= where
                continue
            key = (type(value), repr(value)) if isinstance(value, (int, float, str)) else id(value)
            found[key] = value, found.get(key, (value, 0))[1] | where
        return _Known(list(found.values()), without, node)

    def truth(self, node: ast.AST, mask: int) -> int | None:
        """Return the scenes in which a condition that is known now holds; None for one that is not."""
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "on_processor":
            return 0  # Warp's own lookup on a CPU
        if isinstance(node, (ast.Compare, ast.Constant)) and not any(map(is_static, ast.walk(node))):
            return None
        values = self.values(node, mask)
        if not values or not all(isinstance(value, bool) for value, _ in values):
            return None
        return sum(where for value, where in values if value)

    def split(self, test: ast.AST, mask: int) -> tuple[int, list[ast.AST]]:
        """Return the scenes in which a test may hold, and the parts of it (joined by `and`) that remain there."""
        rest: list[ast.AST] = []
        for part in parts_of(test):
            known = self.truth(part, mask)
            if known is None:
                rest.append(part)
            else:
                mask &= known
        return mask, rest

    def surely(self, test: ast.AST, mask: int) -> int:
        """Return the scenes in which a test holds, whatever the ray does."""
        may, rest = self.split(test, mask)
        if not rest:
            return may
        sure = 0
        if len(rest) == 1 and isinstance(rest[0], ast.BoolOp) and isinstance(rest[0].op, ast.Or):
            for part in rest[0].values:
                sure |= self.truth(part, may) or 0
        return sure


def parts_of(test: ast.AST) -> list[Any]:
    """Return the parts of a test that `and` joins."""
    return test.values if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And) else [test]
