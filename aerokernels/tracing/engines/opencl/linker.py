"""Check that PoCL can link and write the kernels that it compiles: if it cannot, it ends the process."""

import glob
import os
import shutil
import subprocess
import tempfile
from typing import Any

from aerokernels.process.kernel_cache import LEAST_SPACE

from ....process.machine import python_child
from .pocl_cache import cache_folder

_TRIAL = """
import sys
import numpy as np
import pyopencl as cl
from aerokernels.tracing.engines.opencl.pocl_workaround import name_processor
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
