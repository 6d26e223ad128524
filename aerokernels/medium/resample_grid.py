"""Count the nodes of a uniform grid of a given spacing, and reject grids too coarse or too large for a field."""

import numpy as np

from ..process.machine import host_memory

NODE_LIMIT = 200_000_000
# Greatest memory that resampling needs per node, measured on the shipped flows.
BYTES_PER_NODE = 300
# A grid of fewer cells along an axis does not resolve any structure of a flow.
LEAST_CELLS = 4


def node_counts(field, low: np.ndarray, high: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the number of nodes along each axis of a grid that divides a region of a field evenly.

    Args:
        field: The IndexField that is resampled.
        low: Lowest corner of the region [m], shape (d,).
        high: Highest corner [m], shape (d,).
        step: Greatest spacing [m], shape (d,).

    Raises:
        ValueError: A spacing of more than a quarter of the region along an axis, unless the field's own is as great
            there; or more nodes than fit in memory.
    """
    extent = high - low
    size = " by ".join(f"{side:.3g}" for side in extent) + " m"
    with np.errstate(over="ignore"):
        cells = np.ceil(extent / step * (1 - 1e-12))  # as float64: a spacing of 1e-300 m would overflow integers
    own = field.spacing if field.is_uniform else np.zeros(len(extent))
    coarse = (cells < LEAST_CELLS) & (step > own * (1 + 1e-9))
    if coarse.any():
        most = extent[coarse].min() / LEAST_CELLS
        raise ValueError(
            f"spacing {_text(step)} m leaves fewer than {LEAST_CELLS} cells along a side of the region of {size}, "
            f"which cannot resolve a flow: give at most {most:.3g} m, better a hundredth of the region, in metres"
        )
    with np.errstate(over="ignore"):
        nodes = float(np.prod(np.maximum(cells, 1.0) + 1.0))
    limit = min(NODE_LIMIT, host_memory() / BYTES_PER_NODE)
    if nodes > limit:
        least = float((extent.prod() / limit) ** (1.0 / len(extent)))
        raise ValueError(
            f"spacing {_text(step)} m needs {nodes:.3g} nodes in the region of {size}, more than the {limit:.2g} "
            f"that the memory takes: give a greater spacing or a smaller region; this region takes {least:.2g} m"
        )
    return np.maximum(cells, 1.0).astype(int) + 1


def _text(step: np.ndarray) -> str:
    steps = [f"{value:g}" for value in step]
    return steps[0] if len(set(steps)) == 1 else " by ".join(steps)
