"""Assign the GPUs of this machine to workers, without loading a library that would occupy the GPUs."""

import ctypes
import os

from aerokernels.process.machine import core_count
from aerokernels.tracing.engines.info import cuda_driver_loads

VISIBLE = "CUDA_VISIBLE_DEVICES"
_LIBRARIES = ("libcuda.so.1", "libcuda.so", "nvcuda.dll")


def visible_gpus() -> list[str]:
    """Return the value of CUDA_VISIBLE_DEVICES that selects each usable GPU; an empty list without a driver."""
    if not cuda_driver_loads():
        return []
    named = os.environ.get(VISIBLE)
    if named is not None:
        return [name.strip() for name in named.split(",") if name.strip() not in ("", "-1")]
    for name in _LIBRARIES:
        try:
            driver = ctypes.CDLL(name)
        except OSError:
            continue
        count = ctypes.c_int(0)
        if driver.cuInit(0) == 0 and driver.cuDeviceGetCount(ctypes.byref(count)) == 0:
            return [str(k) for k in range(count.value)]
    return []


def worker_environments(workers: int | None, case_count: int, devices: set[str | None]) -> list[dict[str, str]]:
    """Return the variables to add to the environment of each worker process of this machine.

    Args:
        workers: Number of workers; None: one per GPU, or, without GPUs, one per core up to eight.
        case_count: Number of cases, which limits the number of workers.
        devices: The devices that the cases name; if any case names one, no GPUs are assigned.

    Returns:
        One mapping per worker, which assigns it a GPU, in rotation, and its share of the cores.
    """
    gpus = visible_gpus() if devices <= {None} else []
    cores = core_count()
    count = int(workers) if workers is not None else len(gpus) or min(cores, 8)
    count = max(1, min(count, case_count))
    share = str(max(1, cores // count))
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POCL_CPU_MAX_CU_COUNT"), share)
    own = {name: value for name, value in threads.items() if name not in os.environ} if count > 1 else {}
    return [{**own, **({VISIBLE: gpus[k % len(gpus)]} if gpus else {})} for k in range(count)]
