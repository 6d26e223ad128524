"""Programs that call every device function which both engines have, once a row of numbers, on each engine.

Their text is made from the declarations that scripts/kernel_arguments compares. A row of the input holds the arguments
of one function after those of another, a row of the output what they give back; a struct is its members in order.
"""

import ast
import importlib.util
import inspect
import textwrap
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import warp as wp

from aerokernels.tracing.engines.layout import STRUCTS
from aerokernels.tracing.engines.warp.types import types

FIRST = ("field", "bounds", "control")
HEADERS = ("ends.h", "error.h", "event_location.h", "step.h", "support.h", "sobol.h", "groups.h")
GRID_HEADERS = ("unresolved.h", "flight_sums.h")


class Twin(NamedTuple):
    """A function on both sides: its arguments, name and kind, and the kinds of what it gives back."""

    name: str
    warp: wp.Function
    opencl: tuple
    arguments: tuple[tuple[str, str], ...]
    results: tuple[str, ...]


def members(kind: str) -> list[tuple[str, str]]:
    """The members of a struct, or the number or vector itself, under no name."""
    return [(f".{member.name}", member.kind) for member in STRUCTS[kind]] if kind in STRUCTS else [("", kind)]


def width(kind: str) -> int:
    """Numbers in a kind."""
    return sum(int(inner[-1]) if inner[-1].isdigit() else 1 for _, inner in members(kind))


class Program(NamedTuple):
    """The twins of one kind of scene, and where their numbers lie in rows."""

    twins: list[Twin]
    given: dict[str, int]
    out: dict[str, int]

    @property
    def given_width(self) -> int:
        """Numbers in a row of the input."""
        return sum(width(kind) for twin in self.twins for name, kind in twin.arguments if name not in FIRST)

    @property
    def out_width(self) -> int:
        """Numbers in a row of the output."""
        return sum(width(kind) for twin in self.twins for kind in twin.results)


def program(twins: list[Twin]) -> Program:
    """Functions one after the other."""
    made = Program(twins, {}, {})
    given = out = 0
    for twin in twins:
        made.given[twin.name], made.out[twin.name] = given, out
        given += sum(width(kind) for name, kind in twin.arguments if name not in FIRST)
        out += sum(map(width, twin.results))
    return made


def opencl_text(made: Program, on_mesh: bool) -> str:
    """The source of kernel `twins`; contraction is off, since Warp's compiler contracts nothing on a CPU."""
    lines = ["#pragma OPENCL FP_CONTRACT OFF", '#include "arguments.h"']
    lines += [f'#include "{name}"' for name in (*HEADERS, *(() if on_mesh else GRID_HEADERS))]
    calls = []
    for twin in made.twins:
        lines += [f"static void of_{twin.name}(const Field *field, const Bounds *bounds, const Control *control,"]
        lines += ["    const Arrays *arrays, __global const double *in, __global double *out)", "{"]
        starts = f"given + {made.given[twin.name]}, out + {made.out[twin.name]}"
        calls.append(f"of_{twin.name}(&field, &bounds, &control, &arrays, {starts});")
        place = 0
        given = dict(twin.arguments)
        for name, kind in twin.opencl.arguments:
            plain = kind.removeprefix("const ").rstrip("*")
            if name in FIRST or name == "arrays":
                continue
            if name not in given:
                lines.append(f"{plain} {name}{' = 1 << 20' if '*' not in kind else ''};")
                continue
            lines.append(f"{plain} {name};")
            for member, inner in members(plain):
                lines.append(f"{name}{member} = {_opencl_number(inner, place)};")
                place += width(inner)
        passed = (*FIRST, "arrays")
        call = ", ".join(f"&{n}" if "*" in kind and n not in passed else n for n, kind in twin.opencl.arguments)
        result = twin.opencl.result
        lines.append(f"{'' if result == 'void' else f'const {result} answer = '}{twin.name}({call});")
        answers = [] if result == "void" else ["answer"]
        answers += [name for name, _ in twin.opencl.back]
        place = 0
        for answer, kind in zip(answers, twin.results, strict=True):
            for member, inner in members(kind):
                for k in range(width(inner)):
                    part = f".s{k}" if width(inner) > 1 else ""
                    lines.append(f"out[{place}] = (double){answer}{member}{part};")
                    place += 1
        lines.append("}")
    lines += ["__kernel void twins(const Field field, const Bounds bounds, const Control control, ARRAY_ARGUMENTS,"]
    lines += ["    __global const double *given, __global double *out)", "{", "const Arrays arrays = ARRAYS;"]
    lines += [f"given += get_global_id(0) * {made.given_width};", f"out += get_global_id(0) * {made.out_width};"]
    return "\n".join([*lines, *calls, "}", ""])


