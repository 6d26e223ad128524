"""Compute the return factor of every target point: the fraction of its light that the flow transmits to the receiver.

By reciprocity rays are launched from the pupil toward the target point T and traced to a plane just ahead of the flow;
from there on the path is straight: OPD = opd at the plane + n_ambient (|T - r| - |T - r0|), where the disturbed and the
undisturbed ray cross the plane at r and r0. The deflected ray misses T, an effect of second order (Fermat), 3e-4 wave
at 100 urad. The factor is computed at Chebyshev-Lobatto points on the target and interpolated between them.
"""

import math
from dataclasses import dataclass

import numpy as np

from aerokernels.lidar.parts import EVERY, Setup
from aerokernels.medium import IndexField
from aerokernels.pupils.base import lengths
from aerokernels.rays import Pupil, RayBundle
from aerokernels.tracing import Plane, TraceResult, trace

CLEARANCE = 1e-6  # [m] of the stop plane ahead of the flow's box, clear of rounding at the box's face
CHUNK_RAYS = 1 << 18  # at most 100 MB with the tracer's arrays: speed only


@dataclass(frozen=True, eq=False)
class PupilSums:
    """Sums over the rays between some target points and the pupil.

    Attributes:
        open_share: Fraction of the pupil that each point's rays reach, 0 to 1, shape (k,).
        phasor: Sum of w exp(i k OPD) over those rays, complex, shape (k,).
        ray_count: Rays traced.
        evaluation_count: Field evaluations.
        seconds: Time in kernels [s].
    """

    open_share: np.ndarray
    phasor: np.ndarray
    ray_count: int = 0
    evaluation_count: int = 0
    seconds: float = 0.0

    @property
    def strehl(self) -> np.ndarray:
        """Exact Strehl ratio of the open part of the pupil, tilt not removed; 0 if nothing is open, shape (k,)."""
        open_share = np.where(self.open_share > 0.0, self.open_share, 1.0)
        return np.abs(self.phasor / open_share) ** 2


@dataclass(frozen=True, eq=False)
class ReturnPaths:
    """The return paths, one per intersection with the target; NaN if there is no intersection or no traced ray.

    Attributes:
        factor: The return factor, 0 to 1, shape (m,).
        strehl: Strehl ratio of the open part of the pupil, shape (m,).
        open_share: Fraction of the pupil that the point's rays reach, shape (m,).
        pair_count: Pairs of target point and pupil point that the sums represent.
        sums: The sums over the rays.
    """

    factor: np.ndarray
    strehl: np.ndarray
    open_share: np.ndarray
    pair_count: int
    sums: PupilSums


def return_paths(setup: Setup, field: IndexField, intersection: np.ndarray, symmetry: bool = True) -> ReturnPaths:
    """Return the return factor at the intersections [m], (m, 3), of rays with the target; NaN for rays without one.

    "strehl" is the fraction of the receiver's pupil that the point's rays reach, times the Strehl ratio over that part,
    tilt kept, piston removed (the paper's factor); "bucket" that fraction alone, for a detector larger than the spot;
    "none" 1. With symmetry about the axis the points are on one radius, and half of the pupil represents all of it.
    """
    receiver, plane = setup.receiver, setup.plane
    kind, node_count = receiver.return_factor, receiver.strehl_node_count
    arrived = np.isfinite(intersection).all(axis=1)
    unknown = np.full(len(intersection), np.nan)
    if kind == "none":
        nothing = PupilSums(np.zeros(0), np.zeros(0))
        return ReturnPaths(np.where(arrived, 1.0, np.nan), unknown, unknown.copy(), 0, nothing)
    pupil = receiver.pupil.sample(receiver.ray_count, "gauss")
    place = intersection[arrived]
    if node_count == EVERY:
        sums = reduce_pupils(setup, field, place, *pupil)
        values = [sums.strehl, sums.open_share]
        pair_count = sums.ray_count
    elif symmetry and is_symmetric(field, plane, receiver.pupil):
        sums, values = _along_a_radius(setup, field, place, pupil, int(node_count))
        pair_count = int(node_count) ** 2 * len(pupil[0])
    else:
        sums, values = _over_the_target(setup, field, place, pupil, int(node_count))
        pair_count = sums.ray_count
    strehl, open_share = unknown, unknown.copy()
    strehl[arrived], open_share[arrived] = (np.clip(each, 0.0, 1.0) for each in values)
    return ReturnPaths(factor_of(kind, strehl, open_share), strehl, open_share, pair_count, sums)


def is_symmetric(field: IndexField, plane: Plane, pupil: Pupil) -> bool:
    """Return whether field, target and pupil, and so the return paths, are symmetric about the axis."""
    faces_axis = float(np.hypot(plane.normal[0], plane.normal[1])) < 1e-12
    return field.geometry == "axisymmetric" and faces_axis and pupil.inner_ratio is not None


def factor_of(kind: str, strehl: np.ndarray, open_share: np.ndarray) -> np.ndarray:
    """Return the return factor "strehl" or "bucket" of Strehl ratios and open shares."""
    return open_share * strehl if kind == "strehl" else open_share


