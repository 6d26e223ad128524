"""Compares the arguments of the Warp kernels with those of their OpenCL twins: names, order and types.

A kernel of one backend needs a namesake in the other. Members of the structs Field, Bounds and Control are compared
too. OpenCL differs from Warp in these ways only:

- arrays in Warp's structs are arguments of their own, after the structs and in their order;
- `ray_count` follows `first_ray`, `group_count` `first_group`, `sum_count` `first_sum`: its launches are rounded up;
- vectors are plain arrays in structs, and three of them are packed in arrays.

Prints what differs; exit status 1 where something does. Reads the OpenCL sources as text: no OpenCL is needed.
"""

import argparse
import re
import sys
from dataclasses import dataclass
from difflib import ndiff
from pathlib import Path

import warp as wp

from aerokernels.tracing.engines.warp.kernels import pupil
from aerokernels.tracing.engines.warp.kernels.leapfrog import build_leapfrog_kernel
from aerokernels.tracing.engines.warp.kernels.trace import build_kernel
from aerokernels.tracing.engines.warp.kernels.trace_projection import build_projection_kernel
from aerokernels.tracing.engines.warp.types import types

KERNELS = Path(__file__).resolve().parents[1] / "kernels"
# The first of a launch's work-items, and what bounds them.
BOUNDS = {"first_ray": "ray_count", "first_group": "group_count", "first_sum": "sum_count"}
STRUCTS = ("Field", "Bounds", "Control")
# float32 stands for the kernel's precision: that is what the Warp kernels are built for here.
SCALARS = {
    wp.float32: "real",
    wp.float64: "double",
    wp.int32: "int",
    int: "int",
    wp.uint32: "uint",
}


@dataclass(frozen=True)
class Argument:
    """An argument of a kernel or a member of a struct; the type in OpenCL's words."""

    name: str
    type: str

    def __str__(self) -> str:
        """As it is declared."""
        return f"{self.type} {self.name}"


def warp_kernels() -> dict[str, wp.Kernel]:
    """Every Warp kernel by name; the tracer's arguments do not depend on what it is built for."""
    kernels = [kernel for kernel in vars(pupil).values() if isinstance(kernel, wp.Kernel)]
    kernels.append(build_kernel("float32", "volume", "cubic", False, "adaptive", "none", False, True))
    kernels.append(build_projection_kernel("float32", True))
    kernels.append(build_leapfrog_kernel("float32", "volume", "cubic", "none", False))
    return {kernel.func.__name__: kernel for kernel in kernels}


def expected_arguments(kernel: wp.Kernel) -> list[Argument]:
    """The arguments that the OpenCL twin of a Warp kernel needs."""
    given = [(variable.label, variable.type) for variable in kernel.adj.args]
    structs = [Argument(name, kind.cls.__name__) for name, kind in given if _is_struct(kind)]
    arrays = [
        Argument(name, _array_type(member))
        for _, kind in given
        if _is_struct(kind)
        for name, member in _members(kind)
        if _is_array(member)
    ]
    others = []
    for name, kind in given:
        if not _is_struct(kind):
            others.append(Argument(name, _array_type(kind) if _is_array(kind) else _value_type(kind)))
        if name in BOUNDS:
            others.append(Argument(BOUNDS[name], "int"))
    return [*structs, *arrays, *others]


def expected_members(struct) -> list[Argument]:
    """The members that the OpenCL twin of a Warp struct needs."""
    members = []
    for name, kind in _members(struct):
        if not _is_array(kind):
            members.append(Argument(name, _value_type(kind, in_struct=True)))
    return members


def _is_struct(kind) -> bool:
    return hasattr(kind, "vars") and hasattr(kind, "key")


def _is_array(kind) -> bool:
    return isinstance(kind, wp.array)


def _members(struct) -> list[tuple]:
    return [(name, variable.type) for name, variable in struct.vars.items()]


