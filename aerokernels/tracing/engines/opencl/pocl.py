"""Remedies for pip's PoCL 3.0: the name of a CPU that its LLVM 14 does not know, and a linker that it does not find.

For a CPU that LLVM 14 does not know (AMD's from family 26 on) PoCL builds nothing; for one whose name its library was
not compiled for ("icelake-client") it inlines no built-in function. It has no option for another name. So before
anything is built, the name to which its record of the device points is replaced by that of a CPU whose instructions
this one has. AEROKERNELS_POCL_CPU sets another name ("znver3"), or "off" to leave PoCL unchanged.

PoCL keeps for every program a folder with LLVM bitcode (`program.bc`) and a library for each kernel (`*.so`). After a
full disk or a power failure these may be cut or partly zero, which ends the process in a signal that no `except` can
catch: they are checked before PoCL reads them.
"""

import ctypes
import glob
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from contextlib import suppress
from pathlib import Path

from aerokernels.process.quiet_warp import is_whole, spare_cache, why_unusable

VARIABLE = "AEROKERNELS_POCL_CPU"
RECORD_WORDS = 256  # words of a device's record that are searched; the name is near word 80

# CPUs for which PoCL's library of built-in functions is compiled, and the instructions that a compiler uses on them by
# default, by the names in /proc/cpuinfo. The kernel must be compiled for one of these names: functions compiled for a
# CPU with more instructions than the kernel's are not inlined, so every sqrt() and dot() would be a call (1.6 times
# slower).
PROCESSORS = (
    ("skylake-avx512", "avx512f avx512bw avx512cd avx512dq avx512vl"),
    ("haswell", "avx avx2 bmi1 bmi2 f16c fma abm movbe"),
    ("x86-64-v2", "cx16 lahf_lm popcnt ssse3 sse4_1 sse4_2"),
)

OF_LIBRARY = tuple(name for name, _ in PROCESSORS)
# PoCL's name for a CPU that LLVM does not know.
UNKNOWN = "generic"


def name_processor(device) -> tuple[str, ...]:
    """Replace the CPU's name in PoCL; return compile options that keep PoCL's cache entries for that name apart.

    It may be called again: the name is then no longer "generic", and the options stay the same.
    """
    given = _given_name(device)
    name = os.environ.get(VARIABLE) or processor_name()
    if not given or name == "off" or not re.fullmatch(r"[\w.-]{1,40}", name):
        return ()
    if given != UNKNOWN and name not in OF_LIBRARY:
        return ()
    old = given.encode() + b"\0"
    readable = _readable_ranges()
    start = device.int_ptr
    for address in range(start, start + 8 * RECORD_WORDS, 8):
        if not _within(address, 8, readable):
            return ()
        word = ctypes.c_uint64.from_address(address)
        if _within(word.value, len(old), readable) and ctypes.string_at(word.value, len(old)) == old:
            libc = ctypes.CDLL(None)
            libc.strdup.restype = ctypes.c_void_p
            word.value = libc.strdup(name.encode())  # PoCL keeps the pointer until the process ends
            break
    # PoCL's cache is keyed by source, options and the original name: the option adds the new name to the key.
    return ("-DPROCESSOR_" + re.sub(r"\W", "_", name),)


def workaround(device, options: tuple[str, ...]) -> str:
    """Describe what `name_processor`, which returned `options`, did to a device; empty if nothing was needed."""
    given = _given_name(device)
    chosen = os.environ.get(VARIABLE)
    if not given or (given != UNKNOWN and not options):
        return ""
    if not options:
        why = f"{VARIABLE} is {chosen!r}; unset it" if chosen else "its record of the device is not as expected"
        return f"PoCL 3.0 does not know this CPU, and is left unchanged: {why}"
    trouble = "does not know this CPU" if given == UNKNOWN else f"does not inline its functions on a {given!r}"
    return (
        f"PoCL 3.0 {trouble}: the CPU's name is set to {chosen or processor_name()!r} before anything is compiled; "
        f"{VARIABLE}=off leaves PoCL unchanged, {VARIABLE}=NAME sets another name"
    )


def processor_name() -> str:
    """Return the best of PROCESSORS whose instructions this CPU has, by LLVM's name."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as text:
            flags = next((set(line.split(":", 1)[1].split()) for line in text if line.startswith("flags")), set())
    except OSError:
        flags = set()
    for index, (name, _) in enumerate(PROCESSORS):
        if all(set(needed.split()) <= flags for _, needed in PROCESSORS[index:]):
            return name
    return "x86-64"


def _given_name(device) -> str:
    """Return PoCL 3.0's name of the CPU if it should be replaced, else an empty string."""
    if not (sys.platform == "linux" and platform.machine() == "x86_64" and "PoCL 3.0" in device.platform.version):
        return ""
    name: str = device.version.rpartition("x86_64-unknown-linux-gnu-")[2].strip()
    return "" if name == device.version.strip() or name in OF_LIBRARY else name


def is_unknown(device) -> bool:
    """Whether PoCL 3.0 does not know the CPU: it then builds nothing unless the name is replaced."""
    return _given_name(device) == UNKNOWN


