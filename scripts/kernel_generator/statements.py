"""Statements: ifs, of which those that a scene decides become #if, assignments, returns, and loops."""

import ast
from typing import Any

from .expressions import OPERATORS, Expressions
from .source import last_name
from .state import Block
from .text import indented, joined
from .types import BEGINS, Term, width


class Statements(Expressions):
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

    def _do_If(self, node: Any) -> list[str]:
        mask = self.mask
        may, rest = self.names.split(node.test, mask)
        if not may:
            return self._under(mask, node.orelse, mask)
        if self.names.surely(node.test, mask) == may:
            return self._under(mask, node.body, mask) if may == mask else self._conditional(may, node)
        if may == mask:
            return self._plain(node, rest, node.orelse)
        # A part of the test is known: the C `if` is there only in the scenes where that part holds.
        self.mask = may
        inner = self._plain(node, rest, [])
        self.mask = mask
        condition = self.condition(may, mask, node.test)
        if not node.orelse:
            return [f"#if {condition}", *inner, "#endif"]
        other = self.block(node.orelse, (*self.here, (id(node), 1)))
        return [f"#if {condition}", *inner, "else", "#endif", "{", *indented(other), "}"]

    def _plain(self, node: Any, rest: list, orelse: list) -> list[str]:
        """Write an if that the ray decides."""
        test = " && ".join(self.expr(part).within(5 if len(rest) > 1 else 0) for part in rest)
        lines = [f"if ({test}) {{{self.trailing(node, node.test.end_lineno)}"]
        lines += indented(self.block(node.body, (*self.here, (id(node), 0))))
        if orelse:
            if self.mask & self.names.surely(node.test, self.mask):
                raise self.fail(node, "an else that some scenes do not have")
            other = self.block(orelse, (*self.here, (id(node), 1)))
            is_chain = len(orelse) == 1 and isinstance(orelse[0], ast.If) and _is_one_if(other)
            if is_chain:
                return [*lines, f"}} else {other[0]}", *other[1:]]
            if other:
                return [*lines, "} else {", *indented(other), "}"]
        return [*lines, "}"]

    def _under(self, mask: int, body: list, within: int) -> list[str]:
        """Write statements in some of the scenes."""
        before, self.mask = self.mask, mask
        lines = self.block(body, self.here, is_transparent=mask != within)
        self.mask = before
        return lines

    def _conditional(self, may: int, node: Any) -> list[str]:
        """Write #if, #elif ... #else."""
        mask, left, orelse = self.mask, self.mask & ~may, node.orelse
        out = [f"#if {self.condition(may, mask, node.test)}", *self._under(may, node.body, mask)]
        while left and len(orelse) == 1 and isinstance(orelse[0], ast.If):
            may, rest = self.names.split(orelse[0].test, left)
            if rest or not may:
                break
            if may == left:
                orelse = orelse[0].body
                break
            out += [f"#elif {self.condition(may, left, orelse[0].test)}", *self._under(may, orelse[0].body, mask)]
            left &= ~may
            orelse = orelse[0].orelse
        lines = self._under(left, orelse, mask) if left and orelse else []
        out += ["#else", *lines] if lines else []
        return [] if all(line.startswith("#") for line in out) else [*out, "#endif"]

    def _do_Break(self, node: Any) -> list[str]:
        return ["break;"]

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
        begins = [each.id for each in ast.walk(value) if isinstance(each, ast.Name) and each.id in BEGINS]
        if not self.is_kernel or not begins or self._is_bounded:
            return []
        self._is_bounded = True
        return [f"if ({target.id} >= {BEGINS[begins[0]]}) {{", "    return;", "}"]

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
            size, at = width(owner.type[1:]), self.expr(target.slice).text
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


def _is_one_if(lines: list[str]) -> bool:
    """Whether lines are one if statement, with its else."""
    if not lines or not lines[0].startswith("if (") or lines[-1] != "}":
        return False
    depth = 0
    for line in lines[:-1]:
        depth += line.count("{") - line.count("}")
        if depth == 0:
            return False
    return True


ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh")
