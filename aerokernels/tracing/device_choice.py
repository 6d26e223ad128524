"""Warp or OpenCL on the CPU, or on a GPU that both have: measured once on a small scene, and remembered.

Both give the same answers, so only speed decides, and that depends on the processor and on the versions of both. What
was measured is kept in a JSON file of the user's cache folder; a file that is missing, damaged or not writable is no
error, it is measured again. AEROKERNELS_CPU_BACKEND and AEROKERNELS_GPU_BACKEND, "warp" or "opencl", decide instead of
a measurement, for scripts that have to do the same on every machine.
"""

import json
import os
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .backend_info import BackendInfo

# OpenCL is taken when it traces this many times Warp's rays per second: measured twice, speeds differ by some per cent.
MARGIN = 1.1
# Rays of the measurement: as many as it takes to keep a CPU or a GPU busy.
RAY_COUNTS = {"cpu": 20_000, "gpu": 1_000_000}
REPEATS = 3
VARIABLES = {"cpu": "AEROKERNELS_CPU_BACKEND", "gpu": "AEROKERNELS_GPU_BACKEND"}
KEPT = 32  # machines and versions in one file
NOT_MEASURED = "which of warp and opencl is faster here is measured when auto is first used"


@dataclass(frozen=True)
class Choice:
    """Backend and device that "auto" takes, and why."""

    backend: str
    device: str
    reason: str


# Takes backend and device, gives rays per second.
Measure = Callable[[str, str], float]

_in_memory: dict[str, dict[str, float]] = {}
_failures: dict[str, str] = {}
_lock = threading.RLock()


def faster_of(warp: BackendInfo, opencl: BackendInfo, measure: Measure | None = None) -> Choice:
    """The faster of a device of Warp and one of OpenCL; measured where not remembered, which compiles both tracers.

    Args:
        warp: Warp's device, the CPU or a GPU.
        opencl: OpenCL's device of the same kind.
        measure: Rays per second of a backend on a device; None traces a small scene.

    Returns:
        OpenCL where it is at least MARGIN times as fast, Warp otherwise and where OpenCL fails: a failure is kept for
        this process only.
    """
    key = _key(warp, opencl)
    with _lock:
        choice = remembered_choice(warp, opencl)
        if choice:
            return choice
        if key not in _failures:
            measure = rays_per_second if measure is None else measure
            try:
                rates = {info.backend: float(measure(info.backend, info.device)) for info in (opencl, warp)}
                if _sound(rates) is None:
                    raise ValueError(f"measured {rates}, which are no speeds")
            except Exception as error:  # whatever goes wrong in a driver, Warp is there
                _failures[key] = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
            else:
                _in_memory[key] = rates
                _write(key, rates)
                return _decide(warp, opencl, rates)
        return Choice("warp", warp.device, f"OpenCL on {opencl.device} was tried and failed ({_failures[key]})")


def remembered_choice(warp: BackendInfo, opencl: BackendInfo) -> Choice | None:
    """As `faster_of`, from memory alone; None where nothing is remembered.

    Raises:
        ValueError: The variable that decides instead is set to something else.
    """
    variable = VARIABLES["cpu" if warp.device == "cpu" else "gpu"]
    forced = os.environ.get(variable)
    if forced:
        if forced not in ("warp", "opencl"):
            raise ValueError(f"{variable} is {forced!r}: set it to 'warp' or 'opencl', or unset it")
        return Choice(forced, {"warp": warp, "opencl": opencl}[forced].device, f"{variable} says so")
    key = _key(warp, opencl)
    with _lock:
        rates = _in_memory.get(key) or _sound(_read().get(key))
        if rates is None:
            return None
        _in_memory[key] = rates
        return _decide(warp, opencl, rates)


def rays_per_second(backend: str, device: str) -> float:
    """Speed of the kernel alone, best of REPEATS, compiled before: slanted rays through a cubic volume, float32."""
    from ..medium import IndexField
    from ..rays import RayBundle
    from .trace import trace

    shape, cell = (33, 33, 65), 1e-3
    x, y, z = np.meshgrid(*(np.arange(count, dtype=float) for count in shape), indexing="ij", sparse=True)
    contrast = 2e-5 * np.sin(x / 5.0) * np.cos(y / 6.0) * np.sin(z / 7.0)
    field = IndexField.from_samples(
        contrast, origin=(-0.016, -0.016, 0.0), spacing=(cell,) * 3, geometry="volume", ambient_index=1.00027
    )
    count = RAY_COUNTS["gpu" if device.startswith("cuda") or _is_gpu(device, backend) else "cpu"]
    across = np.random.default_rng(1).uniform(-0.012, 0.012, (count, 2))
    rays = RayBundle(np.c_[across, np.full(count, -1e-3)], np.array([[0.02, 0.01, 1.0]]))
    # The first launch of this size compiles, in part within the launch itself.
    seconds = [
        trace(field, rays, method="straight", backend=backend, device=device, precision="float32").seconds["kernel"]
        for _ in range(REPEATS + 1)
    ]
    return count / min(seconds[1:])


def _is_gpu(device: str, backend: str) -> bool:
    if backend != "opencl":
        return False
    from .opencl_devices import find_device

    return find_device(device).info.description.startswith("GPU")


def cache_folder() -> Path:
    """Where measurements are kept: AEROKERNELS_CACHE_DIR, or the user's cache folder as the system has it."""
    chosen = os.environ.get("AEROKERNELS_CACHE_DIR")
    if chosen:
        return Path(chosen)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "aerokernels"


def _decide(warp: BackendInfo, opencl: BackendInfo, rates: dict[str, float]) -> Choice:
    ratio = rates["opencl"] / rates["warp"]
    times = f"{ratio:.2f} times the rays per second"
    measured = f"opencl on {opencl.device} traces {times} of warp on {warp.device}, measured once"
    if ratio >= MARGIN:
        return Choice("opencl", opencl.device, measured)
    return Choice("warp", warp.device, f"{measured}; {MARGIN:g} times would be needed for opencl")


def _key(warp: BackendInfo, opencl: BackendInfo) -> str:
    from aerokernels import __version__ as version

    # The descriptions hold core counts, platform and driver.
    return " | ".join((version, warp.version, warp.description, opencl.version, opencl.device, opencl.description))


def _sound(rates: Any) -> dict[str, float] | None:
    """The rates if they are speeds of both, None otherwise."""
    if not isinstance(rates, dict):
        return None
    speeds = [rates.get(name) for name in ("warp", "opencl")]
    sound = all(isinstance(speed, (int, float)) and np.isfinite(speed) and speed > 0.0 for speed in speeds)
    return rates if sound else None


def _file() -> Path:
    return cache_folder() / "cpu-choice.json"


def _read() -> dict:
    """What the file holds; nothing where it cannot be read or makes no sense."""
    try:
        held = json.loads(_file().read_text(encoding="utf-8"))
    except (OSError, ValueError, RuntimeError):  # RuntimeError: no home folder
        return {}
    return held if isinstance(held, dict) else {}


def _write(key: str, rates: dict[str, float]) -> None:
    """Add an entry, whole or not at all; the oldest go."""
    held = {name: value for name, value in _read().items() if name != key and _sound(value)}
    held = dict([*held.items(), (key, rates)][-KEPT:])
    with suppress(OSError, RuntimeError):
        path = _file()
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".tmp")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as text:
                json.dump(held, text, indent=1)
            os.replace(name, path)
        except OSError:
            with suppress(OSError):
                os.unlink(name)
            raise
