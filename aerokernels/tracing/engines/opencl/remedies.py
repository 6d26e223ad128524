"""Remedies for an OpenCL without platforms, and for a platform without devices."""

import os

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
