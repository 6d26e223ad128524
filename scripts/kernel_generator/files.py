"""The files of generated kernels: one a program, and a header for each module of device functions that it uses."""

import importlib
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import warp as wp

from aerokernels.process.opened import OPENED
from aerokernels.tracing.engines.interface import PROGRAMS as ENGINES_PROGRAMS
from aerokernels.tracing.engines.layout import OPTIONS
from aerokernels.tracing.engines.opencl.program import HEADERS, constants, ray_status
from aerokernels.tracing.engines.warp.library import Scene

from .scenes import Scenes, macros_of
from .source import DeviceFunction
from .text import comment, definition
from .translator import Macro, Translator

PLACE = "aerokernels.tracing.engines.warp.kernels"
GRID = ("cubic", "linear", "monotone")
PRECISIONS: dict[str, Sequence] = {"real_is_double": (0, 1)}
SCENE: dict[str, Sequence] = {
    **PRECISIONS,
    "geometry": OPTIONS["geometry"].choices,  # type: ignore[dict-item]
    "interpolation": OPTIONS["interpolation"].choices,  # type: ignore[dict-item]
    "on_mesh": (0, 1),
    "method": OPTIONS["method"].choices,  # type: ignore[dict-item]
    "stop": OPTIONS["stop"].choices,  # type: ignore[dict-item]
    "has_body": (0, 1),
    "measured": (0, 1),
}


class Program(NamedTuple):
    """Kernels of one file.

    Attributes:
        module: Where they are, below PLACE; the file has its name.
        kernels: Their names, each with the builder; one without options is its own.
        options: Compile options and their values.
        is_valid: Which combinations there are.
        headers: Headers by hand that it needs.
    """

    module: str
    kernels: Mapping[str, str]
    options: Mapping[str, Sequence]
    is_valid: Callable[[dict], bool] = lambda _: True
    headers: tuple[str, ...] = ()


def is_scene(scene: dict) -> bool:
    """Whether there are such fields: meshes have interpolations of their own, and none fills a volume."""
    is_mesh = scene["interpolation"] not in GRID
    return bool(scene["on_mesh"]) == is_mesh and not (is_mesh and scene["geometry"] == "volume")


PROGRAMS = (
    Program("trace", {"trace_kernel": "build_kernel"}, SCENE, is_scene),
    Program(
        "deliver_bundle",
        {"deliver_bundle": "build_bundle_kernel"},
        {**PRECISIONS, "channels": (1, 4, 8)},
        headers=("patches.h",),
    ),
    Program("pupil", {name: name for name in ("launch_pupil", "reduce_sums")}, PRECISIONS, headers=("sum_rays.h",)),
    Program("grid_tables", {name: name for name in ENGINES_PROGRAMS["grid_tables"]}, PRECISIONS),
)


COMMAND = "python scripts/generate_kernels.py"
FOLDER = "generated"  # of the headers, within that of the kernels
BY_HAND = ("kinds.h", "real.h")
_DEFINITION = re.compile(r"#define (\w+) (R\()?([-+.\w]+)\)?(?:  //.*)?$")


def texts(folder: Path) -> dict[str, str]:
    """Return the texts of all files by their names below `folder`, that of the kernels.

    Raises:
        Unsupported: A kernel has Python that has no translation.
    """
    found: dict[str, str] = {}
    for program in PROGRAMS:
        for name, text in _files(program, translated(program, folder)).items():
            if found.setdefault(name, text) != text:
                raise ValueError(f"{name} differs between programs")
    return found


def translated(program: Program, folder: Path) -> Translator:
    """Translate the kernels of a program in all their scenes."""
    by_hand = "\n".join((folder / "include" / name).read_text(encoding="utf-8") for name in BY_HAND)
    scenes = Scenes(program.options, program.is_valid, macros_of(by_hand))
    made = _made(program, scenes)
    generated = "\n".join(line for make in HEADERS.values() for line in make())
    taken = set(re.findall(r"#define (\w+)", generated + by_hand))
    known, with_arrays = _macros(), frozenset[Any]()
    while True:  # until it is known which functions take struct Arrays
        translator = Translator(scenes, known, taken, with_arrays)
        for name, functions in made.items():
            translator.kernel(name, functions)
        if translator.with_arrays == with_arrays:
            return translator
        with_arrays = frozenset(translator.with_arrays)


