"""Expressions: names, members, components, and operators."""

import ast
from typing import Any

import warp as wp

from .numbers import COMPARISONS, Numbers
from .source import is_static
from .types import AND, ATOM, CHOICE, GIVEN, OR, PICKS, POSTFIX, PRODUCT, UNARY, Term, base, width

AXES = "xyzw"
OPERATORS: dict[type, tuple[str, int]] = {
    ast.Add: ("+", 12),
    ast.Sub: ("-", 12),
    ast.Mult: ("*", PRODUCT),
    ast.Div: ("/", PRODUCT),
    ast.FloorDiv: ("/", PRODUCT),  # C truncates, Warp floors: for numbers that are not negative
    ast.Mod: ("%", PRODUCT),
    ast.BitAnd: ("&", 8),
    ast.BitOr: ("|", 6),
    ast.BitXor: ("^", 7),
    ast.LShift: ("<<", 11),
    ast.RShift: (">>", 11),
}
BITS = (6, 7, 8, 11)  # written with brackets, as compilers ask
SIGNS = {ast.USub: "-", ast.Not: "!", ast.UAdd: "+", ast.Invert: "~"}


class Expressions(Numbers):
    """Writes expressions but calls."""

    def expr(self, node: Any) -> Term:
        """Return an expression in C."""
        write = getattr(self, f"_of_{type(node).__name__}", None)
        if write is None:
            raise self.fail(node, "no such expression")
        term: Term = write(node)
        return term

    def _of_Constant(self, node: Any) -> Term:
        return self.number(node.value)

    def _of_Name(self, node: Any) -> Term:
        if node.id in self.types:
            self.use(node.id)
            return Term(node.id, self.types[node.id])
        found = self.constant(node)
        if found is not None:
            return found
        facet = self.names.values(node, self.mask)
        if facet and hasattr(facet[0][0], "_length_"):
            return self.vector_constant(facet)
        raise self.fail(node, "unknown name")

    def _of_Attribute(self, node: Any) -> Term:
        if isinstance(node.value, ast.Name) and node.value.id == "wp":
            return self.number(float(getattr(wp, node.attr)))
        owner = self.expr(node.value)
        if node.attr not in self.kinds.members.get(owner.type, {}):
            raise self.fail(node, f"no such member of {owner.type}")
        kind = self.kinds.members[owner.type][node.attr].kind.replace("bool", "int")
        given = f"{owner.text}{self.point}{node.attr}"
        if kind.endswith("*"):
            if owner.type in GIVEN:
                self.takes_arrays = True
                given = f"arrays{self.point}{node.attr}"
            return Term(given, f"*{kind.rstrip('*')}", POSTFIX)
        if owner.type not in GIVEN:
            return Term(f"{owner.text}.{node.attr}", kind, POSTFIX)
        if width(kind) == 1:
            return Term(given, kind, POSTFIX)
        if kind in ("real3", "double3"):
            return Term(f"{'VECTOR' if kind == 'real3' else 'VECTOR64'}({given})", kind)
        return Term(f"({kind})({', '.join(f'{given}[{k}]' for k in range(width(kind)))})", kind, UNARY)

    def index(self, node: Any) -> str:
        """Write the place in an array; arrays with two indices have rows of two numbers."""
        if not isinstance(node, ast.Tuple):
            return self.expr(node).text
        row, column = (self.expr(each) for each in node.elts)
        rest = "" if column.text == "0" else f" + {column.within(PRODUCT)}"
        return f"2 * {row.within(PRODUCT)}{rest}"

    def _of_Subscript(self, node: Any) -> Term:
        if isinstance(node.value, ast.Attribute):  # of a vector in a given struct, which is an array in C
            owner = self.expr(node.value.value)
            member = self.kinds.members[owner.type][node.value.attr] if owner.type in GIVEN else None
            if member is not None and not member.kind.endswith("*"):
                at = self.expr(node.slice).text
                return Term(f"{owner.text}{self.point}{member.name}[{at}]", base(member.kind), POSTFIX)
        owner = self.expr(node.value)
        if owner.type in self.kinds.parts:
            name, kind = self.kinds.parts[owner.type][node.slice.value]
            return Term(f"{owner.text}.{name}", kind, POSTFIX)
        if owner.type.startswith("*"):
            kind, at = owner.type[1:], self.index(node.slice)
            text = f"vload{width(kind)}({at}, {owner.text})" if width(kind) > 1 else f"{owner.text}[{at}]"
            return Term(text, kind, POSTFIX)
        return self.component(owner, node.slice)

    def component(self, owner: Term, node: Any, is_stored: bool = False) -> Term:
        """Write a number of a vector."""
        if "[" in owner.type:
            return Term(f"{owner.text}[{self.expr(node).text}]", owner.type.split("[")[0], POSTFIX)
        kind = base(owner.type)
        known = self.names.values(node, self.mask)
        if len(known) == 1:
            k = int(known[0][0])
            name = AXES[k] if width(owner.type) <= 4 else f"s{k:x}"
            return Term(f"{owner.within(POSTFIX)}.{name}", kind, POSTFIX)
        at = self.expr(node).text
        if is_stored or width(owner.type) > 4:
            return Term(f"(({kind} *)&{owner.text})[{at}]", kind, POSTFIX)
        if owner.type not in PICKS:
            raise self.fail(node, f"component of {owner.type}")
        return Term(f"{PICKS[owner.type]}({owner.text}, {at})", kind)

    def _of_UnaryOp(self, node: Any) -> Term:
        known = self.constant(node)
        if known is not None:
            return known
        value, sign = self.expr(node.operand), SIGNS[type(node.op)]
        return Term(f"{sign}{value.within(UNARY)}", "int" if sign == "!" else value.type, UNARY)

    def _of_BoolOp(self, node: Any) -> Term:
        known = self.constant(node) if any(map(is_static, ast.walk(node))) else None
        if known is not None:
            return known
        conjunction = isinstance(node.op, ast.And)
        rank, sign = (AND, " && ") if conjunction else (OR, " || ")
        neutral, decisive = (self.mask, 0) if conjunction else (0, self.mask)
        parts = []
        for each in node.values:
            truth = self.names.truth(each, self.mask)
            if truth == decisive:
                return Term("0" if conjunction else "1", "int")
            if truth != neutral:
                parts.append(self.expr(each).within(rank + (1 if conjunction else 2)))
        return Term(sign.join(parts), "int", rank if len(parts) > 1 else CHOICE)

    def _of_Compare(self, node: Any) -> Term:
        texts, left, rank = [], node.left, 0
        for op, right in zip(node.ops, node.comparators, strict=True):
            if type(op) not in COMPARISONS:
                raise self.fail(node, "no such comparison")
            rank = 9 if isinstance(op, (ast.Eq, ast.NotEq)) else 10
            one, two = self.expr(left).within(rank + 1), self.expr(right).within(rank + 1)
            texts.append(f"{one} {COMPARISONS[type(op)]} {two}")
            left = right
        return Term(" && ".join(texts), "int", AND if len(texts) > 1 else rank)

    def _of_BinOp(self, node: Any) -> Term:
        if type(node.op) not in OPERATORS:
            raise self.fail(node, "no such operator")
        left, right = self.expr(node.left), self.expr(node.right)
        sign, rank = OPERATORS[type(node.op)]
        kind = left.type if width(left.type) >= width(right.type) else right.type
        one = left.within(ATOM - 1 if rank in BITS else rank)
        two = right.within(ATOM - 1 if rank in BITS else rank + 1)
        return Term(f"{one} {sign} {two}", kind, rank)

    def _of_IfExp(self, node: Any) -> Term:
        truth = self.names.truth(node.test, self.mask)
        if truth is not None and truth in (0, self.mask):
            return self.expr(node.body if truth else node.orelse)
        body, other = self.expr(node.body), self.expr(node.orelse)
        text = f"{self.expr(node.test).within(OR)} ? {body.within(OR)} : {other.within(CHOICE)}"
        return Term(text, body.type, CHOICE)
