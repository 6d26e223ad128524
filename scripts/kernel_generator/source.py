"""The source of a device function: its syntax tree, its docstring, and its comments by line."""

import ast
import inspect
import io
import re
import textwrap
import tokenize
from collections.abc import Callable
from types import CodeType
from typing import Any

import warp as wp

# Names that mean something else in OpenCL C; they get an underscore.
RESERVED = {"half", "global", "local", "kernel", "constant", "private", "half4", "all", "any"}
_BUILDER = re.compile(r"Build a function(?: that (?P<does>[^.]*)| ?(\([^)]*\))? ?(->|:)? ?(?P<gives>[^.]*))\.", re.S)


class Unsupported(TypeError):
    """Python that has no translation; the message names module, function and line."""


class Source:
    """A function's text.

    Attributes:
        tree: The definition.
        body: Its statements without the docstring.
        doc: The docstring, or what the builder's docstring says of the function.
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
        self.doc = inspect.getdoc(function) or _of_builder(function)
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
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "wp.static"


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
    """Return the last part of the name of a function's module."""
    return function.__module__.rsplit(".", 1)[-1]


def _of_builder(function: Callable) -> str:
    """Describe a function without docstring by its builder's: "Build a function (...) -> what it returns."."""
    parts = function.__qualname__.split(".")
    module = inspect.getmodule(function)
    text = inspect.getdoc(getattr(module, parts[0], None)) if len(parts) > 1 and module else ""
    found = _BUILDER.match(text or "")
    if found is None:
        return ""
    what = (found["does"] or found["gives"] or "").replace("\n", " ").strip()
    what = what[1:-1] if what[:1] == "(" and what[-1:] == ")" else what
    return f"{what[:1].upper()}{what[1:]}." if what else ""