def _made(program: Program, scenes: Scenes) -> dict[str, dict[Callable, int]]:
    """Call each builder in every scene; Warp's decorators are replaced meanwhile, so that it prepares nothing."""
    module = importlib.import_module(f"{PLACE}.{program.module}")
    found: dict[str, dict[Callable, int]] = {name: {} for name in program.kernels}
    kept, functions = (wp.kernel, wp.func), OPENED.take_out("Warp functions")
    wp.kernel, wp.func = (lambda *_, **__: DeviceFunction), DeviceFunction
    try:
        for name, builder in program.kernels.items():
            for k, scene in enumerate(scenes.all):
                kernel = getattr(module, builder)
                if not isinstance(kernel, wp.Kernel):
                    switches = {name for name, values in program.options.items() if set(values) == {0, 1}}
                    options = {name: bool(value) if name in switches else value for name, value in scene.items()}
                    precision = "float64" if options.pop("real_is_double") else "float32"
                    kernel = kernel(Scene(precision, **options))
                found[name][kernel.func] = found[name].get(kernel.func, 0) | 1 << k
    finally:
        wp.kernel, wp.func = kept
        OPENED.take_out("Warp functions")
        if functions is not None:
            OPENED.once("Warp functions", lambda: functions)
    return found


def _macros() -> dict[str, Macro]:
    """Return the macros of the headers that are made from Python, which are numbers."""
    found: dict[str, Macro] = {}
    branch: int | None = None
    for line in (*constants(), *ray_status()):
        branch = {"#if REAL_IS_DOUBLE": 1, "#else": 0, "#endif": None}.get(line, branch)
        match = _DEFINITION.match(line)
        if match is None or match[3].endswith("u"):
            continue
        value = int(match[3], 0) if re.fullmatch(r"-?(0x)?\d+", match[3]) else float(match[3])
        one, two = found[match[1]].values if match[1] in found else (None, None)
        pair = (value if branch in (None, 0) else one), (value if branch in (None, 1) else two)
        found[match[1]] = Macro(pair, bool(match[2]))
    return found


def _files(program: Program, translator: Translator) -> dict[str, str]:
    found = {}
    for module, pairs in translator.texts.items():
        place = translator.places[module]
        source = f"{place.replace('.', '/')}.py"
        doc = importlib.import_module(place).__doc__ or ""
        lines = [f"// Generated by `{COMMAND}`: do not change it here, but", f"// {source}.", "//"]
        lines += comment(doc)
        is_program = module == program.module
        guard = [] if is_program else [f"#ifndef {module.upper()}_H", f"#define {module.upper()}_H", ""]
        uses = sorted(translator.uses.get(module, ()))
        included = ["prelude.h", *(program.headers if is_program else ()), *(f"{FOLDER}/{name}.h" for name in uses)]
        lines += [*guard, *([] if guard else [""]), *(f'#include "{name}"' for name in included)]
        macros = translator.defined.get(module, {})
        lines += ["", *(row for each in macros.items() for row in definition(*each))] if macros else []
        lines += [*_under_conditions(pairs, translator.scenes), *(["", "#endif"] if guard else [])]
        found[f"{module}.cl" if is_program else f"{FOLDER}/{module}.h"] = "\n".join(lines) + "\n"
    return found


def _under_conditions(pairs: list[tuple[int, str]], scenes: Scenes) -> list[str]:
    """Write functions with an #if around neighbours that only some scenes have."""
    lines: list[str] = []
    opened = seen = scenes.full
    for mask, text in pairs:
        if mask != opened and opened != scenes.full and not mask & seen:
            lines += ["", f"#elif {scenes.condition(mask, scenes.full & ~seen)}"]
            opened, seen = mask, seen | mask
        elif mask != opened:
            lines += ["", "#endif"] if opened != scenes.full else []
            lines += ["", f"#if {scenes.condition(mask, scenes.full)}"] if mask != scenes.full else []
            opened = seen = mask
        lines += ["", text]
    return [*lines, "", "#endif"] if opened != scenes.full else lines