def _opencl_number(kind: str, place: int) -> str:
    count = width(kind)
    scalar = kind.rstrip("234").replace("bool", "int")
    numbers = ", ".join(f"({scalar})in[{place + k}]" for k in range(count))
    return f"({scalar}{count})({numbers})" if count > 1 else numbers


def warp_module(made: Program, folder: Path) -> ModuleType:
    """A module with kernel `twins`, written into a folder: Warp reads a kernel's source.

    It has two indices: with one, Warp compiles it twice for a CPU (see kernels/trace.py).
    """
    lines = [
        '@wp.kernel(module="unique", enable_backward=False, module_options={"optimization_level": 1})',
        "def twins(",
    ]
    lines += ["    field: Field, bounds: Bounds, control: Control, given: wp.array(dtype=wp.float64),"]
    lines += ["    out: wp.array(dtype=wp.float64),", "):", "    row, _ = wp.tid()"]
    for number, twin in enumerate(made.twins):
        lines += [f"    i{number} = row * {made.given_width} + {made.given[twin.name]}"]
        lines += [f"    o{number} = row * {made.out_width} + {made.out[twin.name]}"]
        call, place = [], 0
        for name, kind in twin.arguments:
            if name in FIRST:
                call.append(name)
                continue
            word = f"{name}_{number}"
            if kind in STRUCTS:
                lines.append(f"    {word} = {kind}()")
            for member, inner in members(kind):
                lines.append(f"    {word}{member} = {_warp_number(inner, number, place)}")
                place += width(inner)
            call.append(word)
        answers = [f"answer_{number}_{k}" for k in range(answer_count(twin.warp))]
        lines.append(f"    {', '.join(answers)} = {twin.name}({', '.join(call)})")
        parts: list[tuple[str, str]] = []
        if len(answers) == len(twin.results):
            for answer, kind in zip(answers, twin.results, strict=True):
                for member, inner in members(kind):
                    count = width(inner)
                    parts += [(f"{answer}{member}{f'[{k}]' if count > 1 else ''}", inner) for k in range(count)]
        else:  # one vector of them all
            assert len(answers) == 1, twin.name
            parts = [(f"{answers[0]}[{k}]", "real") for k in range(sum(map(width, twin.results)))]
        for place, (part, kind) in enumerate(parts):
            number_of = (
                f"wp.where({part}, wp.float64(1.0), wp.float64(0.0))" if kind == "bool" else f"wp.float64({part})"
            )
            lines.append(f"    out[o{number} + {place}] = {number_of}")
    path = folder / "warp_twins.py"
    path.write_text("\n".join([*lines, ""]))
    spec = importlib.util.spec_from_file_location("warp_twins", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    vars(module).update({"wp": wp, **types("float64").kinds, **{twin.name: twin.warp for twin in made.twins}})
    spec.loader.exec_module(module)
    return module


def _warp_number(kind: str, number: int, place: int) -> str:
    count = width(kind)
    scalar = kind.rstrip("234")
    given = [f"given[i{number} + {place + k}]" for k in range(count)]
    if scalar == "bool":
        return f"bool({given[0]} != wp.float64(0.0))"
    plain = {"int": "int", "uint": "wp.uint32", "real": "wp.float64", "double": "wp.float64"}[scalar]
    numbers = [f"{plain}({text})" for text in given]
    if count == 1:
        return numbers[0]
    vector = "wp.vec3i" if scalar == "int" else f"{scalar}{count}" if scalar == "real" else f"wp.vec{count}d"
    return f"{vector}({', '.join(numbers)})"


def answer_count(function: wp.Function) -> int:
    """How many answers a Warp function returns."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function.func)))
    returned = [node.value for node in ast.walk(tree) if isinstance(node, ast.Return)]
    return max(len(value.elts) if isinstance(value, ast.Tuple) else 1 for value in returned)


def run_warp(made: Program, folder: Path, structs: list, given: np.ndarray) -> np.ndarray:
    """What the Warp twins give, a row for each of the input."""
    out = wp.zeros(len(given) * made.out_width, dtype=wp.float64, device="cpu")
    numbers = wp.array(given.ravel(), dtype=wp.float64, device="cpu")
    wp.launch(warp_module(made, folder).twins, dim=(len(given), 1), inputs=[*structs, numbers, out], device="cpu")
    return out.numpy().reshape(len(given), made.out_width)


def run_opencl(
    text: str, made: Program, engine, options: tuple[str, ...], arguments: list, given: np.ndarray
) -> np.ndarray:
    """What the OpenCL twins give, a row for each of the input."""
    import pyopencl as cl

    built = cl.Program(engine.session.context, text).build(["-cl-std=CL1.2", "-w", *options])
    out = np.zeros((len(given), made.out_width))
    buffer = engine.put(out)
    kernel = cl.Kernel(built, "twins")
    kernel(engine.session.queue, (len(given),), None, *arguments, engine.put(given), buffer)
    engine.get(buffer, out)
    return out
