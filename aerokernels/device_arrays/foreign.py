"""Import arrays of other libraries (CuPy, PyTorch, JAX, Warp) by DLPack and `__cuda_array_interface__`."""

from typing import Any

import numpy as np

from ..process.opened import OPENED
from .pinned import to_host

# DLPack's numbers of memory that the CPU reads: its own, and memory pinned for a GPU.
PROCESSOR, PINNED = 1, 3


def host_array(found: Any) -> np.ndarray:
    """Return an array of any library as a NumPy array, float32 or float64; one on a device is copied.

    Raises:
        TypeError: It is not an array of real numbers.
    """
    array = plain_array(found)
    if array.dtype == object or not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
        raise TypeError(f"a snapshot must be an array of real numbers or a DensityField, got {type(found).__name__}")
    return array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)


def plain_array(found: Any) -> np.ndarray:
    """Return any object as a NumPy array; arrays on a device are copied, arrays on the host only if necessary.

    An object that is not an array is converted by `numpy.asarray`.
    """
    if isinstance(found, np.ndarray):
        return found
    if is_on_device(found):
        array = _as_warp(found)
        return to_host(array.contiguous().flatten()).reshape(array.shape)
    if hasattr(found, "__dlpack__") and not hasattr(found, "__array__") and not hasattr(found, "__array_interface__"):
        return np.from_dlpack(found)
    return np.asarray(found.detach() if getattr(found, "requires_grad", False) else found)


def device_array(found: Any) -> Any:
    """Return an array on a GPU as a Warp array without a copy; None if it is elsewhere, or has whole numbers."""
    if isinstance(found, np.ndarray) or not is_on_device(found):
        return None
    import warp

    array = _as_warp(found)
    return array.contiguous() if array.dtype in (warp.float32, warp.float64) else None


def is_on_device(found: Any) -> bool:
    """Return whether an array is in memory that only a GPU reads, by `__cuda_array_interface__` or DLPack."""
    if hasattr(found, "__cuda_array_interface__"):
        return True
    device = getattr(found, "__dlpack_device__", None)
    return device is not None and int(device()[0]) not in (PROCESSOR, PINNED)


def _as_warp(found: Any) -> Any:
    """Return an array on a device as a Warp array of numbers, not of vectors."""
    import warp

    from ..process.quiet_warp import start_warp

    start_warp()
    if getattr(found, "requires_grad", False) and hasattr(found, "detach"):
        found = found.detach()
    if isinstance(found, warp.array) and found.dtype in (warp.float32, warp.float64):
        return found
    with OPENED.lock:  # it may open a device: see `quiet_warp.open_device`
        return warp.from_dlpack(found) if hasattr(found, "__dlpack__") else warp.array(found, copy=False)
