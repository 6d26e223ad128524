"""Trace the rays that a run's figures show: an OPD map over the pupil, and a fan of rays across the flow."""

from dataclasses import dataclass

import numpy as np

from aerokernels.echo.parts import trace_options
from aerokernels.medium import IndexField
from aerokernels.pupils import Disc, Pupil
from aerokernels.rays import RayBundle
from aerokernels.scene import Scene
from aerokernels.tracing import Plane, TraceResult, trace
from aerokernels.tracing.lines import box_size
from aerokernels.tracing.pupil.quadrature import asymmetry
from aerokernels.tracing.stop import plane_beyond
from aerokernels.wavefront import point_spread_function, remove_terms

PUPIL_SAMPLES = 201  # samples across the pupil
SPOT_PADDING = 8  # samples per wavelength / diameter
SPOT_RINGS = 8.0  # half-width of the stored spot [wavelength / diameter]
FAN_RAYS = 15
FAN_PLANES = 25
# Distance of the end plane beyond a face of the box, as a share of the box's size: adds less than 1e-6 wave at 1 mrad.
BEYOND_FACE = 1e-5


@dataclass(frozen=True, eq=False)
class PupilMap:
    """Optical path difference on a square grid over the pupil.

    Attributes:
        coordinate: Coordinates of the samples along either axis of the pupil (x, y if it faces ahead) [m], shape (n,).
        opd: Optical path difference, piston removed [m], shape (n, n), axes [y, x]; NaN outside the pupil and where a
            ray failed.
        without_tilt: OPD with piston and tilt removed [m], shape (n, n).
        without_focus: OPD with piston, tilt and focus removed [m], shape (n, n).
        trace: The trace of the map's rays: one for each sample in the pupil, or for each distance from the axis.
    """

    coordinate: np.ndarray
    opd: np.ndarray
    without_tilt: np.ndarray
    without_focus: np.ndarray
    trace: TraceResult

    @property
    def opd_error(self) -> float:
        """Greatest OPD error of a ray [m], and so of the rms of each map; some rays are retraced when first read."""
        return self.trace.error["total"]


