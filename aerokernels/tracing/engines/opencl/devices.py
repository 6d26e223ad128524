"""Find OpenCL's platforms and devices, and open one session per device.

PyOpenCL is imported only here, on first use, so that every failure of OpenCL ends in `OpenCLUnavailable` with a remedy,
and a broken driver does not affect the others.
"""

import atexit
import importlib
import importlib.util
import os
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aerokernels.process.quiet_warp import NoCacheError, why_unusable

from ....process.machine import patient_threads
from ....process.opened import OPENED
from ..info import BackendInfo, absent
from .pocl import is_unknown, linker_trouble, make_safe, name_processor, workaround
from .session import Session

POCL = "Portable Computing Language"
KINDS = ("gpu", "cpu", "accelerator")  # in order of preference
SESSION = "OpenCL session"
NO_PLATFORM = (
    "pyopencl is installed but finds no OpenCL platform: pip install 'pyopencl[pocl]' brings one for CPUs "
    "(64-bit Linux on x86), or install your device's OpenCL driver (on Debian and Ubuntu pocl-opencl-icd for CPUs); "
    "drivers that do not load are skipped: see the files in /etc/OpenCL/vendors, or where OCL_ICD_VENDORS points"
)


class OpenCLUnavailable(ValueError):
    """OpenCL cannot be used here; the message says why and what to do."""


@dataclass(frozen=True)
class FoundDevice:
    """A device: its description, PyOpenCL's object, its kind ("gpu", "cpu" or "accelerator") and its compute units.

    `options` are compile options that this device needs.
    """

    info: BackendInfo
    device: Any
    kind: str
    compute_units: int
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class Survey:
    """The devices that a process found, best first; what is wrong; the process that started the drivers' threads."""

    devices: list[FoundDevice]
    troubles: list[str]
    opened_by: int | None = None


def import_pyopencl():
    """Import and return PyOpenCL.

    Raises:
        OpenCLUnavailable: It is not installed, or its import fails.
    """
    try:
        spec = importlib.util.find_spec("pyopencl")
    except (ImportError, ValueError):
        spec = None
    if spec is None:
        raise OpenCLUnavailable("the package pyopencl is not installed: pip install 'aerokernels[opencl]'")
    try:
        if "pyopencl" not in sys.modules:
            import platformdirs  # PyOpenCL's own dependency

            if why_unusable(Path(platformdirs.user_cache_dir("pytools", "pytools"))):
                # Its first launch would fail for want of a cache; it reads this variable once, when it is imported.
                os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
        return importlib.import_module("pyopencl")
    except Exception as error:  # a foreign package and a C extension: anything may come
        raise OpenCLUnavailable(
            f"pyopencl is installed ({spec.origin}) but its import fails with {type(error).__name__}: {error}; "
            "pip install --force-reinstall 'pyopencl[pocl]'"
        ) from error


def list_devices() -> list[BackendInfo]:
    """Return every device of every platform, the best first, then entries for what is broken.

    A missing or broken OpenCL raises nothing: an entry that is not available gives the reason.
    """
    try:
        devices, troubles = survey()
    except OpenCLUnavailable as error:
        return [absent("opencl", str(error))]
    return [found.info for found in devices] + [absent("opencl", trouble) for trouble in troubles]


def find_device(name: str | None = None) -> FoundDevice:
    """Return the device with a name.

    Args:
        name: None for the best device (a GPU before a CPU, then the most compute units), "gpu" or "cpu" for the best of
            the kind; else a name from `list_devices`, in any case of letters, or a part that only one name has.

    Raises:
        OpenCLUnavailable: There is no OpenCL here, or the device cannot trace.
        ValueError: No device, or more than one, has that name; the message lists what there is.
    """
    devices, troubles = survey()
    if name is None or name.lower() in KINDS:
        matching = [found for found in devices if name is None or found.kind == name.lower()]
        usable = [found for found in matching if found.info.available]
        if usable:
            return usable[0]
        if matching or name is None:
            reasons = [f"{found.info.device}: {found.info.reason}" for found in matching] + troubles
            raise OpenCLUnavailable("no OpenCL device here can trace: " + "; ".join(reasons))
    else:
        lowered = name.strip().lower()
        matching = [found for found in devices if found.info.device.lower() == lowered]
        matching = matching or [found for found in devices if lowered and lowered in found.info.device.lower()]
        if len(matching) == 1:
            if not matching[0].info.available:
                raise OpenCLUnavailable(f"OpenCL device {matching[0].info.device!r}: {matching[0].info.reason}")
            return matching[0]
        if matching:
            names = ", ".join(repr(found.info.device) for found in matching)
            raise ValueError(f"device {name!r} is ambiguous: it may be {names}; give the whole name")
    names = ", ".join(repr(found.info.device) for found in devices) or "none"
    raise ValueError(f"device {name!r} is not there: backend 'opencl' has {names}")


def session(name: str | None = None) -> Session:
    """Return the open session of a device (see `find_device`), one per process; thread-safe.

    Raises:
        OpenCLUnavailable: There is no OpenCL here, or the device cannot be opened.
        ValueError: No device, or more than one, has that name.
    """
    here: Session | None = OPENED.get((SESSION, os.getpid(), name))  # for the whole name of a device that is open
    if here is not None:
        return here
    found = find_device(name)
    opened: Session = OPENED.once((SESSION, os.getpid(), found.info.device), lambda: _open(found))
    return opened


