"""Remedies for PoCL: the name of a CPU that its compiler does not know, and a linker that it does not find.

pip's PoCL is version 3.0 with LLVM 14. If LLVM 14 does not know the CPU (AMD's from family 26 on), PoCL calls it
"generic", a name that its own compiler rejects, so that nothing builds; that version has no option or variable for
another name (later versions have POCL_LLVM_CPU_NAME). The name is a string to which PoCL's record of the device points.
Before anything is built, it is replaced there by the name of a CPU whose instructions this CPU has. The record is
changed only in that version, on 64-bit Linux on x86, and only if a word in it points to exactly that string.

If LLVM 14 knows the CPU by a name for which the library was not compiled ("icelake-client"), everything builds, but no
built-in function is inlined: every load of four numbers is a call. The name is replaced in this case too.

AEROKERNELS_POCL_CPU sets another name that LLVM 14 knows ("znver3"), or "off" to leave PoCL unchanged.

If PoCL cannot link or write the kernels that it compiles, it ends the process: `linker_trouble` asks beforehand.
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
from typing import Any

from aerokernels.process.quiet_warp import LEAST_SPACE

from ....process.machine import python_child
from .pocl_cache import cache_folder

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
    if given != UNKNOWN:
        return (
            f"PoCL 3.0 does not inline its functions on a {given!r}: the CPU's name is set to "
            f"{chosen or processor_name()!r} before anything is compiled; {VARIABLE}=off leaves PoCL unchanged, "
            f"{VARIABLE}=NAME sets another name"
        )
    if options:
        return (
            f"PoCL 3.0 does not know this CPU: its name is set to {chosen or processor_name()!r} before anything is "
            f"compiled; {VARIABLE}=off leaves PoCL unchanged, {VARIABLE}=NAME sets another name"
        )
    why = f"{VARIABLE} is {chosen!r}; unset it" if chosen else "its record of the device is not as expected"
    return f"PoCL 3.0 does not know this CPU, and is left unchanged: {why}"


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


def _readable_ranges() -> list[tuple[int, int]]:
    ranges = []
    with open("/proc/self/maps", encoding="utf-8", errors="replace") as text:
        for line in text:
            span, rights = line.split()[:2]
            if rights.startswith("rw"):
                low, high = (int(end, 16) for end in span.split("-"))
                ranges.append((low, high))
    return ranges


def _within(address: int, size: int, ranges: list[tuple[int, int]]) -> bool:
    for low, high in ranges:
        if low <= address and address + size <= high:
            return True
    return False


_TRIAL = """
import sys
import numpy as np
import pyopencl as cl
from aerokernels.tracing.engines.opencl.pocl import name_processor
device = next(device for platform in cl.get_platforms() if platform.name.strip() == "Portable Computing Language"
              for device in platform.get_devices())
name_processor(device)
context = cl.Context([device])
queue = cl.CommandQueue(context)
source = "__kernel void trial(__global float *x) { x[get_global_id(0)] = 1.0f; }"
kernel = cl.Kernel(cl.Program(context, source).build(sys.argv[1:], cache_dir=False), "trial")
kernel.set_arg(0, cl.Buffer(context, cl.mem_flags.WRITE_ONLY, 256))
cl.enqueue_nd_range_kernel(queue, kernel, (64,), (64,)).wait()
"""


def _greatest_file() -> float:
    """Return the size that files of this process may have [bytes]; infinite without a limit."""
    import resource

    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return float("inf") if limit == resource.RLIM_INFINITY else limit


def _succeeds(seconds: float, **started: Any) -> bool:
    try:
        done = subprocess.run(
            **started,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=seconds,
        )
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0


def _linker() -> str | None:
    """Return the linker that PoCL's compiler finds; without PATH it finds none, while Python would search /usr/bin."""
    return shutil.which("ld", path=os.environ.get("PATH", ""))


def _links(folder: str) -> bool:
    """Whether `ld` links what PoCL's compiler passes to it: GCC's libraries and the C library."""
    linker = _linker()
    # Where distributions put GCC's libraries; the linker finds the C library by itself.
    places = [f"-L{place}" for place in glob.glob("/usr/lib/gcc/*/*/")]
    library = os.path.join(folder, "library.so")
    return linker is not None and _succeeds(
        20.0, args=[linker, "-shared", "-o", library, *places, "-lgcc", "-lgcc_s", "-lc"]
    )


def _compiles(folder: str, options: tuple[str, ...]) -> bool:
    """Whether PoCL compiles and launches a kernel in a child process."""
    return _succeeds(60.0, **python_child(["-c", _TRIAL, *options], {"POCL_CACHE_DIR": folder}))


def linker_trouble(options: tuple[str, ...] = ()) -> str:
    """Say why kernels of PoCL cannot be linked on this machine, with the remedy; empty if they can.

    PoCL's compiler calls `ld` from PATH, with libraries that come with a C compiler. If that does not link, a child
    process tries a kernel, because PoCL may contain a linker and the libraries may be in other places.

    Args:
        options: Compile options that the device needs.
    """
    if os.name != "posix":
        return ""
    if (greatest := _greatest_file()) < LEAST_SPACE:
        return (
            f"PoCL writes kernels to files, which are limited to {greatest} bytes here (ulimit -f), and would end the "
            "process if one is longer: raise the limit, or choose backend 'warp'"
        )
    place = cache_folder()  # takes kernels; there may be no folder for temporary files
    with tempfile.TemporaryDirectory(
        prefix="aerokernels-linker-", dir=place if place.is_dir() else None, ignore_cleanup_errors=True
    ) as folder:
        if _links(folder) or _compiles(folder, options):
            return ""
    missing = "`ld` does not find the libraries of GCC and C" if _linker() else "there is no `ld` on PATH"
    return (
        f"PoCL cannot link its kernels: {missing}, and its first kernel would end the process; install a C compiler, "
        "which contains them (on Debian and Ubuntu: apt install gcc libc6-dev), with its folder on PATH, or choose "
        "backend 'warp'"
    )
