"""From the OpenCL C sources to built programs: found, expanded, specialised by options, built once.

Programs are kept in memory with their session and on disk across processes: PoCL and NVIDIA's driver keep what they
built by source and options, for other drivers PyOpenCL does. Headers are written into the source before it is built, so
a changed header changes the source and is never missed.
"""

import re
import time
import warnings
from collections.abc import Iterable
from pathlib import Path

from ..layout import OPTIONS, REAL_TYPES
from .devices import import_pyopencl
from .headers import HEADERS, in_c
from .session import Session

# Work-items of a work-group. Global sizes are rounded up to whole groups, and kernels test `ray < ray_count`.
WORK_GROUP = 64

# What every kernel is built with: no warnings, whose number PoCL would print past any Python stream, and nothing that
# relaxes the arithmetic, since compensated sums would be optimised away. Kernels are built for the work-group's size.
BASE_OPTIONS = ("-cl-std=CL1.2", "-w", f"-DWORK_GROUP={WORK_GROUP}")
# Seconds after which the package's own sources are looked at again.
LOOKED = 1.0
# The names that an option may have; in C they and the options are upper-case with underscores.
OPTION_VALUES = {name: option.choices for name, option in OPTIONS.items() if isinstance(option.choices, tuple)}
_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]+"([^"\n]+)"[ \t]*(?://.*)?$')


def kernel_folder() -> Path:
    """The folder of the OpenCL C sources: in an installed package, or beside it in a checkout.

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
    """A kernel's source with every `#include "..."` written in place, each header once.

    Headers are looked for in `include/` and in the folder itself, then among those of headers.py; `#line` directives
    keep the compiler's messages on file and line of the original. An include stands for itself: not inside an #if that
    does not always hold.

    Raises:
        RuntimeError: A source or header that is not there, by name and by the line that asked for it.
    """
    folder = kernel_folder() if folder is None else folder
    lines: list[str] = []
    _expand(folder, kernel_file, _read(folder / kernel_file, f"kernel source {kernel_file}"), {kernel_file}, lines)
    return "\n".join(lines) + "\n"


def _expand(folder: Path, name: str, source: list[str], seen: set[str], lines: list[str]) -> None:
    lines.append(f'#line 1 "{name}"')
    for number, line in enumerate(source, start=1):
        match = _INCLUDE.match(line)
        if match is None:
            lines.append(line)
            continue
        asked = f"{name}, line {number}: header {match[1]!r}"
        header, text = _header(folder, match[1], asked)
        if header not in seen:
            seen.add(header)
            _expand(folder, header, text, seen, lines)
        lines.append(f'#line {number + 1} "{name}"')


def _header(folder: Path, name: str, asked: str) -> tuple[str, list[str]]:
    """The place of a header below the folder, and its lines; one that is made from Python is in no place."""
    places = (f"include/{name}", name)
    for place in places:
        if (folder / place).is_file():
            return place, _read(folder / place, asked)
    if name in HEADERS:
        return name, HEADERS[name]()
    raise RuntimeError(f"{asked} is neither {folder / places[0]} nor {folder / places[1]}")


def _read(path: Path, asked: str) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise RuntimeError(f"{asked} cannot be read at {path} ({error.strerror}): install aerokernels again") from error


def build_options(*, precision: str = "float32", **chosen: str | int) -> tuple[str, ...]:
    """The compile options of one kind of scene: the only place where they are made.

    Args:
        precision: "float32" or "float64".
        chosen: Names or numbers for OPTIONS in layout.py, by name; the others have their defaults.

    Raises:
        ValueError: A name that is not known.
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
        made.append(f"-D{in_c(option)}={value}")
    if chosen:
        raise ValueError(f"option {next(iter(chosen))!r} is not known: choose one of {', '.join(OPTIONS)}")
    return tuple(made)


def is_processor(session: Session) -> bool:
    """Whether kernels are built for a CPU."""
    return bool(session.device.type & import_pyopencl().device_type.CPU)


def lane_count(session: Session, precision: str) -> int:
    """Rays to a work-item of leapfrog: what fills a CPU's vectors; on a GPU each lane is a work-item of its own."""
    if not is_processor(session):
        return 1
    return 16 if precision == "float32" else 8


def build(session: Session, kernel_file: str, options: Iterable[str] = (), folder: Path | None = None):
    """The built program of a source file; thread-safe, and built once for a session, a source and its options.

    Args:
        session: An open device.
        kernel_file: Name of the source in the folder.
        options: See `build_options`.
        folder: Where sources are; None takes `kernel_folder()`.

    Returns:
        A pyopencl.Program. Make a kernel of your own by `pyopencl.Kernel(program, name)`: a kernel holds its
        arguments, so it is not to be shared between threads.

    Raises:
        RuntimeError: The source is not there or does not build; with the compiler's messages and the options.
    """
    options = (*BASE_OPTIONS, *options, *session.options)
    if is_processor(session):
        options = (*options, "-DON_PROCESSOR=1")
    with session.lock:
        place, stamp = _own_sources(session) if folder is None else (folder, _stamp(folder))
        written = kernel_file, place, stamp
        if written not in session.sources:
            session.sources[written] = expand(kernel_file, place)
        source = session.sources[written]
        key = (source, options)
        if key not in session.programs:
            session.programs[key] = _build(session, kernel_file, source, list(options))
        return session.programs[key]


def _own_sources(session: Session) -> tuple[Path, tuple]:
    """The package's own folder and its stamp, LOOKED seconds old at most: to look takes as long as some rays do."""
    now = time.monotonic()
    if not session.looked or now - session.looked["when"] > LOOKED:
        folder = kernel_folder()
        session.looked.update(when=now, sources=(folder, _stamp(folder)))
    found: tuple[Path, tuple] = session.looked["sources"]
    return found


def _stamp(folder: Path) -> tuple:
    """What changes when a source changes, so that a running process notices too."""
    files = [*folder.glob("*.cl"), *folder.glob("include/*.h")]
    return tuple(sorted((path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in files))


def _build(session: Session, kernel_file: str, source: str, options: list[str]):
    cl = import_pyopencl()
    with warnings.catch_warnings():
        # What a compiler says of a program that it does build is no news to users.
        warnings.simplefilter("ignore", cl.CompilerWarning)
        try:
            try:
                return cl.Program(session.context, source).build(options)
            except (cl.Error, cl.RuntimeError):
                raise
            except Exception:  # what PyOpenCL keeps on disk cannot be written, or is damaged: build without it
                return cl.Program(session.context, source).build(options, cache_dir=False)
        except (cl.Error, cl.RuntimeError) as error:
            raise RuntimeError(
                f"OpenCL kernel {kernel_file} does not build for device {session.name!r}:\n{str(error).strip()}\n"
                f"options: {' '.join(options)}"
            ) from error
