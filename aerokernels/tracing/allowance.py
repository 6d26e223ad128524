"""How many steps a ray may take, and which tolerances make sense."""

import numpy as np

from ..medium import IndexField

# Average step, in cells, that a ray may need even where light runs along a ridge of a piecewise linear index.
FINEST = 0.02


def check_tolerance(tolerance: float) -> float:
    """The tolerance [waves], or a refusal of one that is not a positive number."""
    if not (np.isfinite(tolerance) and tolerance > 0.0):
        raise ValueError(f"tolerance must be positive (waves of OPD error), got {tolerance!r}")
    return tolerance


def step_allowance(field: IndexField, method: str, step, path_length) -> int:
    """Generous by a factor of ten over what a ray across the box needs, so that only trapped rays meet it."""
    diagonal = diagonal_of(field)
    if path_length is not None:
        diagonal = max(diagonal, path_length)
    finest = float(field.samples.paper_step.min()) if method == "paper" else float(np.min(field.spacing)) * FINEST
    if method == "fixed":
        finest = step
    return int(min(10.0 * diagonal / finest + 1000.0, 2_000_000_000.0))


def diagonal_of(field: IndexField) -> float:
    """The diagonal of the field's box [m]; an axis without ends counts as nothing."""
    low, high = field.box
    return float(np.linalg.norm(np.where(np.isfinite(high - low), high - low, 0.0)))
