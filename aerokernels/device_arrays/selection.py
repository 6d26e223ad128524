"""Selection of rays on the device: rays with a status, and rays at the extremes of a bundle."""

from typing import Any

import numpy as np
import warp as wp

from .kernels import find_extremes, select
from .launching import launch
from .pinned import to_host

# Capacity of the first list of rows, and threads that search for extremes.
ROOM, THREADS = 1 << 12, 1 << 14


def selected_rows(status: Any, code: int, error: Any, limit: float) -> np.ndarray:
    """Return the rows of `array.rows_where`; `status` and `error` are Warp arrays, `error` may be None."""
    room, found = 0, ROOM
    while found > room:
        room, device = found, status.device
        rows, count = wp.empty(room, dtype=wp.int32, device=device), wp.zeros(1, dtype=wp.int32, device=device)
        launch(select, len(status), [status, code, int(error is not None), error, limit, rows, count], device)
        found = int(to_host(count)[0])
    return np.sort(to_host(rows[:found])) if found else np.zeros(0, np.int32)


def extremes(values: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the least and greatest of each component of vectors, both shape (3,), and the rows that have them (6,)."""
    device, threads = values.device, min(THREADS, len(values))
    low, high = (wp.empty(threads, dtype=wp.vec3d, device=device) for _ in range(2))
    low_row, high_row = (wp.empty(threads, dtype=wp.vec3i, device=device) for _ in range(2))
    launch(find_extremes, threads, [values, threads, low, high, low_row, high_row], device)
    lows, highs = to_host(low), to_host(high)
    axes = np.arange(3)
    least, greatest = lows.argmin(axis=0), highs.argmax(axis=0)
    rows = np.stack([to_host(low_row)[least, axes], to_host(high_row)[greatest, axes]], axis=1)
    return lows[least, axes], highs[greatest, axes], rows.ravel()
