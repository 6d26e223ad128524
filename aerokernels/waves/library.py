"""Fourier transform library of the waves: SciPy on a CPU; CuPy or PyTorch on a GPU, whichever is installed.

All three have `fft.fft2`, `fft.ifft2` (SciPy: `fft2`, `ifft2`) and elementwise products, all that a split step needs.
Neither GPU library is a dependency.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

PRECISIONS = {"float64": np.complex128, "float32": np.complex64}
DEVICES = ("cpu", "gpu")


@dataclass(frozen=True)
class FourierLibrary:
    """A library of fast Fourier transforms and its array conversions.

    Attributes:
        name: "scipy", "cupy" or "torch".
        forward: Two-dimensional transform of the library's arrays.
        inverse: Inverse transform.
        array: Converts a complex NumPy array to the library's array.
        numpy: Converts the library's array to a NumPy array.
    """

    name: str
    forward: Callable[[Any], Any]
    inverse: Callable[[Any], Any]
    array: Callable[[np.ndarray], Any]
    numpy: Callable[[Any], np.ndarray]


def fourier_library(device: str | None = None) -> FourierLibrary:
    """Return the library for a device: "cpu" (None) or "gpu".

    Raises:
        ValueError: The device is unknown, or it is "gpu" and neither CuPy nor PyTorch is installed and finds one.
    """
    if device not in (None, *DEVICES):
        raise ValueError(f"device {device!r} is not known: choose one of {', '.join(DEVICES)}")
    if device != "gpu":
        from scipy import fft

        return FourierLibrary("scipy", fft.fft2, fft.ifft2, np.asarray, np.asarray)
    for make in (_cupy, _torch):
        found = make()
        if found is not None:
            return found
    raise ValueError("device 'gpu': install CuPy (cupy-cuda12x) or PyTorch for your GPU, or take device='cpu'")


def _cupy() -> FourierLibrary | None:
    try:
        cupy: Any = import_module("cupy")
        if cupy.cuda.runtime.getDeviceCount() < 1:
            return None
    except Exception:  # not installed, or no driver: each version raises its own error
        return None
    return FourierLibrary("cupy", cupy.fft.fft2, cupy.fft.ifft2, cupy.asarray, cupy.asnumpy)


def _torch() -> FourierLibrary | None:
    try:
        torch: Any = import_module("torch")
        if not torch.cuda.is_available():
            return None
    except Exception:  # as above
        return None
    return FourierLibrary(
        "torch",
        torch.fft.fft2,
        torch.fft.ifft2,
        lambda array: torch.as_tensor(array, device="cuda"),
        lambda tensor: np.asarray(tensor.cpu().numpy()),
    )
