"""Build programs from the OpenCL C sources: find, expand, specialise by options, and build each once.

Programs are cached in memory with their session and on disk across processes: PoCL and NVIDIA's driver cache them by
source and options, for other drivers PyOpenCL does. Headers are inserted in the source before it is built, so that a
changed header changes the source and the cache on disk is never stale. A process reads each source once.

Options, structs, status codes and constants follow from Python, from the tables that Warp's kernels use directly: a
kernel includes their headers by name like those of kernels/include. `scripts/generate_kernels --headers` prints them.
"""

import functools
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from aerokernels.medium.bodies.crossings import LEAST_SIDE
from aerokernels.tracing.tasks.sums import MOMENT_COUNT, SUM_COUNT

from ....medium.bodies.crossings import PARALLEL
from ....medium.grid import AXIS_CORE
from ....pupils import square_map
from ... import scheme, tableau
from ...plan import OUTPUT_BITS
from ...step_bound import CONE_SINES, CONES
from ...stop import RayStatus
from ..layout import ARRAYS, OPTIONS, REAL_TYPES, STRUCTS, VALUES, Value, parts_of
from .devices import import_pyopencl
from .session import WORK_GROUP, Session

# Options of every kernel: no warnings, because PoCL would print their number past any Python stream, and nothing that
# relaxes the arithmetic, because compensated sums would be optimised away. Kernels are built for the work-group's size.
BASE_OPTIONS = ("-cl-std=CL1.2", "-w", f"-DWORK_GROUP={WORK_GROUP}")
_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]+"([^"\n]+)"[ \t]*(?://.*)?$')


def kernel_folder() -> Path:
    """Return the folder of the OpenCL C sources: in an installed package, or beside it in a checkout.

    Raises:
        RuntimeError: They are in neither place.
    """
    package = Path(__file__).resolve().parents[3]
    places = (package / "kernels", package.parent / "kernels")
    for place in places:
        if (place / "include").is_dir():
            return place
    raise RuntimeError(
        f"the OpenCL kernel sources are neither in {places[0]} (an installed package) nor in {places[1]} (a checkout): "
        "install aerokernels again"
    )


def expand(kernel_file: str, folder: Path | None = None) -> str:
    """Return a kernel's source with every `#include "..."` replaced by the header, each header once.

    Headers are searched in `include/` and in the folder itself, then among those made below; `#line` directives make
    the compiler's messages refer to file and line of the original. An include must not be inside a conditional #if.
    """
    folder = kernel_folder() if folder is None else folder
    seen, lines = {kernel_file}, []

    def add(name: str, source: list[str]) -> None:
        lines.append(f'#line 1 "{name}"')
        for number, line in enumerate(source, start=1):
            if "#" not in line or (match := _INCLUDE.match(line)) is None:
                lines.append(line)
                continue
            header = match[1]
            if header not in seen:
                seen.add(header)
                place = f"include/{header}" if (folder / "include" / header).is_file() else header
                if (folder / place).is_file():
                    add(place, (folder / place).read_text(encoding="utf-8").splitlines())
                elif header in HEADERS:
                    add(header, _made_header(header))
                else:
                    raise RuntimeError(f"{name}, line {number}: header {header!r} is not below {folder}")
            lines.append(f'#line {number + 1} "{name}"')

    add(kernel_file, (folder / kernel_file).read_text(encoding="utf-8").splitlines())
    return "\n".join(lines) + "\n"


@functools.cache
def _made_header(name: str) -> list[str]:
    return HEADERS[name]()


@functools.lru_cache(maxsize=256)
def build_options(*, precision: str = "float32", **chosen: str | int) -> tuple[str, ...]:
    """Return the compile options of one kind of scene; no other function makes them.

    Args:
        precision: "float32" or "float64".
        chosen: Names or numbers for OPTIONS in layout.py, by name; other options have their defaults.

    Raises:
        ValueError: An unknown option or value.
    """
    if precision not in REAL_TYPES:
        raise ValueError(f"precision {precision!r} is not known: choose 'float32' or 'float64'")
    chosen["real_is_double"] = precision == "float64"
    made = []
    for option, (choices, _) in OPTIONS.items():
        if not isinstance(choices, tuple):
            value: str | int = int(chosen.pop(option, choices))
        else:
            value = str(chosen.pop(option, choices[0]))
            if value not in choices:
                raise ValueError(f"{option} {value!r} is not known: choose one of {', '.join(choices)}")
            value = in_c(value)
        made.append(f"-D{option.upper()}={value}")
    if chosen:
        raise ValueError(f"option {next(iter(chosen))!r} is not known: choose one of {', '.join(OPTIONS)}")
    return tuple(made)


def is_processor(session: Session) -> bool:
    """Whether kernels are built for a CPU."""
    return bool(session.device.type & import_pyopencl().device_type.CPU)


def lane_count(session: Session, precision: str) -> int:
    """Return the rays per work-item of leapfrog: on a CPU as many as fill its vectors, on a GPU one."""
    if not is_processor(session):
        return 1
    return 16 if precision == "float32" else 8


