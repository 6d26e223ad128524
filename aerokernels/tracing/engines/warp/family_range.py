"""Find, on a device, the range of the parameters that rays on it have in a family: see bundle/known_family.py."""

from typing import Any

import numpy as np
import warp as wp

from ...bundle.family import Family
from ...bundle.frame import family_numbers
from .kernels.family_range import NUMBERS, find_range

# Number of threads.
THREADS = 1 << 10


def rows_on_device(rows: np.ndarray, device: str) -> Any:
    """Upload the numbers of rays for `range_on_device`."""
    return wp.array(rows, dtype=wp.int32, device=device)


def family_on_device(family: Family, device: str) -> Any:
    """Upload the numbers that describe a family for `range_on_device`."""
    return wp.array(family_numbers(family), dtype=wp.float64, device=device)


def range_on_device(
    frame: Any, converges: bool, rows: Any, position: Any, direction: Any
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the least and greatest parameters of some rays, each of shape (2,); None if some are not of the family.

    Args:
        frame: The numbers of the family, a warp.array.
        converges: Whether its lines pass through one point.
        rows: Numbers of the rays, a warp.array.
        position: Starts of all rays [m], a warp.array of vectors.
        direction: Directions of all rays, a warp.array of vectors.
    """
    device, threads = position.device, min(THREADS, len(rows))
    made = wp.empty(NUMBERS * threads, dtype=wp.float64, device=device)
    given = [frame, int(converges), rows, threads, position, direction, made]
    wp.launch(find_range, dim=threads, inputs=given, device=device)
    found = made.numpy().reshape(NUMBERS, threads)
    if found[0].any():
        return None
    return found[1:3].min(axis=1), found[3:5].max(axis=1)
