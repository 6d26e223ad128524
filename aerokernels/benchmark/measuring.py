"""The choices of a benchmark, its clocks and errors as values for JSON, and its table of text."""

import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.benchmark.scenes import CONE_AMBIENT, CONE_HALF, WAVELENGTH, Truth
from aerokernels.inputs.checks import check_choice, check_count, check_positive
from aerokernels.tracing.engines.choice import available_backends, choose_backend
from aerokernels.tracing.plan import METHODS, PRECISIONS

PACKAGES = ("aerokernels", "numpy", "scipy", "warp-lang", "pyopencl", "pocl-binary-distribution")
TRUTH_RAYS = 256
# Optical path of an undisturbed ray from face to face [m].
UNDISTURBED = CONE_AMBIENT * 2.0 * CONE_HALF[2]
SUITES = ("cone", "strehl")
# The reference traces one ray at a time in Python: more rays would take hours.
REFERENCE_RAYS = 10_000
COLUMNS = ("suite", "who", "how", "M rays/s, kernel", "per core", "end to end", "per CPU s", "evaluations", "error")


@dataclass(frozen=True, eq=False)
class Timing:
    """One call made several times, after a first one that may compile."""

    first_seconds: float  # wall time of the first call
    wall_seconds: list[float]  # of each other call
    cpu_seconds: list[float]  # of all threads of this process
    results: list[Any]
    first: Any  # what the first call returned


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


def traced_clocks(timing: Timing, count: int, on_cpu: bool) -> dict:
    """Times of the first call and `clocks` of the others, of a call whose results have `seconds`; per core on a CPU."""
    from aerokernels.process.machine import core_count

    kernel = [result.seconds["kernel"] for result in timing.results]
    return {
        "first_call_seconds": timing.first_seconds,
        "compile_seconds": timing.first.seconds["compile"],
        **clocks(count, kernel, timing.wall_seconds, timing.cpu_seconds),
        "kernel_rays_per_core_second": rate(count / core_count(), kernel) if on_cpu else None,
    }


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


def chosen_rays(ray_count: int) -> np.ndarray:
    """Up to TRUTH_RAYS row numbers, sorted, of the rays compared with the truth; the same at every call."""
    return np.sort(np.random.default_rng(905).choice(ray_count, min(TRUTH_RAYS, ray_count), replace=False))


def errors(truth: Truth, direction: Any, opd: Any, good: Any = None) -> dict:
    """OPD errors in waves, without removing piston, and the greatest angle error [urad], over the rays that arrived.

    `direction` are unit tangents (n, 3), `opd` is in metres (n,), and `good` tells which rays arrived (n,).
    """
    good = np.ones(len(opd), dtype=bool) if good is None else np.asarray(good)
    result: dict[str, float | None] = dict.fromkeys(("opd_rms_waves", "opd_max_waves", "direction_max_urad"))
    if good.any():
        waves = (np.asarray(opd) - truth.opd)[good] / WAVELENGTH
        angle = np.linalg.norm((np.asarray(direction) - truth.direction)[good], axis=1)
        result["opd_rms_waves"] = float(np.sqrt(np.mean(waves**2)))
        result["opd_max_waves"] = float(np.abs(waves).max())
        result["direction_max_urad"] = float(1e6 * angle.max())
    return {**result, "ray_count": int(good.sum()), "lost_ray_count": int((~good).sum())}


