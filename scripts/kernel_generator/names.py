"""What the names that a device function closes over are, in each of its scenes."""

import ast
from collections.abc import Callable
from typing import Any, NamedTuple

from .scenes import Facet
from .source import Source, is_static


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