def upper_half(start: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the half of a pupil's points that represents all of them if y and -y are equivalent."""
    edge = 1e-9 * np.abs(start[:, :2]).max()
    upper = start[:, 1] >= -edge
    return start[upper], np.where(np.abs(start[upper, 1]) <= edge, 1.0, 2.0) * weight[upper]


def _along_a_radius(setup, field, place, pupil, node_count: int) -> tuple[PupilSums, list[np.ndarray]]:
    """Sum at points on one radius, and interpolate by an even polynomial in the intersections' distance to the axis."""
    node = _lobatto(node_count)
    reach = max(float(np.hypot(place[:, 0], place[:, 1]).max()), 1e-9)
    half = node_count // 2
    target = np.zeros((half + 1, 3))
    target[:, 0], target[:, 2] = reach * node[half:], place[0, 2]
    sums = reduce_pupils(setup, field, target, *upper_half(*pupil))
    # The middle node is on the axis; the nodes before it mirror the nodes after it.
    tables = [np.concatenate([values[:0:-1], values]) for values in (sums.strehl, sums.open_share)]
    distance = np.hypot(place[:, 0], place[:, 1])[:, None] / reach
    return sums, [interpolate_polynomial(table, node, distance) for table in tables]


def _over_the_target(setup, field, place, pupil, node_count: int) -> tuple[PupilSums, list[np.ndarray]]:
    """Sum at a grid of points over the rectangle around the intersections, and interpolate by a polynomial."""
    node, plane = _lobatto(node_count), setup.plane
    low, high = place[:, :2].min(axis=0), place[:, :2].max(axis=0)
    center, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-9)
    x, y = np.meshgrid(center[0] + half[0] * node, center[1] + half[1] * node, indexing="ij")
    rise = ((x - plane.point[0]) * plane.normal[0] + (y - plane.point[1]) * plane.normal[1]) / plane.normal[2]
    target = np.stack([x, y, plane.point[2] - rise], axis=-1).reshape(-1, 3)
    sums = reduce_pupils(setup, field, target, *pupil)
    tables = [values.reshape(node_count, node_count) for values in (sums.strehl, sums.open_share)]
    return sums, [interpolate_polynomial(table, node, (place[:, :2] - center) / half) for table in tables]


def _lobatto(count: int) -> np.ndarray:
    return -np.cos(math.pi * np.arange(count) / (count - 1))


def interpolate_polynomial(table: np.ndarray, node: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Evaluate the polynomial through a table, (k,) or (k, k), at nodes (k,) in [-1, 1], at places (m, its axes)."""
    from numpy.polynomial.chebyshev import chebvander

    degree = len(node) - 1
    to_coefficients = np.linalg.inv(chebvander(node, degree))
    bases = [chebvander(place[:, axis], degree) @ to_coefficients for axis in range(table.ndim)]
    if table.ndim == 1:
        return bases[0] @ table
    return np.einsum("pi,ij,pj->p", bases[0], table, bases[1])


def reduce_pupils(
    setup: Setup, index: IndexField, target: np.ndarray, start: np.ndarray, weight: np.ndarray
) -> PupilSums:
    """Trace rays between target points [m], (k, 3), and pupil points [m], (n, 3), and sum them over the pupil.

    Millions of pairs would not fit in memory as rays: they are traced in chunks, and two sums per target point are
    kept. A target that is not ahead of the flow, or no ray that gets out, is a ValueError.
    """
    check_ahead(index, target)
    wave_number = 2.0 * np.pi / setup.laser.wavelength
    open_share, phasor = np.zeros(len(target)), np.zeros(len(target), dtype=np.complex128)
    evaluation_count, seconds = 0, 0.0
    ray_count = len(target) * len(start)
    for first in range(0, ray_count, CHUNK_RAYS):
        # Ray r connects target point r // n with pupil point r % n; a chunk may begin or end within a pupil.
        of_target, of_pupil = np.divmod(np.arange(first, min(first + CHUNK_RAYS, ray_count)), len(start))
        opd, result = _trace_rays(setup, index, start[of_pupil], target[of_target])
        share = np.where(result.ok, weight[of_pupil], 0.0)
        begin, end = of_target[0], of_target[-1] + 1
        light = share * np.exp(1j * wave_number * opd)
        open_share[begin:end] += np.bincount(of_target - begin, share)
        phasor[begin:end] += np.bincount(of_target - begin, light.real)
        phasor[begin:end] += 1j * np.bincount(of_target - begin, light.imag)
        assert result.evaluation_count is not None  # a requested output
        evaluation_count += int(result.evaluation_count.sum())
        seconds += result.seconds["kernel"]
    if not open_share.any():
        raise ValueError(
            f"no ray of the receiver's pupil gets out toward the target ({result.status_summary()}): "
            "check receiver.aperture_z and receiver.diameter against the body"
        )
    return PupilSums(open_share, phasor, ray_count, evaluation_count, seconds)


def check_ahead(index: IndexField, target: np.ndarray) -> None:
    """Check that target points [m], shape (k, 3), are ahead of the field's box."""
    front = float(index.box[1][2])
    if target[:, 2].min() <= front + CLEARANCE:
        raise ValueError(
            f"the target reaches back to z = {target[:, 2].min():g} m, into the flow's box, which ends at {front:g} m: "
            "give a greater target.distance or a smaller tilt, or cut the field off ahead of the target"
        )


def _trace_rays(
    setup: Setup, index: IndexField, position: np.ndarray, point: np.ndarray
) -> tuple[np.ndarray, TraceResult]:
    """Return the OPD [m] of rays from pupil points to target points, shape (m,), 0 for failed rays; and the trace."""
    rays = RayBundle(position, point - position)
    stop_z = max(float(index.box[1][2]), setup.receiver.aperture_z) + CLEARANCE
    stop = Plane(np.array([0.0, 0.0, stop_z]), np.array([0.0, 0.0, 1.0]))
    wanted = ("position", "opd", "evaluation_count")
    result = trace(index, rays, until=stop, outputs=wanted, **setup.options)
    assert result.position is not None and result.opd is not None  # requested outputs
    undisturbed = rays.position + ((stop_z - rays.position[:, 2]) / rays.direction[:, 2])[:, None] * rays.direction
    detour = lengths(point - result.position) - lengths(point - undisturbed)
    return np.where(result.ok, result.opd + index.ambient_index * detour, 0.0), result
