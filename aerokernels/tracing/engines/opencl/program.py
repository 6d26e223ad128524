"""Build programs from the OpenCL C sources: find, expand, specialise by options, and build each once.

Programs are cached in memory with their session and on disk across processes: PoCL and NVIDIA's driver cache them by
source and options, for other drivers PyOpenCL does. Headers are inserted in the source before it is built, so that a
changed header changes the source and the cache on disk is never stale. A process reads each source once.
"""

import functools
import re
import warnings
from collections.abc import Iterable
from pathlib import Path

from ..layout import OPTIONS, REAL_TYPES
from .devices import import_pyopencl
from .headers import HEADERS, in_c
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

    Headers are searched in `include/` and in the folder itself, then among those of headers.py; `#line` directives make
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
