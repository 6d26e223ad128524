"""Compute the return factor of every target point: the fraction of its light that the flow transmits to the receiver.

"strehl"  the fraction of the receiver's pupil that the point's rays reach, times the Strehl ratio over that part, tilt
          kept, piston removed (the paper's factor; a Strehl ratio is a peak intensity, not a power)
"bucket"  that fraction alone: all light that reaches the pupil falls on a detector larger than the spot. Refraction
          moves light into the pupil or out of it only by focusing, some 1e-4 here, which is neglected
"none"    1, and no ray is traced

Fraction and Strehl ratio vary smoothly over the target. They are computed at Chebyshev-Lobatto points on the target and
interpolated by the polynomial through them. If field, pupil and target are symmetric about the axis, both depend on the
distance from the axis alone: the points are then on one radius, and half of the pupil represents all of it.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..inputs.kinds import as_whole
from ..medium import IndexField
from ..rays import Pupil
from ..scene import Scene
from ..tracing import Plane
from .pupil_reduction import PupilSums, receiver_pupil, reduce_pupils, upper_half

EVERY = "every"


@dataclass(frozen=True, eq=False)
class ReturnPaths:
    """The return paths, one per intersection with the target; NaN if there is no intersection or no traced ray.

    Attributes:
        factor: The return factor, 0 to 1, shape (m,).
        strehl: Strehl ratio of the open part of the pupil, shape (m,).
        open_share: Fraction of the pupil that the point's rays reach, shape (m,).
        pair_count: Pairs of target point and pupil point that the sums represent.
        sums: The sums over the rays; None for factor "none".
    """

    factor: np.ndarray
    strehl: np.ndarray
    open_share: np.ndarray
    pair_count: int = 0
    sums: PupilSums | None = None


def return_paths(
    scene: Scene,
    field: IndexField,
    intersection: np.ndarray,
    plane: Plane,
    node_count: int | str = 9,
    symmetry: bool = True,
) -> ReturnPaths:
    """Return the return factor at the intersections of rays with the target.

    Args:
        scene: The scene.
        field: The refractive index.
        intersection: Where rays meet the target [m], shape (m, 3); NaN for rays that do not.
        plane: The target's plane.
        node_count: Number of points along each side of the target at which the factor is computed, odd and at least 3;
            "every": at all intersections.
        symmetry: Whether to use the symmetry about the axis if there is one.

    Raises:
        ValueError: As `reduce_pupils`; also a `node_count` that is even or too small.
    """
    if node_count != EVERY:
        whole = as_whole(node_count)
        if whole is None or whole < 3 or whole % 2 == 0:
            raise ValueError(f"strehl_node_count must be odd and at least 3, or {EVERY!r}, got {node_count!r}")
        node_count = whole
    kind = scene.receiver.return_factor
    arrived = np.isfinite(intersection).all(axis=1)
    unknown = np.full(len(intersection), np.nan)
    if kind == "none":
        return ReturnPaths(np.where(arrived, 1.0, np.nan), unknown, unknown.copy())
    pupil = receiver_pupil(scene)
    place = intersection[arrived]
    if node_count == EVERY:
        sums = reduce_pupils(scene, field, place, *pupil)
        found = [sums.strehl, sums.open_share]
        pair_count = sums.ray_count
    elif symmetry and is_symmetric(field, plane, scene.receiver.pupil):
        sums, found = _along_a_radius(scene, field, place, pupil, int(node_count))
        pair_count = int(node_count) ** 2 * len(pupil[0])
    else:
        sums, found = _over_the_target(scene, field, place, plane, pupil, int(node_count))
        pair_count = sums.ray_count
    strehl, open_share = unknown, unknown.copy()
    strehl[arrived], open_share[arrived] = (np.clip(values, 0.0, 1.0) for values in found)
    return ReturnPaths(factor_of(kind, strehl, open_share), strehl, open_share, pair_count, sums)


def is_symmetric(field: IndexField, plane: Plane, pupil: Pupil) -> bool:
    """Return whether field, target and pupil, and so the return paths, are symmetric about the axis."""
    faces_axis = float(np.hypot(plane.normal[0], plane.normal[1])) < 1e-12
    return field.geometry == "axisymmetric" and faces_axis and pupil.inner_ratio is not None


def factor_of(kind: str, strehl: np.ndarray, open_share: np.ndarray) -> np.ndarray:
    """Return the return factor "strehl" or "bucket" of Strehl ratios and open shares."""
    return open_share * strehl if kind == "strehl" else open_share


def _along_a_radius(scene, field, place, pupil, node_count: int) -> tuple[PupilSums, list[np.ndarray]]:
    """Sum at points on one radius, and interpolate by an even polynomial in the intersections' distance to the axis."""
    node = _lobatto(node_count)
    reach = max(float(np.hypot(place[:, 0], place[:, 1]).max()), 1e-9)
    half = node_count // 2
    target = np.zeros((half + 1, 3))
    target[:, 0], target[:, 2] = reach * node[half:], place[0, 2]
    sums = reduce_pupils(scene, field, target, *upper_half(*pupil))
    # The middle node is on the axis; the nodes before it mirror the nodes after it.
    tables = [np.concatenate([values[:0:-1], values]) for values in (sums.strehl, sums.open_share)]
    distance = np.hypot(place[:, 0], place[:, 1])[:, None] / reach
    return sums, [interpolate_polynomial(table, node, distance) for table in tables]


def _over_the_target(scene, field, place, plane, pupil, node_count: int) -> tuple[PupilSums, list[np.ndarray]]:
    """Sum at a grid of points over the rectangle around the intersections, and interpolate by a polynomial."""
    node = _lobatto(node_count)
    low, high = place[:, :2].min(axis=0), place[:, :2].max(axis=0)
    center, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-9)
    x, y = np.meshgrid(center[0] + half[0] * node, center[1] + half[1] * node, indexing="ij")
    rise = ((x - plane.point[0]) * plane.normal[0] + (y - plane.point[1]) * plane.normal[1]) / plane.normal[2]
    target = np.stack([x, y, plane.point[2] - rise], axis=-1).reshape(-1, 3)
    sums = reduce_pupils(scene, field, target, *pupil)
    tables = [values.reshape(node_count, node_count) for values in (sums.strehl, sums.open_share)]
    return sums, [interpolate_polynomial(table, node, (place[:, :2] - center) / half) for table in tables]


def _lobatto(count: int) -> np.ndarray:
    return -np.cos(math.pi * np.arange(count) / (count - 1))


def interpolate_polynomial(table: np.ndarray, node: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Evaluate the polynomial through a table at nodes in [-1, 1].

    Args:
        table: Values, shape (k,) or (k, k).
        node: Nodes along each axis, shape (k,).
        place: Where to evaluate, shape (m, axes of the table).

    Returns:
        Values, shape (m,).
    """
    from numpy.polynomial.chebyshev import chebvander

    degree = len(node) - 1
    to_coefficients = np.linalg.inv(chebvander(node, degree))
    bases = [chebvander(place[:, axis], degree) @ to_coefficients for axis in range(table.ndim)]
    if table.ndim == 1:
        return bases[0] @ table
    return np.einsum("pi,ij,pj->p", bases[0], table, bases[1])
