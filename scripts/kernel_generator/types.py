"""Types in C of Warp's types, terms of expressions, and members of structs."""

from typing import Any, NamedTuple

import warp as wp

from aerokernels.tracing.engines.layout import STRUCTS
from aerokernels.tracing.engines.warp.library import PLAIN, TYPES

from .scenes import Facet

# Structs that kernels get by value and functions by pointer; their arrays are in struct Arrays.
GIVEN = ("Field", "Bounds", "Control")
POINTERS = (*GIVEN, "RayOutputs")
# Arguments of kernels for the first of what a launch is over, and what comes behind them in C: one past the last.
BEGINS = {f"first_{name}": f"{name}_count" for name in ("ray", "line", "place", "sum")}
# How tightly operators bind; a term that binds less tightly than its place asks gets brackets.
ATOM, POSTFIX, UNARY, PRODUCT, AND, OR, CHOICE = 16, 15, 14, 13, 5, 4, 3
PICKS = {"real3": "pick", "real4": "pick4", "double3": "pick64", "double4": "pick4_64", "int3": "pick_int"}


class Term(NamedTuple):
    """An expression in C: its text, its type ("*real" is an array), and how tightly its operator binds."""

    text: str
    type: str
    rank: int = ATOM

    def within(self, rank: int) -> str:
        """Return the text, in brackets if its operator binds less tightly."""
        return self.text if self.rank >= rank else f"({self.text})"


def base(kind: str) -> str:
    """Return the scalar type of a vector."""
    return kind.rstrip("0123456789")


def width(kind: str) -> int:
    """Return how many numbers a type has; 1 for structs."""
    digits = kind[len(base(kind)) :]
    return int(digits) if digits and base(kind) in ("real", "float", "double", "int", "uint") else 1


class Types:
    """The types of both precisions: one that is float32 in one and float64 in the other is `real`.

    Attributes:
        members: The members of structs, by struct and name.
        parts: Names and types of the parts of tuples, by the struct that stands for them.
    """

    def __init__(self) -> None:
        """Collect the types of layout.py."""
        self._plain: dict[Any, str] = {kind: name.replace("bool", "int") for name, kind in PLAIN.items()}
        self._plain |= {wp.float32: "float", wp.int64: "long", int: "int", float: "float", bool: "int"}
        singles, doubles = TYPES["float32"], TYPES["float64"]
        self._real: dict[frozenset, str] = {frozenset((wp.float32, wp.float64)): "real"}
        for size in (2, 3, 4):
            one, two = singles.kinds[f"real{size}"], doubles.kinds[f"real{size}"]
            self._real[frozenset((one, two))] = f"real{size}"
            self._plain.setdefault(one, f"float{size}")
            self._plain.setdefault(two, f"double{size}")
        for name in STRUCTS:
            self._plain[singles.kinds[name]] = self._plain[doubles.kinds[name]] = name
        self.members = {name: {each.name: each for each in members} for name, members in STRUCTS.items()}
        self.parts: dict[str, list[tuple[str, str]]] = {}

    def of(self, facet: Facet) -> str:
        """Return the type in C of Warp types.

        Raises:
            TypeError: There is none, or there are several.
        """
        found = self._real.get(frozenset(value for value, _ in facet))
        names = {found} if found else {self._one(value) for value, _ in facet}
        if len(names) != 1:
            raise TypeError(f"types {', '.join(sorted(map(str, names)))}")
        return str(names.pop())

    def argument(self, facet: Facet) -> str:
        """Return the type of an argument, "*real" for an array of them."""
        if type(facet[0][0]).__name__ == "array":
            return f"*{self.of([(each.dtype, mask) for each, mask in facet])}"
        return self.of(facet)

    def _one(self, kind: Any) -> str:
        if kind in self._plain:
            return self._plain[kind]
        if getattr(kind, "_length_", 0) > 4:
            return f"{self._one(kind._wp_scalar_type_)}[{kind._length_}]"  # an array
        raise TypeError(f"type {kind!r}")