def build(session: Session, kernel_file: str, options: Iterable[str] = (), folder: Path | None = None):
    """Return the built program of a source file, built once for a session and its options; thread-safe.

    Args:
        session: An open device.
        kernel_file: Name of the source in the folder.
        options: See `build_options`.
        folder: The folder of the sources; None for `kernel_folder()`.

    Returns:
        A pyopencl.Program. Make one kernel per thread with `pyopencl.Kernel(program, name)`: a kernel stores its
        arguments, so threads must not share it.

    Raises:
        RuntimeError: The source does not exist or does not build; with the compiler's messages and the options.
    """
    key = kernel_file, tuple(options), folder
    program = session.programs.get(key)
    if program is None:
        with session.lock:
            if key not in session.programs:
                added = ("-DON_PROCESSOR=1",) if is_processor(session) else ()
                flags = [*BASE_OPTIONS, *key[1], *session.options, *added]
                session.programs[key] = _build(session, kernel_file, expand(kernel_file, folder), flags)
            program = session.programs[key]
    return program


def _build(session: Session, kernel_file: str, source: str, options: list[str]):
    cl = import_pyopencl()
    with warnings.catch_warnings():
        # A compiler's remarks about a program that builds do not concern users.
        warnings.simplefilter("ignore", cl.CompilerWarning)
        try:
            return cl.Program(session.context, source).build(options)
        except (cl.Error, cl.RuntimeError) as error:
            raise RuntimeError(
                f"OpenCL kernel {kernel_file} does not build for device {session.name!r}:\n"
                f"{str(error).strip()}\n"
                f"options: {' '.join(options)}"
            ) from error


# Structs that are passed to kernels: their arrays are separate arguments, which OpenCL gathers in struct Arrays.
GIVEN = ("Field", "Bounds", "Control")
# Numbers of scheme.py that are double in either precision: they are used for the ends of rays and for the body.
DOUBLES = (
    "LEAST_COSINE",
    "STEEPEST_COSINE",
    "GRAZING_TOLERANCE",
    "LEAST_SLOPE",
    "ENTRY_ROUNDING",
    "GRAZING_SQUARE",
    "INCIDENCE_NOISE",
)


def in_c(name: str) -> str:
    """Return the macro of an option or of its value: BILINEAR_BARRON for "bilinear-barron"."""
    return name.upper().replace("-", "_")


def options() -> list[str]:
    """Return the header with every option of layout.py, its values, and its default; the host sets options by -D."""
    lines: list[str] = []
    for name, (choices, meaning) in OPTIONS.items():
        lines += _group(f"{in_c(name)}: {meaning}")
        if isinstance(choices, tuple):
            lines += [f"#define {in_c(choice)} {number}" for number, choice in enumerate(choices, start=1)]
        default = in_c(choices[0]) if isinstance(choices, tuple) else choices
        lines += [f"#ifndef {in_c(name)}", f"#define {in_c(name)} {default}", "#endif"]
    return lines


def types() -> list[str]:
    """Return the header with all structs, and macros for arguments: the arrays of structs, and those of a tracer."""
    lines = ['#include "real.h"']
    for name in STRUCTS:
        if VALUES[name]:
            lines += _struct(name, [_member(member, name in GIVEN) for member in VALUES[name]])
    given = [member for name in GIVEN for member in ARRAYS[name]]
    desk = ["#if DESKS", "    __local float4 *desk;  // of a warp, see cubes.h", "#endif"]
    lines += _struct("Arrays", [*(_member(member, True) for member in given), *desk])
    lines += _struct("RayOutputs", [_member(member, False) for member in STRUCTS["RayOutputs"]])
    structs = {
        "ARRAY": given,
        "RAY_OUTPUT": [member._replace(name=f"{member.name}_out") for member in STRUCTS["RayOutputs"]],
    }
    for name, members in structs.items():
        lines += ["", f"#define {name}_ARGUMENTS {', '.join(map(_argument, members))}"]
        lines += [f"#define {name}S {{{', '.join(member.name for member in members)}}}"]
    traced = [f"const {name} {name.lower()}" for name in GIVEN] + ["ARRAY_ARGUMENTS"]
    traced += ["const int first_ray", "const int ray_count"]
    traced += ["__global const double *position_in", "__global const double *direction_in", "RAY_OUTPUT_ARGUMENTS"]
    return [*lines, "", f"#define TRACED_ARGUMENTS {', '.join(traced)}"]


def ray_status() -> list[str]:
    """Return the header with every status code and its meaning."""
    return [f"#define RAY_{status.name} {status.value}  // {status.meaning}" for status in RayStatus]


