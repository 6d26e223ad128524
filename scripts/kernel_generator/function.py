"""A whole function or kernel: its head, its body, and the struct that it returns in place of a tuple."""

import ast
from typing import Any, NamedTuple

from .source import RESERVED
from .statements import Statements
from .text import WIDTH, comment, filled, indented, wrapped
from .types import BEGINS, GIVEN, POINTERS, base

# Functions that are called, not inlined, on a CPU, which halves the time to compile.
APART = set(
    "start_of stop_geometry_of end_of has_clearance behind_wall body_exit body_entry time_beyond_face "
    "leaves_by_rounding overshoots in_face surface_intersection sample trace_ray".split()
)
PASSES = 3  # until it is known where variables are declared, and which are constant


class Written(NamedTuple):
    """What callers must know of a function."""

    name: str
    type: str
    parts: list[tuple[str, str]]
    takes_arrays: bool


class Function(Statements):
    """Writes a function; `generic` has the types of the arguments of one that takes any."""

    generic: tuple[str, ...] = ()

    def begin(self) -> None:
        """Begin to write it: take its arguments."""
        if self.is_kernel:
            self._keep_apart()
        super().begin()
        for k, each in enumerate(self.source.tree.args.args):
            self.argue(each.arg, self.generic[k] if self.generic else self._annotated(each))

    def _keep_apart(self) -> None:
        """Rename local variables that are named like one of the arrays among a kernel's arguments."""
        members = self.kinds.members
        clash = {f"{member}_out" for member in members["RayOutputs"]}
        clash |= {name for given in GIVEN for name, value in members[given].items() if value.kind.endswith("*")}
        clash -= {each.arg for each in self.source.tree.args.args}
        for node in ast.walk(self.source.tree):
            if isinstance(node, ast.Name) and node.id in clash:
                self.source.own.add(f"{node.id}_")
                node.id += "_"

    def _annotated(self, argument: Any) -> str:
        plain = argument.arg.rstrip("_")
        name = plain if plain in RESERVED else argument.arg
        facet = [(made.__annotations__.get(name), mask) for made, mask in self.names.functions]
        try:
            return self.kinds.argument(facet)
        except TypeError as error:
            raise self.fail(argument, str(error)) from error

    def whole(self) -> tuple[Written, str]:
        """Return what callers must know, and the text."""
        for _ in range(PASSES):
            self.begin()
            lines = self.block(self.source.body, ())
        kind, out = self.returns, []
        if kind == "tuple":
            kind = self.result_name
            self.kinds.parts[kind] = self.parts
            out += ["typedef struct {", *(f"    {part} {name};" for name, part in self.parts), f"}} {kind};", ""]
        self.takes_arrays |= self.names.functions[0][0].__code__ in self.translator.with_arrays
        out += [*comment(self.source.doc), *self._head(kind)]
        out += [row for line in indented(lines) for row in wrapped(line)]
        return Written(self.name, kind, self.parts, self.takes_arrays), "\n".join([*out, "}"])

    def _head(self, kind: str) -> list[str]:
        parameters = [(each.arg, self.types[each.arg]) for each in self.source.tree.args.args]
        if self.is_kernel:
            if any(kind in GIVEN for _, kind in parameters):
                out = [f"__kernel void {self.name}(TRACED_ARGUMENTS)", "{"]
                out += ["    const Arrays arrays = ARRAYS;"] if self.takes_arrays else []
            else:
                rows = [row for each in parameters for row in _kernel_arguments(*each)]
                out = [f"__kernel void {self.name}(", *(f"    {row}," for row in rows[:-1]), f"    {rows[-1]})", "{"]
            return out + [f"    const RayOutputs {n} = RAY_OUTPUTS;" for n, t in parameters if t == "RayOutputs"]
        declared = [_declaration(*each) for each in parameters]
        if self.takes_arrays:
            declared.insert(1, "const Arrays *arrays")
        start = f"{'APART' if self.name in APART else 'static inline'} {kind} {self.name}("
        one = f"{start}{', '.join(declared)})"
        if len(one) <= WIDTH:
            return [one, "{"]
        *rows, last = filled(declared, 4)
        return [start, *rows, f"{last})", "{"]


def _kernel_arguments(name: str, kind: str) -> list[str]:
    if kind == "RayOutputs":
        return ["RAY_OUTPUT_ARGUMENTS"]
    constant = "" if kind.startswith("*") else "const "
    return [f"{constant}{_declaration(name, kind)}", *([f"const int {BEGINS[name]}"] if name in BEGINS else [])]


def _declaration(name: str, kind: str) -> str:
    if kind in POINTERS:
        return f"const {kind} *{name}"
    if kind.startswith("*"):
        return f"__global {'' if name.endswith('_out') else 'const '}{base(kind[1:])} *{name}"
    return f"{kind} {name}"
