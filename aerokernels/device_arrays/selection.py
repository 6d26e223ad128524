"""Rays picked out on the device: those of a status, and those at the ends of a bundle."""

from typing import Any

import numpy as np
import warp as wp

from .kernels import find_extremes, select

# Rows for which there is room at once, and threads that look for extremes.
ROOM, THREADS = 1 << 12, 1 << 14


def selected_rows(status: Any, code: int, error: Any, limit: float) -> np.ndarray:
    """See `array.rows_where`; `status` and `error` are arrays of Warp's, or no error."""
    rows, found = _selected(status, code, error, limit, 1)
    return np.sort(rows[:found].numpy()) if found else np.zeros(0, np.int32)


def rows_on_device(status: Any, code: int) -> Any:
    """Numbers of the rays with a status, ascending, as a warp.array where the status is."""
    rows, found = _selected(status, code, None, 0.0, 2)
    if not found:
        return wp.empty(0, dtype=wp.int32, device=status.device)
    if found > 1:
        wp.utils.radix_sort_pairs(rows, wp.empty(2 * found, dtype=wp.int32, device=status.device), found)
    return rows[:found]


def _selected(status: Any, code: int, error: Any, limit: float, copies: int) -> tuple[Any, int]:
    """Numbers of rays in no order, in an array with room for at least `copies` of them, and how many they are."""
    device, room = status.device, ROOM
    while True:
        rows, count = wp.empty(room, dtype=wp.int32, device=device), wp.zeros(1, dtype=wp.int32, device=device)
        given = [status, code, int(error is not None), error, limit, rows, count]
        wp.launch(select, dim=len(status), inputs=given, device=device)
        found = int(count.numpy()[0])
        if copies * found <= room:
            return rows, found
        room = copies * found


def extremes(values: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least and greatest of each component of places or directions, both shape (3,), and the rows with them (6,)."""
    device, threads = values.device, min(THREADS, len(values))
    low, high = (wp.empty(threads, dtype=wp.vec3d, device=device) for _ in range(2))
    low_row, high_row = (wp.empty(threads, dtype=wp.vec3i, device=device) for _ in range(2))
    wp.launch(find_extremes, dim=threads, inputs=[values, threads, low, high, low_row, high_row], device=device)
    lows, highs = low.numpy(), high.numpy()
    axes = np.arange(3)
    least, greatest = lows.argmin(axis=0), highs.argmax(axis=0)
    rows = np.stack([low_row.numpy()[least, axes], high_row.numpy()[greatest, axes]], axis=1)
    return lows[least, axes], highs[greatest, axes], rows.ravel()
