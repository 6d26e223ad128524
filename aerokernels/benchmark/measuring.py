"""Clocks, their spread, and a description of the machine, as values for JSON."""

import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

PACKAGES = ("aerokernels", "numpy", "scipy", "warp-lang", "pyopencl", "pocl-binary-distribution")


@dataclass(frozen=True, eq=False)
class Timing:
    """One call made several times, after a first one that may compile.

    Attributes:
        first_seconds: Wall time of the first call.
        wall_seconds: Wall time of each other call.
        cpu_seconds: CPU time of each, of all threads of this process.
        results: What each returned.
        first: What the first call returned.
    """

    first_seconds: float
    wall_seconds: list[float]
    cpu_seconds: list[float]
    results: list[Any]
    first: Any


def measure(call: Callable[[], Any], repeats: int) -> Timing:
    """Call once, then time `repeats` calls."""
    begin = time.perf_counter()
    first = call()
    first_seconds = time.perf_counter() - begin
    wall, processor, results = [], [], []
    for _ in range(repeats):
        begin, spent = time.perf_counter(), time.process_time()
        results.append(call())
        processor.append(time.process_time() - spent)
        wall.append(time.perf_counter() - begin)
    return Timing(first_seconds, wall, processor, results, first)


def spread(values: Sequence[float]) -> dict:
    """Median and standard error of the mean; the error is None for a single value."""
    numbers = np.asarray(values, dtype=np.float64)
    error = float(numbers.std(ddof=1) / np.sqrt(len(numbers))) if len(numbers) > 1 else None
    return {"median": float(np.median(numbers)), "standard_error": error}


def rate(count: float, seconds: Sequence[float]) -> dict | None:
    """`count` per second, with the spread over the repeats; None if a clock shows no time."""
    return spread([count / value for value in seconds]) if all(value > 0.0 for value in seconds) else None


def clocks(count: int, kernel: Sequence[float], wall: Sequence[float], processor: Sequence[float]) -> dict:
    """Seconds of each repeat by three clocks, and `count` rays a second by each."""
    return {
        "kernel_seconds": spread(kernel),
        "wall_seconds": spread(wall),
        "cpu_seconds": spread(processor),
        "kernel_rays_per_second": rate(count, kernel),
        "rays_per_second": rate(count, wall),
        "rays_per_cpu_second": rate(count, processor),
    }


def traced_clocks(timing: Timing, count: int, on_cpu: bool, kernels: Timing | None = None) -> dict:
    """Times of the first call and `clocks` of the others, of a call whose results have `seconds`; per core on a CPU.

    `kernels` are calls from which the kernel's time is taken, if not from the same ones.
    """
    from aerokernels.process.machine import core_count

    kernel = [result.seconds["kernel"] for result in (kernels or timing).results]
    return {
        "first_call_seconds": timing.first_seconds,
        "compile_seconds": timing.first.seconds["compile"],
        **clocks(count, kernel, timing.wall_seconds, timing.cpu_seconds),
        "kernel_rays_per_core_second": rate(count / core_count(), kernel) if on_cpu else None,
    }


def plan_facts(plan: Any) -> dict:
    """The method, step and reasons of a plan."""
    return {"method": plan.method, "step": plan.step, "reasons": list(plan.reasons)}


def installed(package: str) -> str | None:
    """Version of an installed distribution, None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def machine() -> dict:
    """Describe the machine that is measured."""
    from aerokernels.process.machine import core_count
    from aerokernels.tracing import available_backends

    return {
        "cpu": _cpu_model(),
        "cores": core_count(),
        "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {package: installed(package) for package in PACKAGES},
        "devices": [
            {"backend": info.backend, "device": info.device, "description": info.description}
            for info in available_backends()
            if info.available
        ],
    }


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()
