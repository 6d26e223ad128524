"""Statements: assignments, returns, and loops."""

import ast
from typing import Any

from .branches import Branches
from .expressions import OPERATORS
from .source import last_name
from .text import indented, joined
from .types import Term, width
from .variables import Block

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh")


class Statements(Branches):
    """Writes statements.

    Attributes:
        wished: Names for the parts of the tuple that the function returns, as its first caller has them.
        is_one_of_several: Whether other functions stand for it in other scenes.
        returns: The type that it returns; "tuple" for a tuple.
    """

    wished: list[str | None] | None = None
    is_one_of_several = False
    returns = "void"

    def begin(self) -> None:
        """Begin to write it."""
        super().begin()
        self.parts = []
        self._results: set[str] = set()
        self._shown = 0  # the last line whose comments are written
        self._is_bounded = False

    def block(self, statements: list, scope: Block, is_transparent: bool = False) -> list[str]:
        """Write statements; a transparent block is a part of an #if, which is no block of C."""
        out: list[str] = []
        before, self.here = self.here, scope
        for statement in statements:
            line = statement.lineno
            lines = [""] if out and self._shown < max((k for k in self.source.blank if k < line), default=0) else []
            lines += [f"// {text}" for k, text in self.source.comments.items() if self._shown < k < line]
            self._shown = max(self._shown, line)
            written = self.statement(statement)
            out += [*lines, *(() if is_transparent else self.waiting(scope)), *written]
        self.here = before
        return out

    def trailing(self, node: Any, last: int | None = None) -> str:
        """Return the comment behind a statement."""
        for line in range(node.lineno, (last or node.end_lineno) + 1):
            if line in self.source.trailing:
                return f"  // {self.source.trailing[line]}"
        return ""

    def statement(self, node: Any) -> list[str]:
        """Write a statement."""
        write = getattr(self, f"_do_{type(node).__name__}", None)
        if write is None:
            raise self.fail(node, "no such statement")
        lines: list[str] = write(node)
        if not isinstance(node, (ast.If, ast.For, ast.While)) and lines:
            lines[-1] += self.trailing(node)
        return lines

    def _do_Pass(self, node: Any) -> list[str]:
        return []

    def _do_Break(self, node: Any) -> list[str]:
        return ["break;"]

    def _do_Continue(self, node: Any) -> list[str]:
        return ["continue;"]

    def _do_Expr(self, node: Any) -> list[str]:
        return [] if isinstance(node.value, ast.Constant) else [f"{self.expr(node.value).text};"]

    def _do_AugAssign(self, node: Any) -> list[str]:
        sign = OPERATORS[type(node.op)][0] + "="
        return [self._store(node.target, self.expr(node.value), sign)]

    def _do_Return(self, node: Any) -> list[str]:
        if node.value is None:
            return ["return;"]
        if not isinstance(node.value, ast.Tuple):
            value = self.expr(node.value)
            self.returns = value.type if self.returns == "void" else self.returns
            return [f"return {value.text};"]
        self.returns = "tuple"
        values = [self.expr(each) for each in node.value.elts]
        for k, (each, value) in enumerate(zip(node.value.elts, values, strict=True)):
            if len(self.parts) > k:
                continue
            wish = self.wished[k] if self.wished and k < len(self.wished) else None
            name = each.id if isinstance(each, ast.Name) and not (self.is_one_of_several and wish) else wish
            if not name or any(name == other for other, _ in self.parts):
                name = wish or ORDINALS[k]
            self.parts.append((name, value.type))
        return [f"return ({self.result_name}){{{', '.join(value.text for value in values)}}};"]

    @property
    def result_name(self) -> str:
        """The struct that the function returns in place of a tuple."""
        return "".join(part.capitalize() for part in self.name.split("_")) + "Result"

    def _do_Assign(self, node: Any) -> list[str]:
        target, value = node.targets[0], node.value
        if len(node.targets) > 1:
            raise self.fail(node, "several targets")
        if not isinstance(target, ast.Tuple):
            return [self._store(target, self.expr(value)), *self._bound(target, value)]
        if isinstance(value, ast.Tuple):
            return self._several(node)
        if not isinstance(value, ast.Call):
            raise self.fail(node, "no such assignment")
        if ast.unparse(value.func) == "wp.tid":
            return [self._store(target.elts[0], self.expr(value))]
        return self._unpacked(target.elts, value)

    def _several(self, node: Any) -> list[str]:
        """Assign several values one after the other."""
        targets, values = node.targets[0].elts, node.value.elts
        terms = [self.expr(each) for each in values]
        lines = []
        for k, (target, term) in enumerate(zip(targets, terms, strict=True)):
            later = {each.id for value in values[k + 1 :] for each in ast.walk(value) if isinstance(each, ast.Name)}
            if isinstance(target, ast.Name) and target.id in later:
                raise self.fail(node, "a value depends on an earlier target")
            lines.append(self._store(target, term))
        return joined(lines)

    def _unpacked(self, targets: list, value: Any) -> list[str]:
        """Assign the parts of the tuple that a function returns."""
        names = [each.id if isinstance(each, ast.Name) and each.id != "_" else None for each in targets]
        self.hint = names
        called = self.expr(value)
        self.hint = None
        if called.type == "advance":
            for each in targets:
                self._store(each, Term("", self.types[targets[0].id]))
            return [f"{called.text};"]
        parts, result = self.result
        if called.type != result or len(parts) != len(targets):
            raise self.fail(value, "no tuple of so many values")
        made = "_and_".join(name.rstrip("_") for name in names[:2] if name)
        if len(made) > 24 or not made or made in self._results | self.source.own:
            made = f"{last_name(value.func)}_{len(self._results) + 1}"
        self._results.add(made)
        pairs = zip(targets, names, parts, strict=True)
        stores = [self._store(each, Term(f"{made}.{part}", kind)) for each, name, (part, kind) in pairs if name]
        return [f"const {result} {made} = {called.text};", *joined(stores)]

    def _bound(self, target: Any, value: Any) -> list[str]:
        """In a kernel, end the work-items beyond the launch's count: OpenCL rounds launches up."""
        begins = any(isinstance(each, ast.Name) and each.id == "first_ray" for each in ast.walk(value))
        if not self.is_kernel or not begins or self._is_bounded:
            return []
        self._is_bounded = True
        return [f"if ({target.id} >= ray_count) {{", "    return;", "}"]

    def _store(self, target: Any, value: Term, sign: str = "=") -> str:
        """Assign to a variable, a member, or a number of an array or vector."""
        if isinstance(target, ast.Name):
            return self.assign(target.id, value, sign)
        if isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name):
            owner = self.expr(target.value)
            self.change(target.value.id)
            return f"{owner.text}.{target.attr} {sign} {value.text};"
        if not isinstance(target, ast.Subscript):
            raise self.fail(target, "no such target")
        owner = self.expr(target.value)
        if owner.type.startswith("*"):
            size, at = width(owner.type[1:]), self.index(target.slice)
            if size > 1:
                return f"vstore{size}({value.text}, {at}, {owner.text});"
            return f"{owner.text}[{at}] {sign} {value.text};"
        if isinstance(target.value, ast.Name):
            self.change(target.value.id)
        return f"{self.component(owner, target.slice, is_stored=True).text} {sign} {value.text};"

    def _do_While(self, node: Any) -> list[str]:
        if node.orelse:
            raise self.fail(node, "an else of a loop")
        test, trailing = self.expr(node.test), self.trailing(node, node.test.end_lineno)
        return [f"while ({test.text}) {{{trailing}", *indented(self.block(node.body, self._inside(node))), "}"]

    def _do_For(self, node: Any) -> list[str]:
        if node.orelse or not isinstance(node.iter, ast.Call) or ast.unparse(node.iter.func) != "range":
            raise self.fail(node, "no loop over a range")
        given = [self.expr(each) for each in node.iter.args]
        low, high = (Term("0", "int"), given[0]) if len(given) == 1 else given[:2]
        name, scope = node.target.id, self._inside(node)
        step = f"{name}++" if len(given) < 3 else f"{name} += {given[2].text}"
        self.count_in_loop(name, scope)
        known = self.names.values(node.iter.args[-1], self.mask)
        lines = ["#pragma unroll"] if known and all(isinstance(value, int) for value, _ in known) else []
        body = self.block(node.body, scope)
        return [*lines, f"for (int {name} = {low.text}; {name} < {high.text}; {step}) {{", *indented(body), "}"]

    def _inside(self, node: Any) -> Block:
        return (*self.here, (id(node), 0))
