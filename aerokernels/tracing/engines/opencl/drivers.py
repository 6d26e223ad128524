"""Which of the installed OpenCL drivers do not load: the loader itself passes over them without a word."""

import ctypes
import os
import sys
from pathlib import Path

SYSTEM_FOLDER = "/etc/OpenCL/vendors"


def broken_drivers() -> list[str]:
    """One sentence for every .icd file whose library does not load or is no OpenCL driver; Linux only."""
    if not sys.platform.startswith("linux"):
        return []
    troubles = []
    for path in registered_files():
        try:
            lines = path.read_text(encoding="utf-8", errors="replace").split()
        except OSError as error:
            troubles.append(f"OpenCL driver file {path} cannot be read ({error.strerror}): mend or remove it")
            continue
        if not lines:
            troubles.append(f"OpenCL driver file {path} is empty: it should name a driver's library; remove it")
            continue
        trouble = _trouble(lines[0])
        if trouble:
            troubles.append(f"OpenCL driver file {path} names {lines[0]}, {trouble}: mend or remove it")
    return troubles


def registered_files() -> list[Path]:
    """The .icd files that the loader reads: OCL_ICD_VENDORS (a folder or a file) where it is set, else the system's."""
    place = Path(os.environ.get("OCL_ICD_VENDORS") or SYSTEM_FOLDER)
    if place.suffix == ".icd" and place.is_file():
        return [place]
    try:
        return sorted(path for path in place.iterdir() if path.suffix == ".icd")
    except OSError:
        return []


def _trouble(library: str) -> str:
    try:
        driver = ctypes.CDLL(library)  # the loader has opened it already, or tried to
    except OSError as error:
        return f"which does not load ({error})"
    # A driver gives its platforms by this function, itself or through clGetExtensionFunctionAddress.
    if hasattr(driver, "clIcdGetPlatformIDsKHR") or hasattr(driver, "clGetExtensionFunctionAddress"):
        return ""
    return "which is no OpenCL driver (it has no clIcdGetPlatformIDsKHR)"
