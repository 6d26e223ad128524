"""Bound the length of a step at each place, so that nothing between its samples is missed: docs/theory/step-control.md.

    H <= (SHARE budget / (C L G))^(1/4)       and, at kinks,      K / 12 <= KINK_SHARE budget / L

on a path of length L, with the greatest fourth derivative G of the potential and kink K of its slope times the spacing
that a ray can meet within H. Along a direction u of a structure with one normal, G is (sum |u_i| G_i^(1/4))^4.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from .blocks import axis_back, axis_first, block_maxima, by_slabs, greatest_around
from .lines import box_size

BLOCK = 4
BLOCK_COUNT_LIMIT = 300_000
# Above 1, since the formula's own constant is far below C on smooth fields (it is exact to degree four) and errors of
# steps differ in sign; chosen so that tolerances still held on smooth fields and shocks (trials are in
# docs/decisions.md).
SHARE = 12.0
# Kinks may all deflect to one side: their errors add up.
KINK_SHARE = 0.05
# The deflection of a ray up to which the table is valid [rad].
TURN = 0.02
# Sines of the angles with a coordinate axis within which rays look ahead in a cone; other rays use all directions.
CONE_SINES = (0.02, 0.2)


@dataclass(frozen=True)
class Cone:
    """A cone of directions about a coordinate axis, chosen by a ray's first direction; axis None: all directions."""

    axis: int | None
    sign: float
    spread: float  # half angle [rad]

    @property
    def axis_vector(self) -> np.ndarray:
        """Unit vector along the axis."""
        way = np.zeros(3)
        if self.axis is not None:
            way[self.axis] = self.sign
        return way


# The cones by number: all directions, then one for each axis, each sign, each sine of CONE_SINES. Kernels use these
# numbers too.
CONES = (
    Cone(None, 0.0, np.pi),
    *(
        Cone(axis, sign, float(np.arcsin(sine)) + TURN)
        for axis in range(3)
        for sign in (1.0, -1.0)
        for sine in CONE_SINES
    ),
)


def cones_of(directions: np.ndarray, geometry: str) -> np.ndarray:
    """Numbers in CONES of unit vectors (n, 3), shape (n,)."""
    size = np.abs(directions)
    axis = np.argmax(size, axis=1)
    rows = np.arange(len(directions))
    ahead = directions[rows, axis]
    square = np.sum(directions**2, axis=1) - ahead**2
    level = np.searchsorted(np.array(CONE_SINES) ** 2, square)
    number = 1 + (2 * axis + (ahead < 0.0)) * len(CONE_SINES) + level
    usable = level < len(CONE_SINES)
    if geometry != "volume":
        # A step along x, or across the axis of symmetry, is not a straight line in the plane of the samples.
        usable &= axis == 2 if geometry == "axisymmetric" else axis > 0
    return np.where(usable, number, 0)


@dataclass(frozen=True, eq=False)
class StepBound:
    """Safe steps [m], one array axis per axis of the grid, each entry for a block of `block` cells a side."""

    length: np.ndarray
    block: int


@cached_on("grid", 32)
def step_bound(grid: UniformGrid, geometry: str, budget: float, cone: Cone) -> StepBound:
    """The table of step bounds for rays of a cone, by the OPD error allowed [m]; zero where STEP_LIMIT applies."""
    block, smooth, kink = roughness_along(grid, geometry, cone)
    way = _local(cone.axis_vector, geometry)
    extent = float(np.linalg.norm(grid.high - grid.low))
    rate = budget / extent
    size = block * grid.spacing
    result = np.zeros(smooth.shape)
    least = float(size.min())
    seen = np.zeros(smooth.shape)
    seen_kink = np.zeros(smooth.shape)
    near, far, is_kinked = 0.0, least, bool(kink.any())
    while near < extent:
        low, high = _window(near, far, size, way, cone)
        np.maximum(seen, greatest_around(smooth, low, high), out=seen)
        if is_kinked:
            np.maximum(seen_kink, greatest_around(kink, low, high), out=seen_kink)
        with np.errstate(divide="ignore", over="ignore"):
            # The error constant of a rule that is exact for cubics, with room for knots anywhere in the step.
            bound = np.divide(SHARE * rate, (1.0 / 720.0) * seen) ** 0.25
        allowed = np.where(seen_kink / 12.0 <= KINK_SHARE * rate, np.minimum(bound, far), 0.0)
        np.maximum(result, allowed, out=result)
        if not (allowed >= far).any():
            break
        near, far = far, far + max(least, 0.15 * far)
    return StepBound(result, block)


def roughness_along(grid: UniformGrid, geometry: str, cone: Cone) -> tuple[int, np.ndarray, np.ndarray]:
    """Cells in a block, and each block's greatest fourth derivative [1/m4] and kink [1] along the cone's rays."""
    block, fourth, second = roughness_of_blocks(grid)
    if cone.axis is None:
        return block, np.sum([np.sqrt(g) for g in fourth], axis=0) ** 2, np.sum(second, axis=0)
    share = np.minimum(np.abs(_local(cone.axis_vector, geometry)) + np.sin(cone.spread), 1.0)
    smooth = np.sum([w * g**0.25 for w, g in zip(share, fourth, strict=True)], axis=0) ** 4
    kink = np.sum([w * np.sqrt(k) for w, k in zip(share, second, strict=True)], axis=0) ** 2
    return block, smooth, kink


