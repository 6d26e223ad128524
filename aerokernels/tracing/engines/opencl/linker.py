"""Whether PoCL can link and write the kernels that it compiles: where it cannot, it ends the process."""

import os
import shutil
import subprocess
import sys
import tempfile

from .pocl_cache import LEAST_SPACE

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
    """Size [bytes] that this process's files may have; infinite where there is no limit."""
    import resource

    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return float("inf") if limit == resource.RLIM_INFINITY else limit


def linker_trouble(options: tuple[str, ...] = ()) -> str:
    """Why kernels of PoCL cannot be linked here, with the remedy; empty where they can.

    PoCL's compiler looks for `ld` on PATH. Where there is none a process of its own tries, since PoCL may have been
    built with a linker in it.

    Args:
        options: Compile options that the device needs.
    """
    if os.name != "posix":
        return ""
    if (greatest := _greatest_file()) < LEAST_SPACE:
        return (
            f"PoCL writes kernels to files, which may have {greatest} bytes here (ulimit -f), and it ends the process "
            "where they do not fit: raise the limit, or take backend 'warp'"
        )
    if shutil.which("ld"):
        return ""
    with tempfile.TemporaryDirectory(prefix="aerokernels-linker-", ignore_cleanup_errors=True) as folder:
        packages = os.path.abspath(__file__).rsplit(f"{os.sep}aerokernels{os.sep}", 1)[0]
        path = os.pathsep.join([packages, *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = {**os.environ, "POCL_CACHE_DIR": folder, "PYTHONPATH": path}
        try:
            done = subprocess.run(
                [sys.executable, "-c", _TRIAL, *options],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=60,
            )
        except (OSError, ValueError, subprocess.TimeoutExpired):
            failed = True
        else:
            failed = done.returncode != 0
    if not failed:
        return ""
    return (
        "PoCL finds no linker: there is no `ld` on PATH, and without one its first kernel would end the process; "
        "install one (on Debian and Ubuntu: apt install binutils) or put its folder on PATH, or take backend 'warp'"
    )