def constants() -> list[str]:
    """Return the header with the numbers of the scheme: R(...) has the kernel's precision, others are double or int.

    The tableau's numbers carry the prefix RKN_, since names such as B1 are too short to be macros.
    """
    ours = {name: value for name, value in vars(scheme).items() if name.isupper()}
    plain = {name: value for name, value in ours.items() if isinstance(value, int) or name in DOUBLES}
    by_precision = {name: value for name, value in ours.items() if isinstance(value, Mapping)}
    real = {name: value for name, value in ours.items() if isinstance(value, float) and name not in plain}
    rows = {"B": tableau.B[:3], "V": tableau.BT, "R": tableau.END_RATE, "E": tableau.B_ERROR, "F": tableau.BT_ERROR}
    rows |= {"G": tableau.PATH_ERROR_VALUE, "K": tableau.PATH_ERROR_SLOPE}
    rows |= {"P": tableau.STAGE_MOMENTUM[1], "Q": tableau.STAGE_MOMENTUM[2]}
    return [
        '#include "real.h"',
        *_group("tableau.py, the Runge-Kutta-Nystrom pair: nodes, and the matrix of its stages"),
        *_reals({"RKN_C2": tableau.C[1], "RKN_C3": tableau.C[2]}),
        *_reals({"RKN_A21": tableau.A[1, 0], "RKN_A31": tableau.A[2, 0], "RKN_A32": tableau.A[2, 1]}),
        *_group("Weights of stages: position, momentum and sums, the force's rate, errors, momenta at stages"),
        *(line for letter, values in rows.items() for line in _row(letter, values)),
        *_group("Angle with the first direction up to which a ray counts as nearly straight [rad]"),
        *_reals({"NEARLY_STRAIGHT": tableau.NEARLY_STRAIGHT}),
        *_group("scheme.py, where every number is explained"),
        *_reals(real),
        *_defines(plain),
        *_defines({f"HASH_{k}": f"0x{value:08X}u" for k, value in enumerate(scheme.HASHES, start=1)}),
        "#if REAL_IS_DOUBLE",
        *_reals({name: value["float64"] for name, value in by_precision.items()}),
        "#else",
        *_reals({name: value["float32"] for name, value in by_precision.items()}),
        "#endif",
        *_group("medium: radius about the axis within which a kink is rounded off, in cells; lines and triangles"),
        *_reals({"AXIS_CORE": AXIS_CORE}),
        *_defines({"PARALLEL": PARALLEL, "LEAST_SIDE": LEAST_SIDE}),
        *_group("step_bound.py, cones of directions about an axis: sines squared (double) that sort rays into them"),
        *_defines({"NARROW_SQUARE": repr(float(CONE_SINES[0]) ** 2), "WIDE_SQUARE": repr(float(CONE_SINES[1]) ** 2)}),
        *_group("Cosines of the angles beyond which rays have turned out of their cones"),
        *_reals({"NARROW_COSINE": np.cos(CONES[1].spread), "WIDE_COSINE": np.cos(CONES[2].spread)}),
        *_group("Numbers of sums over a pupil; shapes of pupils, and the length of the header of a table of pixels"),
        *_defines({"MOMENT_COUNT": MOMENT_COUNT, "SUM_COUNT": SUM_COUNT}),
        *_defines({f"PUPIL_{name}": getattr(square_map, name) for name in ("RING", "PIXELS", "TRIANGLES")}),
        *_defines({"PUPIL_PIXEL_HEADER": square_map.PIXEL_HEADER}),
        *_group("Bits of the requested outputs of a ray"),
        *_defines({f"OUTPUT_{name.upper()}": bit for name, bit in OUTPUT_BITS.items()}),
    ]


HEADERS: dict[str, Callable[[], list[str]]] = {
    "options.h": options,
    "types.h": types,
    "ray_status.h": ray_status,
    "constants.h": constants,
}


def _argument(value: Value) -> str:
    """Declare an array; they are of plain numbers, because OpenCL pads vectors of three."""
    constant = "" if value.name.endswith("_out") else "const "
    return f"__global {constant}{parts_of(value.kind)[0]} *{value.name}"


def _member(member: Value, packed: bool) -> str:
    """Declare a member, with its meaning; in structs that the host fills, vectors are plain arrays as in NumPy."""
    kind, width, indices = parts_of(member.kind)
    kind = kind.replace("bool", "int")
    if indices:
        text = f"__global {'const ' if packed else ''}{kind} *{member.name};"
    elif width > 1 and packed:
        text = f"{kind} {member.name}[{width}];"
    else:
        text = f"{kind}{width if width > 1 else ''} {member.name};"
    return f"    {text}  // {member.meaning}" if member.meaning else f"    {text}"


def _struct(name: str, members: Sequence[str]) -> list[str]:
    return ["", "typedef struct {", *members, f"}} {name};"]


def _row(letter: str, values: Sequence[float] | np.ndarray) -> list[str]:
    return _reals({f"RKN_{letter}{k}": value for k, value in enumerate(values, start=1)})


def _group(what: str) -> list[str]:
    return ["", f"// {what}."]


def _reals(values: Mapping[str, float]) -> list[str]:
    """Define numbers in the kernel's precision, with all digits of a float64."""
    return _defines({name: f"R({float(value)!r})" for name, value in values.items()})


def _defines(values: Mapping[str, object]) -> list[str]:
    return [f"#define {name} {value}" for name, value in values.items()]
