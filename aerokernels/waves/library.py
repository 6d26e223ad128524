"""Fourier transform library of the waves: SciPy on a CPU; CuPy or PyTorch on a GPU, whichever is installed.

A split step needs transforms, elementwise products and the phase factors of sums of layers. Layers are copied to the
device once; every step then stays there. Neither GPU library is a dependency.
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
        array: Converts a NumPy array to the library's array.
        numpy: Converts the library's array to a NumPy array.
        phase_factor: Returns exp(i k p) of the sum p of layers (library's array, shape (count, rows, columns)) [m] for
            a wave number k [1/m] and a key of PRECISIONS; the sum and its phase are computed in double precision.
        darken: Sets an array to zero, in place, where any of some masks (library's array, (count, rows, columns)) is
            true.
    """

    name: str
    forward: Callable[[Any], Any]
    inverse: Callable[[Any], Any]
    array: Callable[[np.ndarray], Any]
    numpy: Callable[[Any], np.ndarray]
    phase_factor: Callable[[Any, float, str], Any]
    darken: Callable[[Any, Any], None]


def fourier_library(device: str | None = None) -> FourierLibrary:
    """Return the library for a device: "cpu" (None) or "gpu".

    Raises:
        ValueError: The device is unknown, or it is "gpu" and neither CuPy nor PyTorch is installed and finds one.
    """
    if device not in (None, *DEVICES):
        raise ValueError(f"device {device!r} is not known: choose one of {', '.join(DEVICES)}")
    if device != "gpu":
        from scipy import fft

        return FourierLibrary("scipy", fft.fft2, fft.ifft2, np.asarray, np.asarray, _phase_factor, _darken)
    for make in (_cupy, _torch):
        found = make()
        if found is not None:
            return found
    raise ValueError("device 'gpu': install CuPy (cupy-cuda12x) or PyTorch for your GPU, or take device='cpu'")


def _phase_factor(layers: np.ndarray, wave_number: float, precision: str) -> np.ndarray:
    """See `FourierLibrary.phase_factor`; sine and cosine take half of the time of a complex exponential."""
    phase = layers.sum(axis=0, dtype=np.float64)
    phase *= wave_number
    factor = np.empty(phase.shape, dtype=PRECISIONS[precision])
    if precision == "float32":
        # In single precision sine and cosine are ten times as fast, once whole turns are removed in double precision.
        phase -= 2.0 * np.pi * np.rint(phase / (2.0 * np.pi))
        phase = phase.astype(np.float32)
    factor.real, factor.imag = np.cos(phase), np.sin(phase)
    return factor


def _darken(amplitude: Any, opaque: Any) -> None:
    amplitude[opaque.any(axis=0)] = 0.0


def _cupy() -> FourierLibrary | None:
    try:
        cupy: Any = import_module("cupy")
        if cupy.cuda.runtime.getDeviceCount() < 1:
            return None
    except Exception:  # not installed, or no driver: each version raises its own error
        return None

    def phase_factor(layers: Any, wave_number: float, precision: str) -> Any:
        return cupy.exp(1j * wave_number * layers.sum(axis=0, dtype="float64")).astype(PRECISIONS[precision])

    return FourierLibrary("cupy", cupy.fft.fft2, cupy.fft.ifft2, cupy.asarray, cupy.asnumpy, phase_factor, _darken)


def _torch() -> FourierLibrary | None:
    try:
        torch: Any = import_module("torch")
        if not torch.cuda.is_available():
            return None
    except Exception:  # as above
        return None
    return torch_library(torch, "cuda")


def torch_library(torch: Any, device: str) -> FourierLibrary:
    """Return PyTorch's functions on one of its devices."""
    kinds = {"float64": torch.complex128, "float32": torch.complex64}

    def phase_factor(layers: Any, wave_number: float, precision: str) -> Any:
        phase = wave_number * layers.sum(dim=0, dtype=torch.float64)
        return torch.polar(torch.ones_like(phase), phase).to(kinds[precision])

    def darken(amplitude: Any, opaque: Any) -> None:
        amplitude[opaque.any(dim=0)] = 0.0

    return FourierLibrary(
        "torch",
        torch.fft.fft2,
        torch.fft.ifft2,
        lambda array: torch.as_tensor(array, device=device),
        lambda tensor: np.asarray(tensor.cpu().numpy()),
        phase_factor,
        darken,
    )