def _readable_ranges() -> list[tuple[int, int]]:
    ranges = []
    with open("/proc/self/maps", encoding="utf-8", errors="replace") as text:
        for line in text:
            span, rights = line.split()[:2]
            if rights.startswith("rw"):
                low, high = span.split("-")
                ranges.append((int(low, 16), int(high, 16)))
    return ranges


def _within(address: int, size: int, ranges: list[tuple[int, int]]) -> bool:
    for low, high in ranges:
        if low <= address and address + size <= high:
            return True
    return False


def linker_trouble(device) -> str:
    """Say why kernels of pip's PoCL cannot be linked on this machine, with the remedy; empty if they can.

    Its compiler calls `ld` from PATH, with libraries that come with a C compiler.
    """
    if "PoCL 3.0" not in device.platform.version or sys.platform != "linux":
        return ""
    linker = shutil.which("ld", path=os.environ.get("PATH", ""))  # without PATH, Python would search /usr/bin
    if linker is not None and _links(linker):
        return ""
    missing = "`ld` does not find the libraries of GCC and C" if linker else "there is no `ld` on PATH"
    return (
        f"PoCL cannot link its kernels: {missing}, and its first kernel would end the process; install a C compiler, "
        "which contains them (on Debian and Ubuntu: apt install gcc libc6-dev), with its folder on PATH, or choose "
        "backend 'warp'"
    )


def _links(linker: str) -> bool:
    """Whether `ld` links what PoCL's compiler passes to it: GCC's libraries and the C library."""
    # Where distributions put GCC's libraries; the linker finds the C library by itself.
    places = [f"-L{place}" for place in glob.glob("/usr/lib/gcc/*/*/")]
    place = cache_folder()  # takes kernels; there may be no folder for temporary files
    with tempfile.TemporaryDirectory(
        prefix="aerokernels-linker-", dir=place if place.is_dir() else None, ignore_cleanup_errors=True
    ) as folder:
        call = [linker, "-shared", "-o", os.path.join(folder, "library.so"), *places, "-lgcc", "-lgcc_s", "-lc"]
        try:
            return subprocess.run(call, stdin=subprocess.DEVNULL, capture_output=True, timeout=20.0).returncode == 0
        except (OSError, subprocess.TimeoutExpired):
            return False


FOLDER_VARIABLE = "POCL_CACHE_DIR"
CHECKED = "aerokernels-checked"  # an empty file, whose time is that of the last check
SETTLED = 5.0  # [s] without a change after which an incomplete file is no longer being written


def cache_folder() -> Path:
    """Return the folder that PoCL will use, by PoCL's rules; `make_safe` names it to PoCL if a variable is empty."""
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named)
    if caches := os.environ.get("XDG_CACHE_HOME"):
        return Path(caches) / "pocl" / "kcache"
    if home := os.environ.get("HOME"):
        return Path(home) / ".cache" / "pocl" / "kcache"
    return Path("/tmp/pocl/kcache")


def make_safe() -> None:
    """Remove damaged programs from the cache, once per process and before its driver is opened.

    If that is impossible, if the folder cannot be written or if the disk is full, this process gets its own cache in
    the folder for temporary files. All cases are reported as a RuntimeWarning.

    Raises:
        NoCacheError: No folder for temporary files can take kernels either.
    """
    folder = cache_folder()
    why = why_unusable(folder)
    damaged = [] if why else remove_damaged(folder)
    if left := [path for path in damaged if path.exists()]:
        why = f"{left[0]} is damaged and cannot be removed"
    if why:
        os.environ[FOLDER_VARIABLE] = spare_cache("pocl", why)
        return
    if "" in map(
        os.environ.get, (FOLDER_VARIABLE, "XDG_CACHE_HOME", "HOME")
    ):  # PoCL takes an empty one for a folder's name
        os.environ[FOLDER_VARIABLE] = str(folder)
    if damaged:
        count = f"{len(damaged)} programs" if len(damaged) > 1 else "a program"
        warnings.warn(
            f"PoCL's kernel cache in {folder} had {count} with damaged files: they are removed and built again",
            RuntimeWarning,
            stacklevel=2,
        )


def remove_damaged(folder: Path) -> list[Path]:
    """Remove the folders of programs with an incomplete file written since the last check; return them."""
    begun, checked = time.time(), folder / CHECKED
    last = checked.stat().st_mtime - SETTLED if checked.exists() else 0.0
    damaged: dict[Path, None] = {}
    for path in [*folder.glob("??/**/*.bc"), *folder.glob("??/**/*.so")]:
        with suppress(FileNotFoundError):  # another process removed it
            if path.stat().st_mtime >= last and not _is_whole(path):
                damaged[folder.joinpath(*path.relative_to(folder).parts[:2])] = None
    for program in damaged:
        shutil.rmtree(program, ignore_errors=True)
    with suppress(OSError):
        checked.touch()
        os.utime(checked, (begun, begun))
    return list(damaged)


def _is_whole(path: Path) -> bool:
    """Whether a file is complete; another process may be writing it now."""
    while True:
        state = path.stat()
        with open(path, "rb") as file:
            if is_whole(file, state.st_size):
                return True
        if not 0.0 <= time.time() - state.st_mtime < SETTLED:
            return False
        time.sleep(0.05)
