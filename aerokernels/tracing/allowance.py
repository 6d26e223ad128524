"""Bound the number of steps of a ray."""

import numpy as np

from ..medium import IndexField
from .lines import box_size

# Average step in cells that a ray may need where it runs along a ridge of a piecewise linear index.
FINEST = 0.02


def step_allowance(field: IndexField, method: str, step, path_length) -> int:
    """The greatest number of steps: ten times the need of a ray across the box, so that only trapped rays reach it."""
    diagonal = box_size(field)
    if path_length is not None:
        diagonal = max(diagonal, path_length)
    finest = float(field.samples.paper_step.min()) if method == "paper" else float(np.min(field.spacing)) * FINEST
    if method == "fixed":
        finest = step
    return int(min(10.0 * diagonal / finest + 1000.0, 2_000_000_000.0))
