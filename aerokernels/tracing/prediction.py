"""Predict the number of field evaluations under error control, before any ray is traced.

    evaluations   OVERHEAD 3 int dl / (step bound there) + FIRST along the diagonal of the box

with the step bounds of step_bound.py; OVERHEAD and FIRST were fitted to traces of five fields.
"""

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from .lines import box_size
from .step_bound import CONES, cones_of, step_bound

OVERHEAD = 1.5
FIRST = 15.0
# Nodes whose differences are in memory together.
SLAB = 1 << 17  # speed only
# Evaluations for each cell where the interpolant has kinks between cells, fitted to the same fields.
PIECEWISE_SMOOTH_COST = {"linear": 2.0, "monotone": 3.0, "bilinear": 3.0}


def predict_evaluations(field: IndexField, budget: float, directions: np.ndarray) -> float:
    """Predict the field evaluations of a ray across the box under error control.

    Args:
        field: The refractive index.
        budget: OPD error allowed for a ray [m].
        directions: Unit vectors of the rays, shape (ray_count, 3).
    """
    if not isinstance(field.samples, UniformGrid):
        return PIECEWISE_SMOOTH_COST["bilinear"] * box_size(field) / float(np.median(field.samples.mesh.cell_size))
    grid = field.samples
    if field.interpolation != "cubic":
        return PIECEWISE_SMOOTH_COST[field.interpolation] * float(np.sum((grid.high - grid.low) / grid.spacing))
    extent = float(np.linalg.norm(grid.high - grid.low))
    evaluations = 0.0
    for number in np.unique(cones_of(directions, field.geometry)):
        safe = np.clip(step_bound(grid, field.geometry, budget, CONES[number]).length, 2.0 * grid.spacing.min(), extent)
        evaluations = max(evaluations, OVERHEAD * 3.0 * extent * float(np.mean(1.0 / safe)) + FIRST)
    return evaluations


@cached_on("grid")
def greatest_turn(grid: UniformGrid) -> float:
    """A bound on the angle by which a ray across the box can turn [rad], cached on the grid."""
    samples, steepest = grid.samples, 0.0
    rows = max(1, SLAB * len(samples) // samples.size)
    for first in range(0, len(samples), rows):
        slab = samples[first : first + rows + 1]  # with the first row of the next one
        for axis, spacing in enumerate(grid.spacing):
            steepest = max(steepest, float(np.abs(np.diff(slab, axis=axis)).max(initial=0.0)) / spacing)
    return steepest * float(np.linalg.norm(grid.high - grid.low)) / grid.ambient_index
