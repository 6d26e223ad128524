"""The way out to the target and the way back, through the flow.

Out: one ray for each target point, from the exit aperture to the tilted target. R_L = integral of n ds inside the
traced field plus the ambient index times the straight remainder (eq 9, with lengths and optical lengths kept apart).
The path ends on the tilted plane, so its tilt is in R_L already. Incidence: cos = -d . N in three dimensions.

Back: the Strehl ratio of the light of one target point over the receiver's pupil, tilt kept, piston removed. By
reciprocity its rays are launched from the pupil toward the target point and traced to a plane just ahead of the flow;
from there to the point it is a straight line in air at rest. The optical path difference of such a ray is

    OPD = opd at the plane + n_ambient (|T - r| - |T - r0|)

r and r0 being where the disturbed and the undisturbed ray cross the plane, T the target point. Without the second term
the plane's slant against the ray would count: 0.1 wave at 2 degrees off the axis. That the ray misses T by a little is
of second order in the deflection (Fermat), 3e-4 wave at 100 urad.

The Strehl ratio varies smoothly over the target, so it is computed at Chebyshev-Lobatto points on the target and
interpolated by the polynomial through them; the same with every other point left out says how good that is.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..rays import Disc, RayBundle
from ..scene import Scene
from ..strehl import strehl
from ..tracing import Plane, TraceResult, trace
from .target_points import TargetPoints

# The stop stands this far ahead of the flow's box, clear of rounding at its face.
CLEARANCE = 1e-6  # [m]


@dataclass(frozen=True)
class TransmitPaths:
    """The ways out, one a target point.

    Attributes:
        landing: Where each ray meets the target [m], shape (m, 3).
        path: Optical path R_L from the exit aperture to there [m], shape (m,).
        incidence_cosine: Cosine of the angle to the target's normal, shape (m,).
        arrived: Whether the ray got there, shape (m,).
        trace: The trace, or None in vacuum.
    """

    landing: np.ndarray
    path: np.ndarray
    incidence_cosine: np.ndarray
    arrived: np.ndarray
    trace: TraceResult | None = None


@dataclass(frozen=True)
class ReturnPaths:
    """The Strehl ratio on the way back.

    Attributes:
        strehl: Strehl ratio at the landing points, 0 to 1, shape (m,).
        error: Greatest change from leaving every other point of the interpolation out: its error is smaller.
        trace: The trace of all pupil rays.
    """

    strehl: np.ndarray
    error: float
    trace: TraceResult


def target_plane(scene: Scene) -> Plane:
    """The target's plane; its normal points along the axis, turned back by the tilt about x."""
    tilt = scene.target.tilt
    center = (0.0, 0.0, scene.receiver.aperture_z + scene.target.distance)
    return Plane(np.array(center), np.array([0.0, -math.sin(tilt), math.cos(tilt)]))


def trace_options(scene: Scene) -> dict:
    """The options of `trace` that a scene's [trace] and [flow] tables set."""
    table = scene.trace
    return {
        "method": table.method,
        "tolerance": table.tolerance,
        "step": table.step,
        "wavelength": scene.flow.wavelength,
        "backend": table.backend,
        "device": table.device,
        "precision": table.precision,
        "max_steps": table.max_steps,
    }


def vacuum_paths(points: TargetPoints, plane: Plane) -> TransmitPaths:
    """The ways out in vacuum: straight lines."""
    line = points.aim - points.start
    direction = line / np.linalg.norm(line, axis=1, keepdims=True)
    cosine = direction @ plane.normal
    path = ((plane.point - points.start) @ plane.normal) / cosine
    landing = points.start + path[:, None] * direction
    return TransmitPaths(landing, path, cosine, np.ones(len(path), dtype=bool))


def transmit_paths(scene: Scene, field: IndexField, points: TargetPoints) -> TransmitPaths:
    """The ways out through the flow. Rays that do not arrive have NaN for a path and a landing point."""
    plane = target_plane(scene)
    rays = RayBundle(points.start, points.aim - points.start)
    wanted = ("position", "direction", "optical_path", "evaluation_count")
    result = trace(field, rays, until=plane, outputs=wanted, **trace_options(scene))
    position, direction, path = result.position, result.direction, result.optical_path
    assert position is not None and direction is not None and path is not None  # they were asked for
    landing = np.where(result.ok[:, None], position, np.nan)
    cosine = np.where(result.ok, direction @ plane.normal, np.nan)
    return TransmitPaths(landing, np.where(result.ok, path, np.nan), cosine, result.ok, result)


