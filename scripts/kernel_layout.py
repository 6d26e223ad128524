"""The texts of the headers that follow from aerokernels/tracing/engines/layout.py: options, structs, arguments."""

from collections.abc import Iterable, Sequence
from textwrap import wrap

from aerokernels.tracing.engines.layout import BOUNDS, KERNELS, OPTIONS, STRUCTS, Value, arrays_of, values_of
from aerokernels.tracing.engines.opencl.program import in_c

# Structs that are passed to kernels: their arrays are arguments of their own, in OpenCL gathered in struct Arrays.
GIVEN = ("Field", "Bounds", "Control")


def options() -> list[str]:
    """The lines of options.h: every option, its names, and what it is by default."""
    lines: list[str] = []
    for name, (choices, meaning) in OPTIONS.items():
        lines += ["", f"// {in_c(name)}: {meaning}."]
        if isinstance(choices, tuple):
            lines += [f"#define {in_c(choice)} {number}" for number, choice in enumerate(choices, start=1)]
        default = in_c(choices[0]) if isinstance(choices, tuple) else choices
        lines += [f"#ifndef {in_c(name)}", f"#define {in_c(name)} {default}", "#endif"]
    return lines[1:]


def types() -> list[str]:
    """The lines of types.h: structs passed by value, the arrays that belong to them, and structs inside kernels."""
    lines = ['#include "real.h"']
    for name in STRUCTS:
        if values_of(name):
            lines += _struct(name, [_member(member, name in GIVEN) for member in values_of(name)])
    given = [member for name in GIVEN for member in arrays_of(name)]
    lines += _struct("Arrays", [_member(member, True) for member in given])
    lines += _struct("RayOutputs", [_member(member, False) for member in STRUCTS["RayOutputs"]])
    return lines


def arguments() -> list[str]:
    """The lines of arguments.h: a macro with the arguments of each kernel, and the structs of arrays made of them."""
    arrays = [member for name in GIVEN for member in arrays_of(name)]
    outputs = [member._replace(name=f"{member.name}_out") for member in STRUCTS["RayOutputs"]]
    lines = ['#include "types.h"']
    for name, members in {"ARRAY": arrays, "RAY_OUTPUT": outputs}.items():
        lines += _macro(f"{name}_ARGUMENTS", map(_argument, members))
        lines += _macro(f"{name}S", [member.name for member in members], "{", "}")
    for name, values in KERNELS.items():
        lines += _macro(f"{name.upper()}_ARGUMENTS", declared(values))
    return lines


def declared(values: Sequence[Value]) -> list[str]:
    """The arguments of a kernel as OpenCL C declares them."""
    found = [_argument(value) for value in values if value.kind in GIVEN]
    found += ["ARRAY_ARGUMENTS"] if found else []
    for value in values:
        if value.kind not in GIVEN:
            found.append("RAY_OUTPUT_ARGUMENTS" if value.kind == "RayOutputs" else _argument(value))
        if value.name in BOUNDS:
            found.append(f"const int {BOUNDS[value.name]}")
    return found


def _argument(value: Value) -> str:
    """An array is one of plain numbers, since OpenCL keeps vectors of three apart from one another."""
    if not value.parts[2]:
        return f"const {value.kind} {value.name}"
    constant = "" if value.name.endswith("_out") else "const "
    return f"__global {constant}{value.parts[0]} *{value.name}"


def _member(member: Value, packed: bool) -> tuple[str, str]:
    """Declaration and meaning; vectors of structs that the host fills are plain arrays, laid out as NumPy does."""
    kind, width, indices = member.parts
    kind = kind.replace("bool", "int")
    if indices:
        constant = "const " if packed else ""
        return f"__global {constant}{kind} *{member.name};", member.meaning
    if width > 1 and packed:
        return f"{kind} {member.name}[{width}];", member.meaning
    return f"{kind}{width if width > 1 else ''} {member.name};", member.meaning


def _struct(name: str, members: Sequence[tuple[str, str]]) -> list[str]:
    width = max(len(text) for text, _ in members)
    lines = [f"    {text:<{width}}  // {meaning}" if meaning else f"    {text}" for text, meaning in members]
    return ["", "typedef struct {", *lines, f"}} {name};"]


def _macro(name: str, parts: Iterable[str], opening: str = "", closing: str = "") -> list[str]:
    """A macro of several lines, none of which ends within a part."""
    whole = opening + ", ".join(part.replace(" ", "\N{NO-BREAK SPACE}") for part in parts) + closing
    lines = [line.replace("\N{NO-BREAK SPACE}", " ") for line in wrap(whole, 112, break_long_words=False)]
    return ["", f"#define {name} \\", *(f"    {line} \\" for line in lines[:-1]), f"    {lines[-1]}"]
