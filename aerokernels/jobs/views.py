"""The rays that are traced to be looked at: a map over the pupil, and a fan that crosses the flow."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.rays import Pupil, RayBundle
from aerokernels.scene import Scene
from aerokernels.tracing import Plane, TraceResult, trace
from aerokernels.tracing.radial_quadrature import asymmetry
from aerokernels.wavefront import point_spread_function, remove_terms

PUPIL_SAMPLES = 201  # across the pupil
SPOT_PADDING = 8  # samples per wavelength / diameter
SPOT_RINGS = 8.0  # half-width of what is kept of the spot [wavelength / diameter]
FAN_RAYS = 15
FAN_PLANES = 25


def trace_options(scene: Scene) -> dict[str, Any]:
    """What `trace` takes from a scene's [trace] and [flow] tables."""
    table = scene.trace
    return {
        "method": table.method,
        "tolerance": table.tolerance,
        "step": table.step,
        "max_steps": table.max_steps,
        "wavelength": scene.flow.wavelength,
        "backend": table.backend,
        "device": table.device,
        "precision": table.precision,
    }


def forward_pupil(scene: Scene) -> Pupil:
    """The receiver's pupil, looking forward."""
    return scene.receiver.pupil


@dataclass(frozen=True, eq=False)
class PupilMap:
    """Optical path difference on a square grid over the pupil.

    Attributes:
        coordinate: x and y of the samples [m], shape (n,).
        opd: Optical path difference, piston removed [m], shape (n, n), axes [y, x]; NaN outside the pupil and where a
            ray failed.
        without_tilt: The same with tilt removed as well.
        without_focus: The same with tilt and focus removed.
        trace: The trace behind it: one ray for each sample in the pupil, or for each distance from the axis.
    """

    coordinate: np.ndarray
    opd: np.ndarray
    without_tilt: np.ndarray
    without_focus: np.ndarray
    trace: TraceResult


def pupil_samples(field: IndexField, scene: Scene, sample_count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A square grid over the receiver's pupil, and the rays that it takes.

    Returns:
        Which samples lie in the pupil, shape (sample_count, sample_count), axes [y, x]; the samples among them that
        are traced; and for each of them which of those stands for it. Where everything is symmetric about the axis
        samples at one distance from it, an eighth of them and fewer, share a ray.
    """
    # In halves of the spacing distances are whole numbers: equal ones are equal to the last bit.
    half = 2 * np.arange(sample_count) - (sample_count - 1)
    squared = half[:, None] ** 2 + half**2
    pupil = forward_pupil(scene)
    if scene.receiver.shape == "disc":
        inside = squared <= (sample_count - 1) ** 2
    else:
        place = half * (max(pupil.half_extent) / (sample_count - 1))
        inside = pupil.transmission(place[None, :], place[:, None]) > 0.0
    if asymmetry(field, pupil, pupil.normal) is not None:
        every = np.arange(int(inside.sum()))
        return inside, every, every
    _, traced, ray = np.unique(squared[inside], return_index=True, return_inverse=True)
    return inside, traced, ray


def pupil_map(field: IndexField, scene: Scene, sample_count: int = PUPIL_SAMPLES) -> PupilMap:
    """Trace a square grid of parallel rays forward from the receiver's pupil.

    By reciprocity these are the optical paths of a plane wave that arrives from straight ahead.

    Raises:
        ValueError: No ray gets through.
    """
    radius = max(forward_pupil(scene).half_extent)
    coordinate = np.linspace(-radius, radius, sample_count)
    x, y = np.meshgrid(coordinate, coordinate)
    inside, samples, ray = pupil_samples(field, scene, sample_count)
    start = np.stack([x[inside], y[inside], np.full(int(inside.sum()), scene.receiver.aperture_z)], axis=1)[samples]
    rays = RayBundle(start, np.broadcast_to([0.0, 0.0, 1.0], start.shape))
    traced = trace(field, rays, **trace_options(scene), outputs=("opd", "evaluation_count"))
    assert traced.opd is not None  # asked for
    good = np.zeros_like(inside)
    good[inside] = traced.ok[ray]
    if not good.any():
        raise ValueError(
            f"no ray of the receiver's pupil gets through the flow ({traced.status_summary()}): "
            "check receiver.aperture_z and receiver.diameter against the body"
        )
    points = np.stack([x[good], y[good]], axis=1)
    arrived = traced.opd[ray][traced.ok[ray]]
    opd, without_tilt, without_focus = np.full((3, *inside.shape), np.nan)
    opd[good] = remove_terms(arrived, ("piston",))
    without_tilt[good] = remove_terms(arrived, ("piston", "tilt"), points)
    without_focus[good] = remove_terms(arrived, ("piston", "tilt", "focus"), points)
    return PupilMap(coordinate, opd, without_tilt, without_focus, traced)


@dataclass(frozen=True, eq=False)
class Spot:
    """The middle of a point spread function.

    Attributes:
        angle: Field angles of rows and columns [rad], shape (n,).
        intensity: Intensity over the undisturbed peak, shape (n, n), axes [y, x].
        perfect: The same without flow.
    """

    angle: np.ndarray
    intensity: np.ndarray
    perfect: np.ndarray


def spot(pupil: PupilMap, wavelength: float) -> Spot:
    """The point spread function of a pupil's wavefront, tilt included, and the one of the same pupil without flow."""
    lit = np.isfinite(pupil.opd)
    pixel = float(pupil.coordinate[1] - pupil.coordinate[0])
    half_width = SPOT_RINGS * wavelength / float(pupil.coordinate[-1] - pupil.coordinate[0])
    spread, perfect = (
        point_spread_function(opd, lit, pixel, wavelength, padding=SPOT_PADDING, half_width=half_width)
        for opd in (np.where(lit, pupil.opd, 0.0), np.zeros(lit.shape))
    )
    return Spot(spread.angle, spread.intensity, perfect.intensity)


@dataclass(frozen=True, eq=False)
class RayFan:
    """Rays in the plane x = 0, followed from plane to plane.

    Attributes:
        position: Where each ray crosses each plane [m], shape (ray_count, plane_count, 3); NaN once a ray has ended.
        deviation: Displacement in y from the undisturbed ray there [m], shape (ray_count, plane_count).
    """

    position: np.ndarray
    deviation: np.ndarray


def ray_fan(field: IndexField, scene: Scene, front: float) -> RayFan:
    """Trace a row of parallel rays from the pupil to a little ahead of `front`, the foremost z of the flow [m]."""
    radius, aperture = 0.5 * scene.receiver.diameter, scene.receiver.aperture_z
    start = np.zeros((FAN_RAYS, 3))
    start[:, 1] = np.linspace(-radius, radius, FAN_RAYS)
    start[:, 2] = aperture
    rays = RayBundle(start, np.broadcast_to([0.0, 0.0, 1.0], start.shape))
    planes = np.linspace(aperture, front + 0.1 * (front - aperture), FAN_PLANES)
    position = np.full((FAN_RAYS, FAN_PLANES, 3), np.nan)
    position[:, 0] = start
    for column, z in enumerate(planes[1:], start=1):
        plane = Plane(np.array([0.0, 0.0, z]), np.array([0.0, 0.0, 1.0]))
        traced = trace(field, rays, **trace_options(scene), until=plane, outputs=("position",))
        assert traced.position is not None  # asked for
        arrived = traced.ok
        position[arrived, column] = traced.position[arrived]
    return RayFan(position, position[..., 1] - start[:, None, 1])
