"""Numbers and conditions that are known when a kernel is compiled: macros, literals, and choices between scenes."""

import ast
import re
from contextlib import suppress
from typing import Any

import warp as wp

from .names import parts_of
from .scenes import Facet
from .source import is_static
from .state import State
from .types import ATOM, CHOICE, UNARY, Term, base, width

COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


class Numbers(State):
    """Writes what does not depend on the ray."""

    def condition(self, wanted: int, within: int, test: ast.AST) -> str:
        """Return a condition for #if: as the source has it, if that says it, else the shortest."""
        known = [part for part in parts_of(test) if self.names.truth(part, within) is not None]
        text = " && ".join(filter(None, (self._as_written(part) for part in known)))
        with suppress(NameError, SyntaxError):  # a name that is no option
            if text and self.scenes.mask_of(text) & within == wanted:
                return text
        return self.scenes.condition(wanted, within)

    def _as_written(self, node: Any) -> str:
        """Return a comparison of an option, or a macro, in C; "" for anything else."""
        if isinstance(node, ast.Call):
            return self._as_written(node.args[0]) if is_static(node) else ""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            inner = self._as_written(node.operand)
            return f"!{inner}" if inner.isidentifier() else ""
        if isinstance(node, ast.BoolOp):
            parts = [self._as_written(each) for each in node.values]
            sign = " && " if isinstance(node.op, ast.And) else " || "
            return sign.join(parts) if all(parts) and not any("|" in each for each in parts) else ""
        if isinstance(node, ast.Name):
            return node.id.upper() if node.id.upper() in self.scenes.masks else ""
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and isinstance(node.left, ast.Name):
            right = node.comparators[0]
            if isinstance(right, ast.Constant) and isinstance(right.value, str):
                sign = COMPARISONS[type(node.ops[0])]
                return f"{node.left.id.upper()} {sign} {right.value.upper().replace('-', '_')}"
        return ""

    def number(self, value: Any, kind: str | None = None) -> Term:
        """Return a number, as type `kind`: real, double, float, or what it is."""
        if isinstance(value, bool):
            return Term(str(int(value)), "int")
        if hasattr(value, "value"):  # of Warp's scalar types
            if isinstance(value, wp.uint32):
                return Term(f"0x{value.value:X}u", "uint")
            return self.number(value.value, kind)
        if isinstance(value, int) and kind is None:
            return Term(str(value), "int", ATOM if value >= 0 else UNARY)
        value = float(value)
        if value != value or value == float("inf"):
            return Term("NAN" if value != value else "INFINITY", kind or "float")
        text = repr(value)
        if kind in ("real", "float"):
            return Term(f"R({text})" if kind == "real" else f"{text}f", kind)
        return Term(text, kind or "double", ATOM if value >= 0 else UNARY)

    def constant(self, node: Any, kind: str | None = None) -> Term | None:
        """Return an expression that is known in each scene, if it is one."""
        facet = self.names.values(node, self.mask)
        if not facet or not all(isinstance(value, (bool, int, float)) or hasattr(value, "value") for value, _ in facet):
            return None
        if all(isinstance(value, bool) for value, _ in facet):
            text = self.condition(sum(where for value, where in facet if value), self.mask, node)
            return Term(text, "int", ATOM if text.isidentifier() or text.isdigit() else CHOICE)
        inner = node
        while isinstance(inner, ast.Call) and len(inner.args) == 1:
            inner = inner.args[0]
        name = inner.id if isinstance(inner, ast.Name) else inner.attr if isinstance(inner, ast.Attribute) else ""
        if name and not any(hasattr(value, "value") for value, _ in facet):
            found = self._macro(name, facet, kind)
            if found is not None:
                return found
        plain = name.strip("_") if isinstance(inner, ast.Name) else ""
        return self._alike(facet, kind, plain) if len(facet) == 1 else self._varied(facet, kind, plain)

    def _macro(self, name: str, facet: Facet, kind: str | None) -> Term | None:
        """Return the macro of a number: of its own name, or the only number of the tableau with its value."""
        want: list[Any] = []
        for mask in self.translator.precisions:
            found = {value for value, where in facet if where & mask}
            if len(found) > 1:
                return None
            want.append(found.pop() if found else None)
        plain = re.sub(r"^_+|_+$", "", name).upper()
        macros = self.translator.macros
        fits = [macro for macro, known in macros.items() if all(map(_is_same, want, known.values))]
        named = [each for each in fits if each == plain or each.endswith(f"_{plain}")]
        of_tableau = [each for each in fits if each.startswith("RKN_")]
        is_number = any(isinstance(each, float) for each in want)
        if len(named) == 1:
            chosen = named[0]
        elif len(of_tableau) == 1 and is_number:
            chosen = of_tableau[0]
        else:
            return None
        is_real = macros[chosen].is_real
        if is_real and kind not in ("real", None):
            return None  # rounded to the kernel's precision
        if not is_real and kind == "real" and is_number:
            return Term(f"(real){chosen}", "real", UNARY)
        return Term(chosen, kind or ("real" if is_real else "double" if is_number else "int"))

    def _alike(self, facet: Facet, kind: str | None, name: str) -> Term:
        """Write a number that is the same in all scenes."""
        found = self.number(facet[0][0], kind)
        if name.isupper() and found.type in ("double", "real", "int") and kind != "float":
            if name not in self.translator.taken and self._define(name, found.text):
                return Term(name, found.type)
        if name and name != "int" and found.type == "int":
            return Term(f"{found.text} /* {name.lower()} */", found.type, found.rank)
        return found

    def _varied(self, facet: Facet, kind: str | None, name: str) -> Term:
        """Write a number that differs between scenes."""
        whole = self.scenes.number_macro(facet)
        if whole is not None:
            return Term(whole, "int")
        if name:
            macro = f"{self.name}_{name}".upper() if name.upper() in self.translator.taken else name.upper()
            if self._define(macro, self._choice(facet, None)):
                return Term(macro, "int")
        return Term(self._choice(facet, kind), kind or "int")

    def _define(self, name: str, text: str) -> bool:
        """Define a macro in the function's module; False if it is another number there."""
        known = self.translator.defined.setdefault(self.module, {})
        if known.setdefault(name, text) != text:
            return False
        self.defines[name] = text
        return True

    def _choice(self, facet: Facet, kind: str | None) -> str:
        """Write the numbers of scenes with ?:, the most frequent last."""
        facet = sorted(facet, key=lambda each: -each[1].bit_count())
        left, text = (self.names.full if kind is None else self.mask) & sum(where for _, where in facet), ""
        for value, where in facet[1:]:
            text += f"{self.scenes.condition(where & left, left)} ? {self.number(value, kind).text} : "
            left &= ~where
        return f"({text}{self.number(facet[0][0], kind).text})"

    def vector_constant(self, facet: Facet) -> Term:
        """Write a vector that is known in each scene."""
        kind = self.kinds.of([(type(value), where) for value, where in facet])
        is_whole, parts = base(kind) == "int", []
        for k in range(width(kind)):
            each: dict[Any, int] = {}
            for value, where in facet:
                number = int(value[k]) if is_whole else float(value[k])
                each[number] = each.get(number, 0) | where
            known = list(each.items())
            scalar = None if is_whole else base(kind)
            parts.append(self.number(known[0][0], scalar).text if len(known) == 1 else self._choice(known, scalar))
        return Term(f"({kind})({', '.join(parts)})", kind, UNARY)


def _is_same(one: Any, two: Any) -> bool:
    return one is None or (one == two and isinstance(one, int) == isinstance(two, int))
