"""Ifs: those that a scene decides become #if, others stay, and some are both."""

import ast
from typing import Any

from .calls import Calls
from .text import indented
from .variables import Block


class Branches(Calls):
    """Writes ifs."""

    def block(self, statements: list, scope: Block, is_transparent: bool = False) -> list[str]:
        """Write statements; a transparent block is a part of an #if, which is no block of C."""
        raise NotImplementedError

    def trailing(self, node: Any, last: int | None = None) -> str:
        """Return the comment behind a statement."""
        raise NotImplementedError

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