def _open(found: FoundDevice) -> Session:
    cl = import_pyopencl()
    try:
        context = cl.Context([found.device])
        queue = cl.CommandQueue(context, found.device)
    except cl.Error as error:
        raise OpenCLUnavailable(
            f"OpenCL device {found.info.device!r} is listed but does not open ({error}): it may be in use, or its "
            "memory full. Choose another device, or backend 'warp'"
        ) from error
    return Session(found.info.device, found.device, context, queue, found.options)


@atexit.register
def release_all() -> None:
    """Finish and release every session of this process; sessions inherited by a fork are left alone."""
    for key, released in OPENED.held(SESSION).items():
        if key[1] != os.getpid() or OPENED.take_out(key) is None:
            continue
        released.programs.clear()
        released.launched.clear()
        try:
            released.queue.finish()
        except import_pyopencl().Error:
            pass  # on a lost device there is nothing to wait for


def survey() -> tuple[list[FoundDevice], list[str]]:
    """Return the devices, best first, and what is wrong with platforms and drivers.

    Raises:
        OpenCLUnavailable: PyOpenCL is missing or broken, nothing at all was found, or this process is a fork of one
            that uses OpenCL.
    """
    found: Survey = OPENED.once("OpenCL devices", _survey)
    if found.opened_by not in (None, os.getpid()):
        raise OpenCLUnavailable(
            "this process was forked from one that had opened OpenCL, and the drivers' threads do not survive a fork: "
            "start worker processes with multiprocessing's method 'spawn', or choose backend 'warp'"
        )
    if not found.devices:
        raise OpenCLUnavailable("; ".join(found.troubles))
    return found.devices, found.troubles


def _survey() -> Survey:
    """Search for devices; a process does this once, as the driver loader does. No devices if OpenCL is missing."""
    try:
        cl = import_pyopencl()
    except OpenCLUnavailable as error:
        return Survey([], [str(error)])
    troubles: list[str] = []
    try:
        make_safe()
        platforms = cl.get_platforms()
    except NoCacheError as error:
        return Survey([], [str(error)])
    except cl.Error:
        platforms = []
    if not platforms:
        return Survey([], [NO_PLATFORM])
    opened_by = os.getpid()  # drivers start their threads when their devices are listed
    devices: list[FoundDevice] = []
    for index, platform in enumerate(platforms):
        title, why = f"platform {index}", "has no devices: check that its driver is loaded"
        present: list[Any] = []
        try:
            title = f"platform {platform.name.strip()!r}"
            with patient_threads():
                present = platform.get_devices()
        except cl.Error as error:
            if error.code != cl.status_code.DEVICE_NOT_FOUND:
                why = f"fails: {error}"
        if not present:
            troubles.append(f"{title} {why}")
        for device in present:
            try:
                devices.append(_describe(cl, platform, device))
            except (cl.Error, ValueError) as error:
                troubles.append(f"{title} has a device that does not describe itself: {error}")
    if not devices:
        return Survey([], ["no OpenCL device is here", *troubles], opened_by)
    devices.sort(key=lambda found: (not found.info.available, KINDS.index(found.kind), -found.compute_units))
    return Survey(with_unique_names(devices), troubles, opened_by)


def _describe(cl, platform, device) -> FoundDevice:
    name = " ".join(device.name.split())
    units = int(device.max_compute_units)
    kind = "gpu" if device.type & cl.device_type.GPU else "cpu" if device.type & cl.device_type.CPU else "accelerator"
    float64 = has_float64(cl, device)
    options: tuple[str, ...] = ()
    reason = done = ""
    if not float64:
        reason = (
            f"float64 is missing on {name}, but ends of rays and sums of paths need it: choose a device whose float64 "
            "column says yes in `aerokernels backends`, or backend 'warp'"
        )
    elif not (device.available and device.compiler_available):
        reason = f"{name} reports that it is not available" if not device.available else f"{name} has no compiler"
    elif platform.name.strip() == POCL:
        # PoCL contains its own compiler, which may be older than the CPU; other drivers know their devices.
        options = name_processor(device)
        done = workaround(device, options)
        reason = linker_trouble(device)
        if is_unknown(device) and not options:
            reason = f"{done}; install a newer PoCL as the system's OpenCL driver, or choose backend 'warp'"
    # PoCL's version string continues with how it was compiled: keep only its beginning.
    version = f"{platform.name.strip()} {re.split(r'  |,', platform.version.strip())[0]}"
    info = BackendInfo(
        "opencl",
        name,
        f"{kind.upper() if kind != 'accelerator' else kind}, {units} compute units; {version}, driver "
        f"{device.driver_version.strip()}",
        cl.VERSION_TEXT,
        not reason,
        float64,
        int(device.global_mem_size),
        reason or "OpenCL can trace on it",
        done,
    )
    return FoundDevice(info, device, kind, units, options)


def has_float64(cl, device) -> bool:
    """Whether a device computes in float64."""
    try:
        return bool(device.double_fp_config) or "cl_khr_fp64" in device.extensions.split()
    except cl.Error:
        return False


def with_unique_names(devices: list[FoundDevice]) -> list[FoundDevice]:
    """Return the devices with a number appended to repeated names."""
    seen: dict[str, int] = {}
    named = []
    for found in devices:
        name = found.info.device
        seen[name] = seen.get(name, 0) + 1
        if seen[name] > 1:
            found = replace(found, info=replace(found.info, device=f"{name} #{seen[name]}"))
        named.append(found)
    return named
