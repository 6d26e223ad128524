"""Compare the device functions that Warp's kernels and their OpenCL twins share: names, arguments, order and types.

The kernels' own arguments come from one table (kernel_table.py in aerokernels/tracing/engines); for kernels the script
only checks that each exists on both sides and takes its arguments from the table. Functions may differ only as follows:

- OpenCL collects arrays of structs in struct Arrays, which replaces the field if nothing else is needed;
- OpenCL functions have additional arguments for the bounds of a launch;
- values that OpenCL returns by pointers are returned after the value by Warp, or are arguments of the same name, too;
- functions of a packet of rays (lanes.h) have a number per ray where Warp has vectors of one ray.

Prints the differences; exit status 1 if there are any. Reads the OpenCL sources as text, so OpenCL is not needed.
"""

import argparse
import re
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import warp as wp

from aerokernels.tracing.engines.kernel_table import BOUNDS, KERNELS
from aerokernels.tracing.engines.warp.kernels import grid_tables, new_values, pupil
from aerokernels.tracing.engines.warp.kernels.deliver_bundle import build_bundle_kernel
from aerokernels.tracing.engines.warp.kernels.leapfrog import build_leapfrog_kernel
from aerokernels.tracing.engines.warp.kernels.trace import build_kernel
from aerokernels.tracing.engines.warp.library import library_of
from aerokernels.tracing.engines.warp.types import types

FOLDER = Path(__file__).resolve().parents[1] / "kernels"
GRIDS = ("volume", "planar", "axisymmetric")
# Types with a number per ray of a packet; the types of a packet's ends correspond to Warp's for one ray.
LANES = ("reals", "ints", "mask")
OF_ONE_RAY = {"doubles": "double", "truths": "int", "Triples": "double3"}

Arguments = list[tuple[str, str]]


class Declared(NamedTuple):
    """A device function of OpenCL: its return type, and its arguments with their types, pointers with a star."""

    result: str
    arguments: Arguments

    @property
    def given(self) -> Arguments:
        """Arguments of its twin: without pointers, and with arrays in their struct."""
        arguments = self.arguments
        if not {"const Field*", "const Control*"} & {kind for _, kind in arguments}:
            arguments = [("field", "Field") if "Arrays" in kind else (word, kind) for word, kind in arguments]
        return [
            (word, kind.removeprefix("const ").rstrip("*"))
            for word, kind in arguments
            if "Arrays" not in kind and word not in BOUNDS.values()
        ]

    @property
    def back(self) -> Arguments:
        """Values that it returns by pointers."""
        return [(word, kind[:-1]) for word, kind in self.arguments if kind.endswith("*") and "const" not in kind]


def warp_kernels() -> list[wp.Kernel]:
    """Return every Warp kernel, the tracers for all geometries and stops."""
    files = (pupil, grid_tables, new_values)
    kernels = [kernel for file in files for kernel in vars(file).values() if isinstance(kernel, wp.Kernel)]
    library = library_of("float32")
    kernels.append(grid_tables.build_rounding_kernel(library))
    for geometry, stop in product(GRIDS, ("none", "plane", "arc")):
        kernels.append(build_kernel(library, geometry, "linear", False, "adaptive", stop, True, True))
        kernels.append(build_leapfrog_kernel(library, geometry, "cubic", stop, True))
    kernels.append(build_kernel(library, "planar", "bilinear-barron", True, "paper", "none", False, True))
    kernels.append(build_bundle_kernel(library, 8))
    return kernels


def warp_functions() -> dict[str, Arguments]:
    """Return the arguments of every device function of the Warp kernels, by its name."""
    kinds = {kind: name for name, kind in types("float32").kinds.items()} | {int: "int", bool: "int", wp.bool: "int"}
    found: dict[str, Arguments] = {}
    for kernel in warp_kernels():
        for function in reached(kernel.func):
            variables = function.adj.args
            found[function.func.__name__] = [(v.label, kinds.get(v.type, "any")) for v in variables]
    return found


def reached(function: Any) -> Iterator[wp.Function]:
    """Yield the device functions that a function calls, directly or indirectly."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    for name in function.__code__.co_names:
        cells.append(function.__globals__.get(name))
    for called in cells:
        if isinstance(called, wp.Function) and called.func is not None and called.adj is not None:
            yield called
            yield from reached(called.func)


def opencl_functions(folder: Path) -> dict[str, Declared]:
    """Return every device function of a folder's sources, by its name."""
    found = {}
    for path in sorted((*folder.glob("*.cl"), *folder.glob("include/*.h"))):
        pattern = r"^(?:APART )?(?:static )?(?:inline )?(\w+)\s+(\w+)\(([^)]*)\)\s*\{"
        for result, name, inside in re.findall(pattern, plain(path), flags=re.MULTILINE):
            found[name] = Declared(OF_ONE_RAY.get(result, result), [declared(text) for text in inside.split(",")])
    return found


def plain(path: Path) -> str:
    """Return a source without comments and preprocessor lines."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", " ", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*$", "", text, flags=re.MULTILINE)


def declared(declaration: str) -> tuple[str, str]:
    """Return name and type of an argument such as "const Field *field"."""
    words = [OF_ONE_RAY.get(word, word) for word in re.findall(r"\w+|\*", declaration.replace("__global", ""))]
    return words[-1], f"{' '.join(words[:-1])}".replace(" *", "*")


def differences(folder: Path) -> list[str]:
    """Return the differences between the twins as texts."""
    found = []
    heads = dict(re.findall(r"__kernel\s+void\s+(\w+)\s*\(([^)]*)\)", "".join(map(plain, sorted(folder.glob("*.cl"))))))
    ours = {kernel.func.__name__ for kernel in warp_kernels()}
    for name in sorted(ours | heads.keys() | KERNELS.keys()):
        for side, there in (("Warp", ours), ("OpenCL", heads), ("kernel_table.py", KERNELS)):
            if name not in there:
                found.append(f"kernel {name}: {side} does not have it")
        if name in heads and heads[name].strip() != f"{name.upper()}_ARGUMENTS":
            found.append(f"kernel {name}: its arguments are not {name.upper()}_ARGUMENTS, but {heads[name].strip()}")
    warp = warp_functions()
    for name, function in opencl_functions(folder).items():
        if name in warp and not any(kind in LANES for _, kind in function.arguments):
            found += compare(name, warp[name], function)
    return found


def compare(name: str, warp: Arguments, opencl: Declared) -> list[str]:
    """Return the differences between the arguments of a function's twins."""
    names = [word for word, _ in warp]
    theirs = [argument for argument in opencl.given if argument not in opencl.back or argument[0] in names]
    if [word for word, _ in theirs] == names and all(
        kind in (other, "any") for (_, kind), (_, other) in zip(warp, theirs, strict=True)
    ):
        return []
    return [f"function {name}:\n    Warp   {told(warp)}\n    OpenCL {told(theirs)}"]


def told(arguments: Arguments) -> str:
    """Return arguments as they are declared."""
    return ", ".join(f"{kind} {word}" for word, kind in arguments)


def main() -> int:
    """Compare, and print the differences."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kernels", type=Path, default=FOLDER, help="the OpenCL sources (default: %(default)s)")
    folder = parser.parse_args().kernels
    if not (folder / "include").is_dir():
        print(f"error: {folder} has no folder include: name the folder of the OpenCL sources", file=sys.stderr)
        return 2
    found = differences(folder)
    shared = warp_functions().keys() & opencl_functions(folder).keys()
    print("\n".join(found) if found else f"the twins agree: {len(KERNELS)} kernels, {len(shared)} device functions")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
