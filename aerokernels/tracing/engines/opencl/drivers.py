"""Find OpenCL drivers that do not load, which OpenCL's loader skips silently; say what to do without a platform."""

import ctypes
import os
import sys
from pathlib import Path

SYSTEM_FOLDER = "/etc/OpenCL/vendors"


def broken_drivers() -> list[str]:
    """Return one sentence for every .icd file whose library does not load or is no OpenCL driver; Linux only."""
    if not sys.platform.startswith("linux"):
        return []
    troubles = []
    for path in registered_files():
        try:
            lines = path.read_text(encoding="utf-8", errors="replace").split()
        except OSError as error:
            troubles.append(f"OpenCL driver file {path} cannot be read ({error.strerror}): correct or remove it")
            continue
        if not lines:
            troubles.append(f"OpenCL driver file {path} is empty: it should name a driver's library; remove it")
            continue
        trouble = _trouble(lines[0])
        if trouble:
            troubles.append(f"OpenCL driver file {path} names {lines[0]}, {trouble}: correct or remove it")
    return troubles


def registered_files() -> list[Path]:
    """Return the .icd files that the loader reads: those of OCL_ICD_VENDORS (a folder or a file) or the system's."""
    place = Path(os.environ.get("OCL_ICD_VENDORS") or SYSTEM_FOLDER)
    if place.suffix == ".icd" and place.is_file():
        return [place]
    try:
        return sorted(path for path in place.iterdir() if path.suffix == ".icd")
    except OSError:
        return []


def _trouble(library: str) -> str:
    try:
        driver = ctypes.CDLL(library)  # the loader opens the same library
    except OSError as error:
        return f"which does not load ({error})"
    # A driver provides its platforms by this function, directly or through clGetExtensionFunctionAddress.
    if hasattr(driver, "clIcdGetPlatformIDsKHR") or hasattr(driver, "clGetExtensionFunctionAddress"):
        return ""
    return "which is not an OpenCL driver (it has no clIcdGetPlatformIDsKHR)"


POCL = "Portable Computing Language"


def why_no_devices(title: str) -> str:
    """Return the remedy for a platform without devices."""
    if POCL in title:
        return "it needs a writable folder for its cache: set POCL_CACHE_DIR to one"
    return "for a GPU, check that its driver is loaded"


def no_platform() -> str:
    """Return the message for an OpenCL without platforms, with the remedy."""
    message = (
        "pyopencl is installed but finds no OpenCL platform: pip install 'pyopencl[pocl]' brings one for CPUs "
        "(64-bit Linux on x86), or install your device's OpenCL driver (on Debian and Ubuntu pocl-opencl-icd for CPUs)"
    )
    vendors = os.environ.get("OCL_ICD_VENDORS")
    if vendors is not None:
        message += f"; OCL_ICD_VENDORS is {vendors!r}, so drivers are searched only there: unset it, or correct it"
    return message