def pupil_samples(field: IndexField, scene: Scene, sample_count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Make a square grid over a scene's pupil, and find which of its samples need a ray.

    Returns:
        Mask of the samples in the pupil, shape (sample_count, sample_count), axes [y, x]; indices of the masked samples
        that are traced; and for each masked sample the index of its traced ray. If everything is symmetric about the
        axis, samples at the same distance from it share a ray, so that at most an eighth of them are traced.
    """
    # In halves of the spacing distances are whole numbers: equal ones are equal to the last bit.
    half = 2 * np.arange(sample_count) - (sample_count - 1)
    squared = half[:, None] ** 2 + half**2
    pupil = scene.view
    if isinstance(pupil, Disc):
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
    """Trace a square grid of parallel rays from a scene's pupil in its direction of view.

    By reciprocity these are the optical paths of a plane wave that arrives from that direction.

    Raises:
        ValueError: No ray gets through.
    """
    pupil = scene.view
    radius = max(pupil.half_extent)
    coordinate = np.linspace(-radius, radius, sample_count)
    x, y = np.meshgrid(coordinate, coordinate)
    inside, samples, ray = pupil_samples(field, scene, sample_count)
    start = _in_plane(pupil, x[inside][samples], y[inside][samples])
    rays = RayBundle(start, np.broadcast_to(pupil.normal, start.shape))
    end = _end_of(field, pupil)
    traced = trace(field, rays, **trace_options(scene), until=end, outputs=("opd", "evaluation_count"))
    assert traced.opd is not None  # requested by `outputs`
    good = np.zeros_like(inside)
    good[inside] = traced.ok[ray]
    if not good.any():
        raise ValueError(
            f"no ray of the pupil gets through the flow ({traced.status_summary()}): check its place, "
            f"{pupil.center.tolist()} m, its size and where it looks against the body "
            "([pupil], or receiver.aperture_z and receiver.diameter)"
        )
    points = np.stack([x[good], y[good]], axis=1)
    arrived = traced.opd[ray][traced.ok[ray]]
    opd, without_tilt, without_focus = np.full((3, *inside.shape), np.nan)
    opd[good] = remove_terms(arrived, ("piston",))
    without_tilt[good] = remove_terms(arrived, ("piston", "tilt"), points)
    without_focus[good] = remove_terms(arrived, ("piston", "tilt", "focus"), points)
    return PupilMap(coordinate, opd, without_tilt, without_focus, traced)


def _end_of(field: IndexField, pupil: Pupil) -> Plane:
    """Return the plane at which a pupil's rays end: normal to them beyond the flow's box, for rays along z just beyond.

    All of a run's traces end at a plane, so that they share one kernel.
    """
    look = pupil.normal
    if np.any(look[:2]):
        return plane_beyond(field, pupil, look)
    face = field.box[int(look[2] > 0.0)][2] + BEYOND_FACE * box_size(field) * look[2]
    return Plane(np.array([*pupil.center[:2], face]), look)


@dataclass(frozen=True, eq=False)
class Spot:
    """The central part of a point spread function.

    Attributes:
        angle: Field angles of rows and columns [rad], shape (n,).
        intensity: Intensity over the undisturbed peak, shape (n, n), axes [y, x].
        perfect: Intensity without flow, shape (n, n).
    """

    angle: np.ndarray
    intensity: np.ndarray
    perfect: np.ndarray


def spot(pupil: PupilMap, wavelength: float) -> Spot:
    """Compute the point spread function of a pupil's wavefront, tilt included, and that of the pupil without flow."""
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
    """Rays in the plane of a pupil's direction of view and its second axis (x = 0 if it faces ahead).

    Attributes:
        position: Intersection of each ray with each plane [m], shape (ray_count, plane_count, 3); NaN after its end.
        deviation: Displacement from the undisturbed ray along the second axis [m], shape (ray_count, plane_count).
    """

    position: np.ndarray
    deviation: np.ndarray


def ray_fan(field: IndexField, scene: Scene, front: float) -> RayFan:
    """Trace a row of parallel rays from the pupil to a little beyond the flow, whose highest z is `front` [m]."""
    pupil = scene.view
    half = pupil.half_extent[1]
    start = _in_plane(pupil, np.zeros(FAN_RAYS), np.linspace(-half, half, FAN_RAYS))
    rays = RayBundle(start, np.broadcast_to(pupil.normal, start.shape))
    planes = np.linspace(
        pupil.center, pupil.center + 1.1 * _distance_out(field, pupil, front) * pupil.normal, FAN_PLANES
    )
    position = np.full((FAN_RAYS, FAN_PLANES, 3), np.nan)
    position[:, 0] = start
    for column, point in enumerate(planes[1:], start=1):
        traced = trace(field, rays, **trace_options(scene), until=Plane(point, pupil.normal), outputs=("position",))
        assert traced.position is not None  # requested by `outputs`
        arrived = traced.ok
        position[arrived, column] = traced.position[arrived]
    second = pupil.axes[1]
    return RayFan(position, position @ second - (start @ second)[:, None])


def _in_plane(pupil: Pupil, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return points of a pupil's plane [m], shape (n, 3), from their coordinates along its two axes."""
    first, second = pupil.axes
    return pupil.center + x[:, None] * first + y[:, None] * second


def _distance_out(field: IndexField, pupil: Pupil, front: float) -> float:
    """Return the length [m] of the line from a pupil's centre, in its direction of view, to the end of the flow."""
    low, high = (np.array(corner, dtype=np.float64) for corner in field.box)
    high[2] = front
    ends = np.where(pupil.normal > 0.0, high, low)
    steep = np.abs(pupil.normal) > 1e-9
    ways = (ends[steep] - pupil.center[steep]) / pupil.normal[steep]
    ways = ways[np.isfinite(ways) & (ways > 0.0)]
    return float(ways.min()) if len(ways) else 2.0 * pupil.reach