def return_opd(scene: Scene, field: IndexField, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, TraceResult]:
    """Optical path difference over the receiver's pupil for each of some target points.

    Args:
        scene: The scene; `receiver.ray_count` rays for each point.
        field: The refractive index.
        target: Target points [m], shape (k, 3).

    Returns:
        OPD [m], shape (k, n); weights that sum to 1 along each row, 0 for rays that did not get out, shape (k, n); the
        trace.

    Raises:
        ValueError: The target is not ahead of the flow, or no ray of the pupil gets out toward one of the points.
    """
    front = float(field.box[1][2])
    if target[:, 2].min() <= front + CLEARANCE:
        raise ValueError(
            f"the target reaches back to z = {target[:, 2].min():g} m, into the flow's box, which ends at {front:g} m: "
            "give a greater target.distance or a smaller tilt, or cut the field off ahead of the target"
        )
    pupil = Disc(0.5 * scene.receiver.diameter, center=np.array([0.0, 0.0, scene.receiver.aperture_z]))
    start, weight = pupil.sample(scene.receiver.ray_count, "gauss")
    position = np.tile(start, (len(target), 1))
    point = np.repeat(target, len(start), axis=0)
    rays = RayBundle(position, point - position)
    stop_z = max(front, scene.receiver.aperture_z) + CLEARANCE
    wanted = ("position", "opd", "evaluation_count")
    stop = Plane(np.array([0.0, 0.0, stop_z]), np.array([0.0, 0.0, 1.0]))
    result = trace(field, rays, until=stop, outputs=wanted, **trace_options(scene))
    assert result.position is not None and result.opd is not None  # they were asked for
    undisturbed = rays.position + ((stop_z - rays.position[:, 2]) / rays.direction[:, 2])[:, None] * rays.direction
    detour = np.linalg.norm(point - result.position, axis=1) - np.linalg.norm(point - undisturbed, axis=1)
    opd = np.where(result.ok, result.opd + field.ambient_index * detour, 0.0).reshape(len(target), -1)
    weights = np.where(result.ok.reshape(opd.shape), weight, 0.0)
    total = weights.sum(axis=1, keepdims=True)
    if (total <= 0.0).any():
        raise ValueError(
            f"no ray of the receiver's pupil gets out toward {int((total <= 0).sum())} target points "
            f"({result.status_summary()}): check receiver.aperture_z and receiver.diameter against the body"
        )
    return opd, weights / total, result


def return_paths(scene: Scene, field: IndexField, landing: np.ndarray, node_count: int = 9) -> ReturnPaths:
    """Strehl ratio of the return path at landing points on the target.

    Args:
        scene: The scene.
        field: The refractive index.
        landing: Landing points [m], shape (m, 3); NaN where there is none, and the ratio is NaN there too.
        node_count: Points a side at which the ratio is computed, odd and at least 3.

    Raises:
        ValueError: As `return_opd`; also a `node_count` that is even or too small.
    """
    if (
        isinstance(node_count, bool)
        or not isinstance(node_count, (int, np.integer))
        or node_count < 3
        or node_count % 2 == 0
    ):
        raise ValueError(f"strehl_node_count must be odd and at least 3, got {node_count!r}")
    low, high = np.nanmin(landing[:, :2], axis=0), np.nanmax(landing[:, :2], axis=0)
    center, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-9)
    node = -np.cos(np.pi * np.arange(node_count) / (node_count - 1))
    x, y = np.meshgrid(center[0] + half[0] * node, center[1] + half[1] * node, indexing="ij")
    z = scene.receiver.aperture_z + scene.target.distance + y * math.tan(scene.target.tilt)
    opd, weight, result = return_opd(scene, field, np.stack([x, y, z], axis=-1).reshape(-1, 3))
    ratio = [strehl(row, scene.flow.wavelength, weights=share) for row, share in zip(opd, weight, strict=True)]
    table = np.reshape(ratio, (node_count, node_count))
    place = (landing[:, :2] - center) / half
    values = interpolate_polynomial(table, node, place)
    coarse = interpolate_polynomial(table[::2, ::2], node[::2], place)
    return ReturnPaths(np.clip(values, 0.0, 1.0), float(np.nanmax(np.abs(values - coarse))), result)


def interpolate_polynomial(table: np.ndarray, node: np.ndarray, place: np.ndarray) -> np.ndarray:
    """The polynomial through `table`, shape (k, k), at nodes in [-1, 1], shape (k,), evaluated at `place`, (m, 2)."""
    from numpy.polynomial.chebyshev import chebvander

    degree = len(node) - 1
    to_coefficients = np.linalg.inv(chebvander(node, degree))
    along_x, along_y = (chebvander(place[:, axis], degree) @ to_coefficients for axis in (0, 1))
    return np.einsum("pi,ij,pj->p", along_x, table, along_y)
