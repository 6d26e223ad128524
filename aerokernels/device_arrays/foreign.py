"""Arrays of other libraries (CuPy, PyTorch, JAX, Warp) by DLPack and `__cuda_array_interface__`."""

from typing import Any

import numpy as np

# DLPack's numbers of memory that the processor reads: its own, and that pinned for a GPU.
PROCESSOR, PINNED = 1, 3


def host_array(found: Any) -> np.ndarray:
    """An array of any library as a NumPy array, float32 or float64; one on a device is copied from there.

    Raises:
        TypeError: No array.
    """
    array = plain_array(found)
    if array.dtype == object or not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
        raise TypeError(f"a snapshot must be an array of real numbers or a DensityField, got {type(found).__name__}")
    return array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)


def plain_array(found: Any) -> np.ndarray:
    """Anything as NumPy has it: one on a device is copied from there, one on the host is not copied where it need not.

    What is no array comes as NumPy makes one of it, whatever that is.
    """
    if isinstance(found, np.ndarray):
        return found
    if is_on_device(found):
        return np.asarray(_as_warp(found).numpy())
    if hasattr(found, "__dlpack__") and not hasattr(found, "__array__") and not hasattr(found, "__array_interface__"):
        return np.from_dlpack(found)
    return np.asarray(found.detach() if getattr(found, "requires_grad", False) else found)


def device_array(found: Any, pinned: bool = False) -> Any:
    """An array on a GPU, or, where wanted, `pinned` for one, as one of Warp's, without a copy.

    None where it is no such array, or of whole numbers.
    """
    if isinstance(found, np.ndarray) or not (is_on_device(found) or (pinned and _memory_of(found) == PINNED)):
        return None
    import warp

    try:
        array = _as_warp(found)
    except (AssertionError, RuntimeError, TypeError, ValueError, BufferError):
        if is_on_device(found):
            raise
        return None  # a library that hands out pinned memory as a host's only: it is read as such
    return array.contiguous() if array.dtype in (warp.float32, warp.float64) else None


def is_on_device(found: Any) -> bool:
    """Whether an array lies where only a GPU reads it: says `__cuda_array_interface__`, or DLPack."""
    if hasattr(found, "__cuda_array_interface__"):
        return True
    return _memory_of(found) not in (None, PROCESSOR, PINNED)


def _memory_of(found: Any) -> int | None:
    """The kind of memory that an array says through DLPack it is in; None where it does not say."""
    device = getattr(found, "__dlpack_device__", None)
    return None if device is None else int(device()[0])


def _as_warp(found: Any) -> Any:
    """An array on a device as one of Warp's numbers, not of its vectors."""
    import warp

    from ..process.quiet_warp import start_warp

    start_warp()
    if getattr(found, "requires_grad", False) and hasattr(found, "detach"):
        found = found.detach()
    if isinstance(found, warp.array) and found.dtype in (warp.float32, warp.float64):
        return found
    return warp.from_dlpack(found) if hasattr(found, "__dlpack__") else warp.array(found, copy=False)
