"""Which method "auto" takes: error control, or one step length where the field is smooth and weak all over.

Where the roughness of quiet.py is much the same everywhere, the one step that is safe for the roughest place costs less
than error control, which estimates each step's error with a margin and tries some steps twice. Predicted evaluations:

    fixed       3 L / H, H the safe step at the greatest roughness
    adaptive    OVERHEAD 3 int dl / (safe step there) + FIRST, both set by hand after traces of five fields

A fixed step is taken where it costs at most MARGIN times as much (its error is then the smaller one), the rays are
nearly straight, and nothing lies in the field that a step could jump over: no body, no kinks. The error of a ray's
direction, which error control weighs by how far off and at what slant the stop is met, must not count either.
"""

from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import RayBundle
from .quiet import CONES, SHARE, cones_of, reach, roughness_along, smooth_step
from .scheme import LEAST_COSINE
from .stop import Plane

OVERHEAD = 1.5
FIRST = 15.0
MARGIN = 1.25
# Evaluations a cell where the interpolant has kinks between cells, by hand after the same fields.
KINKED_COST = {"linear": 2.0, "monotone": 3.0, "bilinear": 12.0}
# Greatest turn of a ray along the box for which a field is weak [rad].
WEAK = 0.02
# Greatest lever of a direction's error for which a fixed step may be taken, in extents of the field: see `lever_of`.
GREATEST_LEVER = 1.0
# A fixed step is at most this share of the box, so that every ray through it takes a few.
LONGEST = 0.125


@dataclass(frozen=True)
class Choice:
    """A method, the step of "fixed" [m], why, and the evaluations predicted for a ray across the box."""

    method: str
    step: float | None
    reason: str
    evaluations: float


def lever_of(rays: RayBundle, until) -> float:
    """By how much an error of their direction lengthens or shortens rays to a plane that they meet at a slant, at most.

    It is the way to the plane times the tangent of the angle at which it is met [m/rad]; 0 for other stops.
    """
    if not isinstance(until, Plane):
        return 0.0
    cosine = np.abs(rays.direction @ until.normal)
    height = np.abs((rays.position - until.point) @ until.normal)
    tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, LEAST_COSINE)
    return float((tangent * height / np.maximum(cosine, LEAST_COSINE)).max())


def choose_method(field: IndexField, budget: float, directions: np.ndarray, lever: float = 0.0) -> Choice:
    """The method for rays of these directions, `budget` the OPD error allowed for a ray [m], `lever` by `lever_of`."""
    if not isinstance(field.samples, UniformGrid):
        low, high = field.box
        across = float(np.linalg.norm(np.where(np.isfinite(high - low), high - low, 0.0)))
        cost = KINKED_COST["bilinear"] * across / float(np.median(field.samples.mesh.cell_size))
        return Choice("adaptive", None, "method adaptive: on a mesh error control holds the tolerance", cost)
    grid = field.samples
    extent = float(np.linalg.norm(grid.high - grid.low))
    if field.interpolation != "cubic":
        why = f"method adaptive: the kinks of the {field.interpolation} interpolant are met face by face"
        cells = float(np.sum((grid.high - grid.low) / grid.spacing))
        return Choice("adaptive", None, why, KINKED_COST[field.interpolation] * cells)
    step, adaptive = LONGEST * extent, 0.0
    for number in np.unique(cones_of(directions, field.geometry)):
        cone = CONES[number]
        roughest = float(roughness_along(grid, field.geometry, cone)[1].max())
        step = min(step, float(smooth_step(roughest, SHARE * budget / extent)))
        safe = np.clip(reach(grid, field.geometry, budget, cone).length, 2.0 * grid.spacing.min(), extent)
        adaptive = max(adaptive, OVERHEAD * 3.0 * extent * float(np.mean(1.0 / safe)) + FIRST)
    if lever > GREATEST_LEVER * extent:
        why = "method adaptive: a plane that is far off and met at a slant needs directions that error control holds"
        return Choice("adaptive", None, why, adaptive)
    turn = greatest_turn(grid)
    if field.body is not None:
        return Choice("adaptive", None, "method adaptive: a fixed step could jump over the body", adaptive)
    if turn > WEAK:
        why = f"method adaptive: rays may turn by {turn:.2g} rad, error control holds them"
        return Choice("adaptive", None, why, adaptive)
    fixed = 3.0 * extent / step
    costs = f"predicted along the diagonal {fixed:.0f} evaluations with fixed steps, {adaptive:.0f} with error control"
    if fixed <= MARGIN * adaptive:
        why = f"method fixed, steps of {step:.3g} m: the field is smooth and weak all over, {costs}"
        return Choice("fixed", step, why, fixed)
    return Choice("adaptive", None, f"method adaptive: the field is rough in places, {costs}", adaptive)


def greatest_turn(grid: UniformGrid) -> float:
    """A bound on the angle by which a ray across the box can turn [rad]."""
    steepest = max(
        float(np.abs(np.diff(grid.samples, axis=axis)).max()) / grid.spacing[axis] for axis in range(grid.samples.ndim)
    )
    return steepest * float(np.linalg.norm(grid.high - grid.low)) / grid.ambient_index