@dataclass(frozen=True)
class Settings:
    """The choices of a benchmark; a ValueError names one that makes no sense."""

    suites: tuple[str, ...] = ()  # from SUITES, none for all
    backends: tuple[str, ...] = ()  # none for all that are available except the reference
    device: str | None = None  # None for the best of each backend
    precisions: tuple[str, ...] = ("float32",)
    methods: tuple[str, ...] = ("auto", "adaptive", "straight")
    tolerances: tuple[float, ...] = (1e-3,)  # requested OPD errors [waves]
    ray_count: int = 1_000_000
    repeats: int = 5  # timed calls of each run, after one that compiles

    def __post_init__(self) -> None:
        """Check names and numbers."""
        for what, names, known in (
            ("suite", self.suites, SUITES),
            ("precision", self.precisions, PRECISIONS),
            ("method", self.methods, [name for name in METHODS if name != "fixed"]),
            ("backend", self.backends, ("warp", "opencl", "reference")),
        ):
            for name in names:
                check_choice(name, what, known)
        for name, least in (("repeats", 1), ("ray_count", 16)):
            object.__setattr__(self, name, check_count(getattr(self, name), name, least))
        for tolerance in self.tolerances:
            check_positive(tolerance, "tolerance", "waves")
        if "reference" in self.backends and self.ray_count > REFERENCE_RAYS:
            raise ValueError(
                f"backend 'reference' traces one ray at a time: {self.ray_count} rays would take hours, give at most "
                f"{REFERENCE_RAYS}"
            )

    @property
    def wanted(self) -> tuple[str, ...]:
        """The suites to run, each once, in the order of SUITES."""
        return tuple(name for name in SUITES if name in (self.suites or SUITES))


def find_targets(settings: Settings) -> list[tuple[str, str]]:
    """Pairs of backend and device to measure; a ValueError says which is not available."""
    backends = settings.backends or _present(settings.device)
    return [choose_backend(backend, settings.device)[:2] for backend in dict.fromkeys(backends)]


def _present(device: str | None) -> tuple[str, ...]:
    """The available backends that have the device, except the reference."""
    here = {info.backend for info in available_backends() if info.available} - {"reference"}
    result = []
    for backend in sorted(here, reverse=True):  # warp, then opencl
        try:
            choose_backend(backend, device)
        except ValueError:
            continue
        result.append(backend)
    if not result:
        choose_backend("auto", device)  # raises an error that names what is available
        raise ValueError(f"device {device!r} is not there: see `aerokernels backends`")
    return tuple(result)


def on_processor(backend: str, device: str) -> bool:
    """Whether a device is the computer's own CPU."""
    return device == "cpu" or any(
        (info.backend, info.device) == (backend, device) and info.description.startswith("CPU")
        for info in available_backends()
    )


def table_row(run: dict) -> tuple[str, ...]:
    """A run as texts, in the order of COLUMNS."""
    settings, chosen, is_cone = run["settings"], run["plan"]["method"], run["suite"] == "cone"
    method = settings["method"] if settings["method"] == chosen else f"{settings['method']}: {chosen}"
    how = f"{method}, {settings['precision']}, {settings['tolerance']:g} wave"
    how += "" if is_cone else f", symmetry {settings['symmetry']}"
    return (
        run["suite"],
        f"{settings['backend']} {settings['device']}",
        how,
        millions(run.get("kernel_rays_per_second")),
        millions(run.get("kernel_rays_per_core_second")),
        millions(run["rays_per_second"]) if is_cone else spread_text(run["wall_seconds"], 1e3, "ms"),
        millions(run.get("rays_per_cpu_second")),
        f"{run['evaluations_per_ray']:.1f}",
        cone_error(run["error"]) if is_cone else f"{run['error']['value']:+.1e}",
    )


def cone_error(error: dict) -> str:
    """The errors of a run over the true rays."""
    if error["opd_rms_waves"] is None:
        return "no ray arrived"
    lost = f", {error['lost_ray_count']} lost" if error["lost_ray_count"] else ""
    return f"{error['opd_rms_waves']:.1e} wave rms, {error['direction_max_urad']:.2g} urad{lost}"


def millions(measured: dict | None) -> str:
    """A rate and its error, in millions a second."""
    return "-" if measured is None else spread_text(measured, 1e-6, "")


def spread_text(measured: dict, scale: float, unit: str) -> str:
    """A measured number and its error, in another unit."""
    error = measured["standard_error"]
    text = f"{measured['median'] * scale:.3g}" + ("" if error is None else f" ± {error * scale:.1g}")
    return f"{text} {unit}".rstrip()
