"""Arrays of other libraries that are known by DLPack alone: NumPy reads those in the computer's memory."""

from collections.abc import Iterable
from typing import Any

import numpy as np

# DLPack's number of the computer's own memory.
PROCESSOR = 1


def only_dlpack(value: Any) -> bool:
    """Return whether a value is an array of another library that `numpy.asarray` does not read."""
    if isinstance(value, type) or not hasattr(value, "__dlpack__"):
        return False
    return not (hasattr(value, "__array__") or hasattr(value, "__array_interface__"))


def read_by_numpy(values: Iterable[Any]) -> dict[int, np.ndarray]:
    """Return NumPy arrays, without a copy, of the values in the computer's memory known by DLPack alone, by their ids.

    Values on a device are left to the functions that accept them.
    """
    found = {}
    for value in values:
        if only_dlpack(value) and int(value.__dlpack_device__()[0]) == PROCESSOR:
            found[id(value)] = np.from_dlpack(value)
    return found
