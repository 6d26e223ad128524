"""The headers of the OpenCL kernels that repeat what Python says: layout, status codes and the scheme's constants.

scripts/kernel_headers            writes those headers in kernels/include, see TEXTS
scripts/kernel_headers --check    writes nothing; exit status 1 where one of them is not what it would write
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import kernel_layout
import numpy as np

from aerokernels.medium.crossings import PARALLEL
from aerokernels.medium.grid import AXIS_CORE
from aerokernels.medium.triangle_crossings import LEAST_SIDE
from aerokernels.pupils import square_map
from aerokernels.tracing import scheme, tableau
from aerokernels.tracing.pupil_sums import MOMENT_COUNT, SUM_COUNT
from aerokernels.tracing.result import OUTPUT_BITS
from aerokernels.tracing.status import RayStatus
from aerokernels.tracing.step_bound import CONE_SINES, CONES

INCLUDE = Path(__file__).resolve().parents[1] / "kernels" / "include"
LAYOUT = "aerokernels/tracing/engines/layout.py"
NOTE = "Written by scripts/kernel_headers from {source}: change it there."


def ray_status() -> str:
    """The text of ray_status.h: every status code with what it means."""
    width = max(len(status.name) for status in RayStatus)
    lines = [f"#define RAY_{status.name:<{width}} {status.value} // {status.meaning}" for status in RayStatus]
    return _header("RAY_STATUS_H", "Status codes of rays.", "aerokernels/tracing/status.py", lines)


def constants() -> str:
    """The text of constants.h: R(...) makes a literal of the kernel's precision, see real.h; the rest is double or int.

    The tableau's numbers carry the prefix RKN_, since names such as B1 are too short to be macros.
    """
    lines = [
        *_group("Runge-Kutta-Nystrom pair: nodes, and the matrix of its stages"),
        *_reals({"RKN_C2": tableau.C[1], "RKN_C3": tableau.C[2]}),
        *_reals({"RKN_A21": tableau.A[1, 0], "RKN_A31": tableau.A[2, 0], "RKN_A32": tableau.A[2, 1]}),
        *_row("Weights of the forces in the position's step", "B", tableau.B[:3]),
        *_row("Weights of the stages in the momentum's step, and in every sum over the step", "V", tableau.BT),
        *_row("Error of the position, from the embedded formula", "E", tableau.B_ERROR),
        *_row("Error of the momentum and of the sums, from the embedded formula", "F", tableau.BT_ERROR),
        *_row("Error of the optical path, from the rule of degree 7: values", "G", tableau.PATH_ERROR_VALUE),
        *_row("The same: slopes along the ray", "K", tableau.PATH_ERROR_SLOPE),
        *_row("Momentum at the second stage", "P", tableau.STAGE_MOMENTUM[1]),
        *_row("Momentum at the third stage", "Q", tableau.STAGE_MOMENTUM[2]),
        *_group("Length of a step"),
        *_reals({name: getattr(scheme, name) for name in ("LEAST_STEP", "FACE_TOLERANCE", "GREATEST_STAND_OFF")}),
        *_group("Error of a step"),
        *_reals({name: getattr(scheme, name) for name in ("STEP_SHARE", "NOISE_STEP")}),
        *_reals(
            {
                name: getattr(scheme, name)
                for name in (
                    "SLOPE_NOISE",
                    "DIRECTION_SHARE",
                    "OBLIQUITY_KEPT",
                    "LEAST_RATIO_SMOOTH",
                    "LEAST_RATIO",
                    "RATIO_GROWTH",
                    "MAGNIFIED",
                )
            }
        ),
        *_group(
            "Cosine of the least angle with a surface that is believed, and cells to go on at smaller ones (double)"
        ),
        *_defines(
            {
                name: getattr(scheme, name)
                for name in ("LEAST_COSINE", "STEEPEST_COSINE", "GRAZING_TOLERANCE", "LEAST_SLOPE", "ENTRY_ROUNDING")
            }
        ),
        *_group("Event location: the share of a step that may be left to a surface"),
        *_reals({name: getattr(scheme, name) for name in ("EVENT_LOCATION_SHARE", "TOLERANCE_COUNTED")}),
        *_group("Leapfrog samples: greatest angle with the first direction [rad], least share of what is left out"),
        *_reals(
            {name: getattr(scheme, name) for name in ("LEAPFROG_ANGLE", "LOOKUP_STRIDE", "MISSED_SLOPE", "LEFT_SHARE")}
        ),
        *_group("Angle with the first direction up to which a ray counts as nearly straight [rad]"),
        *_reals({"NEARLY_STRAIGHT": tableau.NEARLY_STRAIGHT}),
        *_group("Radius about the axis of symmetry within which a kink is rounded off, in cells"),
        *_reals({"AXIS_CORE": AXIS_CORE}),
        *_group("Cones of directions about an axis: sines squared (double) that sort rays into them"),
        *_defines({"NARROW_SQUARE": repr(float(CONE_SINES[0]) ** 2), "WIDE_SQUARE": repr(float(CONE_SINES[1]) ** 2)}),
        *_group("Cosines of the angles at which rays have turned out of their cones"),
        *_reals({"NARROW_COSINE": np.cos(CONES[1].spread), "WIDE_COSINE": np.cos(CONES[2].spread)}),
        *_group("Where a ray ends"),
        *_defines({name: getattr(scheme, name) for name in ("ARC_SURFACE", "BEYOND_SUPPORT", "WALK_LIMIT")}),
        *_group("The body: chords, closeness and room in cells; A of lines parallel to the axis, triangles (double)"),
        *_reals({name: getattr(scheme, name) for name in ("WALL_SAG", "WALL_CLOSE", "WALL_ASIDE", "WALL_BACK")}),
        *_defines({"PARALLEL": PARALLEL, "LEAST_SIDE": LEAST_SIDE, "GRAZING_SQUARE": scheme.GRAZING_SQUARE}),
        *_group("Pupil: rays summed by one work-item and the sums it delivers, and the hash of the scramble"),
        *_defines({"GROUP": scheme.GROUP, "REDUCTION_WIDTH": scheme.REDUCTION_WIDTH}),
        *_defines({"MOMENT_COUNT": MOMENT_COUNT, "SUM_COUNT": SUM_COUNT}),
        *_defines({f"HASH_{k}": f"0x{value:08X}u" for k, value in enumerate(scheme.HASHES, start=1)}),
        *_group("Shapes of pupils, and numbers of a table of pixels before its shares"),
        *_defines({f"PUPIL_{name}": getattr(square_map, name) for name in ("RING", "PIXELS", "TRIANGLES")}),
        *_defines({"PUPIL_PIXEL_HEADER": square_map.PIXEL_HEADER}),
        *_group("Outputs of a ray that are wanted, a bit each"),
        *_defines({f"WANT_{name.upper()}": bit for name, bit in OUTPUT_BITS.items()}),
        *_group("By precision"),
        "#if REAL_IS_DOUBLE",
        *_by_precision("float64"),
        "#else",
        *_by_precision("float32"),
        "#endif",
    ]
    source = (
        "scheme.py, tableau.py, step_bound.py, result.py and pupil_sums.py in aerokernels/tracing,\n"
        "// crossings.py and grid.py in medium, and square_map.py in pupils"
    )
    return _header("CONSTANTS_H", "Constants of the scheme.", source, ['#include "real.h"', *lines])


def options() -> str:
    """The text of options.h."""
    what = "What a kernel is built for: the host sets these as -D options, see opencl/program.py."
    return _header("OPTIONS_H", what, LAYOUT, kernel_layout.options())


def types() -> str:
    """The text of types.h."""
    return _header("TYPES_H", "Structs: what the host fills, and what kernels make.", LAYOUT, kernel_layout.types())


def arguments() -> str:
    """The text of arguments.h."""
    return _header("ARGUMENTS_H", "Arguments of the kernels, as macros.", LAYOUT, kernel_layout.arguments())


TEXTS: dict[str, Callable[[], str]] = {
    "ray_status.h": ray_status,
    "constants.h": constants,
    "options.h": options,
    "types.h": types,
    "arguments.h": arguments,
}


def stale(folder: Path) -> list[str]:
    """Names of the headers in a folder that are absent or not what Python says."""
    return [name for name, text in TEXTS.items() if not _holds(folder / name, text())]


def _holds(path: Path, text: str) -> bool:
    return path.is_file() and path.read_text(encoding="utf-8") == text


def _by_precision(precision: str) -> list[str]:
    names = ("NOISE", "DIRECTION_NOISE", "TINY", "EVENT_LOCATION_NOISE", "AT_FACE", "RADIUS_NOISE", "SURFACE_TOLERANCE")
    names += ("LEAST_RISE",)
    return _reals({name: getattr(scheme, name)[precision] for name in names})


def _row(what: str, letter: str, values: Sequence[float] | np.ndarray, first: int = 1) -> list[str]:
    return [*_group(what), *_reals({f"RKN_{letter}{k}": v for k, v in enumerate(values, start=first)})]


def _group(what: str) -> list[str]:
    return ["", f"// {what}."]


def _reals(values: Mapping[str, float]) -> list[str]:
    """Definitions with all digits that a float64 needs, in the kernel's precision."""
    return _defines({name: f"R({float(value)!r})" for name, value in values.items()})


def _defines(values: Mapping[str, object]) -> list[str]:
    return [f"#define {name} {value}" for name, value in values.items()]


def _header(guard: str, what: str, source: str, lines: Sequence[str]) -> str:
    head = [f"// {what}", f"// {NOTE.format(source=source)}", f"#ifndef {guard}", f"#define {guard}", ""]
    return "\n".join([*head, *lines, "", "#endif", ""])


def main() -> int:
    """Write the headers, or check them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing, exit with 1 where a header is stale")
    parser.add_argument("--folder", type=Path, default=INCLUDE, help="where the headers lie (default: %(default)s)")
    arguments = parser.parse_args()
    names = stale(arguments.folder)
    if arguments.check:
        for name in names:
            print(f"{arguments.folder / name} is stale or absent: run scripts/kernel_headers", file=sys.stderr)
        return 1 if names else 0
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (arguments.folder / name).write_text(TEXTS[name](), encoding="utf-8")
        print(f"wrote {arguments.folder / name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