def _vector(kind) -> tuple[str, int]:
    """OpenCL's name of the scalar, and the length; 1 for a scalar."""
    if kind in SCALARS:
        return SCALARS[kind], 1
    return SCALARS[kind._wp_scalar_type_], kind._length_


def _value_type(kind, in_struct: bool = False) -> str:
    scalar, length = _vector(kind)
    if length == 1:
        return scalar
    return f"{scalar}[{length}]" if in_struct else f"{scalar}{length}"


def _array_type(kind) -> str:
    return f"{_vector(kind.dtype)[0]}*"


def opencl_kernels(folder: Path) -> dict[str, list[Argument]]:
    """The arguments of every kernel in a folder's *.cl files, by its name."""
    kernels = {}
    for path in sorted(folder.glob("*.cl")):
        for name, inside in re.findall(r"__kernel\s+void\s+(\w+)\s*\(([^)]*)\)", _plain(path)):
            kernels[name] = [_declared(declaration) for declaration in inside.split(",")]
    return kernels


def opencl_structs(folder: Path) -> dict[str, list[Argument]]:
    """The members of every struct in include/types.h, by its name."""
    found = re.findall(r"typedef\s+struct\s*\{([^}]*)\}\s*(\w+)\s*;", _plain(folder / "include" / "types.h"))
    return {name: [_declared(text) for text in inside.split(";") if text.strip()] for inside, name in found}


def _plain(path: Path) -> str:
    """A source without comments and lines for the preprocessor."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", " ", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*$", "", text, flags=re.MULTILINE)


def _declared(declaration: str) -> Argument:
    """An argument from a declaration such as "__global const double *x" or "int row[3]"."""
    words = re.findall(r"\w+|[*\[\],]", declaration)
    words = [word for word in words if word not in ("__global", "global", "const", "restrict", "__restrict")]
    match words:
        case [kind, name]:
            return Argument(name, kind)
        case [kind, "*", name]:
            # A vector of two is packed like two numbers.
            return Argument(name, re.sub(r"2$", "", kind) + "*")
        case [kind, name, "[", length, "]"]:
            return Argument(name, f"{kind}[{length}]")
    raise ValueError(f"cannot read the declaration {' '.join(declaration.split())!r}: one name each, no macros")


def differences(folder: Path) -> list[str]:
    """What differs between the Warp kernels and the OpenCL ones of a folder, for people; empty where nothing does."""
    found = []
    ours, theirs = warp_kernels(), opencl_kernels(folder)
    found += [f"kernel {name}: Warp has it, OpenCL does not\n" for name in sorted(ours.keys() - theirs.keys())]
    found += [f"kernel {name}: OpenCL has it, Warp does not\n" for name in sorted(theirs.keys() - ours.keys())]
    for name in sorted(ours.keys() & theirs.keys()):
        found += _compare(f"kernel {name}", expected_arguments(ours[name]), theirs[name])
    structs = opencl_structs(folder)
    for name in STRUCTS:
        found += _compare(f"struct {name}", expected_members(getattr(types("float32"), name)), structs.get(name, []))
    return found


def _compare(title: str, warp: list[Argument], opencl: list[Argument]) -> list[str]:
    if warp == opencl:
        return []
    lines = [line for line in ndiff([f"{a}" for a in warp], [f"{a}" for a in opencl]) if not line.startswith("?")]
    return ["\n".join([f"{title}: '-' Warp only, '+' OpenCL only", *(f"    {line}" for line in lines), ""])]


def main() -> int:
    """Compare and tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kernels", type=Path, default=KERNELS, help="the OpenCL sources (default: %(default)s)")
    folder = parser.parse_args().kernels
    if not (folder / "include" / "types.h").is_file():
        print(f"error: {folder} has no include/types.h: name the folder of the OpenCL sources", file=sys.stderr)
        return 2
    found = differences(folder)
    print("\n".join(found) if found else "the arguments of the Warp and the OpenCL kernels agree")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