@cached_on("grid")
def roughness_of_blocks(grid: UniformGrid) -> tuple[int, list[np.ndarray], list[np.ndarray]]:
    """Cells in a block, and in each the potential's greatest fourth derivative [1/m4] and kink [1] along each axis."""
    block = block_size(grid)
    fourth, second = [], []
    _ = grid.coefficients  # made once, not by each thread
    for axis in range(grid.samples.ndim):
        of_slab = partial(_roughness_of_slab, grid, axis, block)
        found = by_slabs(of_slab, grid.shape, block, 1 if axis == 0 else 0)
        fourth.append(np.divide(found[0], grid.spacing[axis] ** 4, dtype=np.float64))
        second.append(found[1].astype(np.float64))
    return block, fourth, second


def potential_at_nodes(grid: UniformGrid, nodes: Any = ...) -> np.ndarray:
    """The potential over the ambient index at some nodes, float64; it equals the contrast where that is small."""
    return grid.potential_of(grid.samples[nodes]) / grid.ambient_index


def _local(way: np.ndarray, geometry: str) -> np.ndarray:
    return {"volume": way, "planar": way[1:], "axisymmetric": np.array([0.0, way[2]])}[geometry]


def _window(near: float, far: float, size: np.ndarray, way: np.ndarray, cone: Cone) -> tuple[np.ndarray, np.ndarray]:
    """Offsets, in blocks along each axis, of everything that rays from a block meet between `near` and `far` ahead."""
    if cone.axis is None:
        half = np.ceil(far / size).astype(int)
        return -half, half
    wide = far * np.tan(cone.spread) / size
    ends = np.stack([near * way / size, far * way / size])
    return np.floor(ends.min(axis=0) - wide).astype(int), np.floor(ends.max(axis=0) + wide + 1.0).astype(int)


def block_size(grid: UniformGrid) -> int:
    """Cells in a block along each axis."""
    block = BLOCK
    while np.prod((np.array(grid.shape) - 2) // block + 1, dtype=np.float64) > BLOCK_COUNT_LIMIT:
        block *= 2
    return block


def _roughness_of_slab(grid: UniformGrid, axis: int, block: int, slab: slice) -> np.ndarray:
    """Greatest fourth differences along an axis, and kinks, of the blocks in a slab."""
    nodes = _stretched(grid, axis, slab)  # in the grid's own memory order, with that axis first
    nodes /= grid.ambient_index
    fourth = block_maxima(axis_back(np.abs(np.diff(nodes, 4, axis=0)), axis), block)
    if grid.interpolation == "cubic":
        return np.stack([fourth, np.zeros_like(fourth)])
    return np.stack([fourth, block_maxima(axis_back(np.abs(np.diff(nodes[1:-1], 2, axis=0)), axis), block)])


def _stretched(grid: UniformGrid, axis: int, slab: slice) -> np.ndarray:
    """Values whose differences along an axis bound the potential's: two more than nodes at each end, axis first."""
    if grid.interpolation == "cubic":
        # The coefficients already have one entry beyond each end.
        others = tuple(slice(None) if a == axis else slice(1, -1) for a in range(grid.samples.ndim))
        inner, missing = axis_first(grid.coefficients[others], axis)[:, slab], 1
    else:
        inner, missing = grid.potential_of(axis_first(grid.samples, axis)[:, slab]), 2
    high = _continued(inner[::-1], missing)[::-1]
    if grid.even_first_axis and axis == 0:
        centre = 2 - missing
        mirrored = [inner[min(centre + k, len(inner) - 1)] for k in range(2, centre, -1)]
        low = np.stack(mirrored)
    else:
        low = _continued(inner, missing)
    shape = list(inner.shape)
    shape[0] += len(low) + len(high)
    stretched = axis_first(np.empty((*shape[1 : axis + 1], shape[0], *shape[axis + 1 :]), inner.dtype), axis)
    stretched[: len(low)], stretched[len(low) : shape[0] - len(high)] = low, inner
    stretched[shape[0] - len(high) :] = high
    return stretched


def _continued(values: np.ndarray, count: int) -> np.ndarray:
    """`count` entries ahead of the first, on the cubic through the first four (lower degree if there are fewer)."""
    rule = {1: [1.0], 2: [2.0, -1.0], 3: [3.0, -3.0, 1.0]}.get(len(values), [4.0, -6.0, 4.0, -1.0])
    ahead, made = values[: len(rule)], values[:0]
    for _ in range(count):
        before = np.tensordot(rule, ahead[: len(rule)], 1)[None]
        made = np.concatenate([before, made])
        ahead = np.concatenate([before, ahead]) if len(made) < count else ahead
    return made


OVERHEAD = 1.5
FIRST = 15.0
# Evaluations for each cell where the interpolant has kinks between cells, fitted to the same fields.
PIECEWISE_SMOOTH_COST = {"linear": 2.0, "monotone": 3.0, "bilinear": 3.0}


def predict_evaluations(field: IndexField, budget: float, directions: np.ndarray) -> float:
    """Predict the field evaluations of a ray across the box under error control with so much OPD error allowed [m].

    OVERHEAD 3 int dl / (step bound there) + FIRST along the diagonal of the box, fitted to traces of five fields.
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
    # Nodes whose differences are in memory together (speed only).
    rows = max(1, (1 << 17) * len(samples) // samples.size)
    for first in range(0, len(samples), rows):
        slab = samples[first : first + rows + 1]  # with the first row of the next one
        for axis, spacing in enumerate(grid.spacing):
            steepest = max(steepest, float(np.abs(np.diff(slab, axis=axis)).max(initial=0.0)) / spacing)
    return steepest * float(np.linalg.norm(grid.high - grid.low)) / grid.ambient_index


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
