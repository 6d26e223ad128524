"""Sums over a pupil's rays, which every backend computes alike, and the order of the rays."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.rays import Pupil
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.scheme import GROUP, REDUCTION_WIDTH
from aerokernels.tracing.stop import Plane
from aerokernels.tracing.tasks.quadrature import radial_points

# Per replicate: count, x, y, W, xx, xy, yy, xW, yW, WW over the rays that arrived, then the greatest step error and
# the field evaluations of all rays, and over those that arrived xq, yq, qq and qW with q = xx + yy.
MOMENT_COUNT = 16
GREATEST_ERROR = 10
# A row of sums: the moments, then real and imaginary part of the phasor.
SUM_COUNT = MOMENT_COUNT + 2
# Per-ray outputs of the tracer that the sums need, besides the status.
PUPIL_OUTPUTS = frozenset(("opd", "step_error", "evaluation_count"))


def replicate_seeds(seed: int | None, replicates: int) -> np.ndarray:
    """Seeds of the scramble, uint32, shape (replicates, 2): one for each axis of each replicate.

    They are the numbers of NumPy's Philox with the seed as its key, the lower half of each first.
    """
    has_key = seed is not None and not int(seed) >> 128
    generator = np.random.Philox(key=int(seed)) if has_key else np.random.Philox(seed)  # type: ignore[arg-type]
    numbers = np.asarray(generator.random_raw(replicates), "<u8")
    return numbers.view("<u4").reshape(replicates, 2)


@dataclass(frozen=True, eq=False)
class PupilTask:
    """A pupil to trace and sum: rays along the unit vector `look` to the plane `until`, in replicates.

    Phases are measured from a surface of the `terms` "tilt" and "focus". Rays are ordered by their distance from the
    pupil's centre alone with `by_radius`, lie along one of its radii with `is_radial`, or on a lattice of a `generator`
    (0: Sobol points).
    """

    field: IndexField
    pupil: Pupil
    look: np.ndarray
    until: Plane
    plan: TracePlan
    wavelength: float
    per_replicate: int
    replicates: int
    terms: tuple[str, ...] = ()
    by_radius: bool = False
    is_radial: bool = False
    generator: int = 0

    def points(self, seed: int | None) -> Any:
        """What a seed determines: seeds of the scramble (replicates, 2), or points and weights of radial quadrature."""
        if self.is_radial:
            return radial_points(self.per_replicate, self.replicates, seed)
        return replicate_seeds(seed, self.replicates)


@dataclass(eq=False)
class PupilSums:
    """The sums over a pupil's rays.

    Moments (replicates, MOMENT_COUNT), x and y in metres, and `total` of all replicates; phasors, exp(i k (OPD -
    surface)), (replicates,); and the number of rays that stay above the tolerance.
    """

    moments: np.ndarray
    phasors: np.ndarray
    ray_count: int
    rejected_count: int = 0

    def __post_init__(self) -> None:
        """Sum the replicates."""
        self.total: np.ndarray = np.add.reduce(self.moments, axis=0)

    @property
    def evaluation_count(self) -> int:
        """Field evaluations of all rays."""
        return int(self.total[11])

    @property
    def greatest_error(self) -> float:
        """The greatest error estimate of a ray that arrived [m]."""
        return float(self.moments[:, GREATEST_ERROR].max())

    @property
    def standard_error(self) -> float:
        """Standard error of the Strehl ratio from the spread of the replicates; nan where no ray arrived."""
        counts = self.moments[:, 0].tolist()
        if not any(counts):
            return float("nan")
        pairs = zip(self.phasors.tolist(), counts, strict=True)
        ratios = [abs(sum_ / count) ** 2 if count else 0.0 for sum_, count in pairs]
        mean = sum(ratios) / len(ratios)
        return math.sqrt(sum([(ratio - mean) ** 2 for ratio in ratios]) / (len(ratios) - 1) / len(ratios))


def holds_tolerance(sums: np.ndarray, task: PupilTask) -> bool:
    """Whether all rays that arrived are within the tolerance, by rows of sums; true without error control."""
    budget = task.plan.tolerance * task.wavelength
    return not task.plan.controls_error or all(error <= budget for error in sums[:, GREATEST_ERROR].tolist())


def point_order(count: int, by_radius: bool) -> np.ndarray:
    """An order of the first `count` Sobol points in which neighbours are close, int32, whatever their scramble.

    By the distance from the pupil's centre alone, for a field that is axisymmetric about it; otherwise by the angle in
    each of several rings.
    """
    index = np.arange(count, dtype=np.uint32)
    radius = _reverse_bits(index)
    if by_radius:
        order = np.argsort(radius, kind="stable")
    else:
        rings = max(0, int(np.log2(max(count, 1)) / 2.0 - 2.0))
        ring = radius >> np.uint32(32 - rings) if rings else np.zeros_like(radius)
        order = np.lexsort((_second_axis(index), ring))
    order = order.astype(np.int32)
    order.setflags(write=False)
    return order


def _reverse_bits(x: np.ndarray) -> np.ndarray:
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        x = ((x >> np.uint32(shift)) & np.uint32(mask)) | ((x & np.uint32(mask)) << np.uint32(shift))
    return (x >> np.uint32(16)) | (x << np.uint32(16))


def _second_axis(index: np.ndarray) -> np.ndarray:
    """Second coordinate of the Sobol points, as in the kernels."""
    result = np.zeros_like(index)
    column, rest = 0x80000000, index.copy()
    while rest.any():
        result ^= np.where(rest & np.uint32(1), np.uint32(column), np.uint32(0))
        column ^= column >> 1
        rest >>= np.uint32(1)
    return result


def radial_rays(pupil: Pupil, points: tuple[np.ndarray, np.ndarray], rows: slice) -> tuple[np.ndarray, ...]:
    """Starts [m] (n, 3), pupil coordinates (n, 2) and weights (n,) of rays at `radial_points` of some replicates."""
    squared, weight = (array[rows].reshape(-1, 1) for array in points)
    hole = (pupil.inner_ratio or 0.0) ** 2
    squared = hole + (1.0 - hole) * squared
    place = np.sqrt(squared)
    position = np.empty((len(place), 3))
    for column, along, origin in zip(position.T, pupil.axes[0], pupil.center, strict=True):
        np.multiply(pupil.reach * place[:, 0], along, out=column)  # twice as fast as by rows of three
        column += origin
    flat = np.zeros((len(place), 2))
    flat[:, :1] = place
    return position, flat, np.ascontiguousarray(weight[:, 0])


def group_count(per_replicate: int) -> int:
    """Number of groups in which a replicate's rays are summed."""
    return -(-per_replicate // GROUP)


def joined_counts(per_replicate: int) -> list[int]:
    """Rows of sums of a replicate: the number of its groups, then after each joining, down to one."""
    counts = [group_count(per_replicate)]
    while counts[-1] > 1:
        counts.append(-(-counts[-1] // REDUCTION_WIDTH))
    return counts


def batches_of(replicates: int, per_replicate: int) -> list[slice]:
    """Slices of the replicates that are traced together."""
    # Rays that are on a device together, in whole replicates: this number times the bytes of a ray bounds the memory
    # (speed only).
    size = max(1, (1 << 21) // per_replicate)  # speed only
    return [slice(first, min(first + size, replicates)) for first in range(0, replicates, size)]


# Coordinates of the surfaces are x, y and q = x^2 + y^2; these are the coordinates of each term.
COLUMNS = {"piston": (), "tilt": (0, 1), "focus": (2,)}
# The power of length in each of the moments.
LENGTHS = np.array([0, 1, 1, 0, 2, 2, 2, 1, 1, 0, 0, 0, 3, 3, 4, 2])
assert len(LENGTHS) == MOMENT_COUNT
# Moments that are zero where everything is symmetric about the axis.
ODD = np.array([1, 2, 5, 7, 8, 12, 13])


def fit_surface(moments: np.ndarray, terms: tuple[str, ...]) -> np.ndarray:
    """Height, two slopes and focus (4,) of the surface from which phases are measured, fitted to all replicates."""
    total = moments.sum(axis=0)
    slopes, _ = fit_terms(total, terms)
    height = total[3] / total[0] if total[0] else 0.0
    return np.array([height, *slopes])


def moments_in_metres(moments: np.ndarray, task: PupilTask) -> np.ndarray:
    """Convert moments (replicates, ..) in units of the pupil's reach; those along a radius to the whole disc's."""
    moments = moments.copy()
    moments[:, :MOMENT_COUNT] *= task.pupil.reach**LENGTHS
    if task.is_radial:
        moments[:, ODD] = 0.0
        moments[:, 4] *= 0.5
        moments[:, 6] = moments[:, 4]
    return moments


def fit_moments(total: np.ndarray) -> tuple[float, np.ndarray, float, float]:
    """Piston, tilt, rms about the piston and rms about the plane of a wavefront from its summed moments."""
    # In Python floats: for a symmetric pupil a few NumPy calls would take as long as the whole estimate.
    count, *sums = total[:10].tolist()
    if count == 0:
        return 0.0, np.zeros(2), 0.0, 0.0
    x, y, w, xx, xy, yy, xw, yw, ww = [number / count for number in sums]
    a, b, c = xx - x * x, xy - x * y, yy - y * y
    right, up = xw - x * w, yw - y * w
    determinant = a * c - b * b
    if determinant > 1e-12 * max(a, c) ** 2:
        along, across = (c * right - b * up) / determinant, (a * up - b * right) / determinant
    else:  # all points on one line, or a single point
        along, across = np.linalg.lstsq(np.array([[a, b], [b, c]]), np.array([right, up]), rcond=1e-12)[0].tolist()
    variance = max(ww - w * w, 0.0)
    about_plane = variance - along * right - across * up
    return w, np.array([along, across]), math.sqrt(variance), math.sqrt(max(about_plane, 0.0))


def fit_terms(total: np.ndarray, terms: tuple[str, ...]) -> tuple[np.ndarray, float]:
    """Fit a surface of these terms and the mean: slopes along x, y, x^2 + y^2, 0 for others, and the rms about it."""
    slopes = np.zeros(3)
    if "focus" not in terms:
        _, tilt, about_piston, about_plane = fit_moments(total)
        if "tilt" not in terms:
            return slopes, about_piston
        slopes[:2] = tilt
        return slopes, about_plane
    if total[0] == 0:
        return slopes, 0.0
    chosen = [column for term in terms for column in COLUMNS[term]]
    x, y, w, xx, xy, yy, xw, yw, ww = total[1:10] / total[0]
    xq, yq, qq, qw = total[12:16] / total[0]
    q = xx + yy
    mean = np.array([x, y, q])
    matrix = np.array([[xx, xy, xq], [xy, yy, yq], [xq, yq, qq]]) - np.outer(mean, mean)
    right = np.array([xw, yw, qw]) - mean * w
    size = math.sqrt(q) or 1.0  # the unit in which all columns are of similar size
    scale = np.array([size, size, size * size])
    matrix, right = matrix / np.outer(scale, scale), right / scale
    found = np.linalg.lstsq(matrix[np.ix_(chosen, chosen)], right[chosen], rcond=1e-12)[0]
    slopes[chosen] = found / scale[chosen]
    return slopes, math.sqrt(max(ww - w * w - float(found @ right[chosen]), 0.0))
