"""Sum the return rays from target points over the receiver's pupil, without storing the rays.

By reciprocity the rays are launched from the pupil toward the target point and traced to a plane just ahead of the
flow; from there to the point the path is a straight line in air at rest. The optical path difference of such a ray is

    OPD = opd at the plane + n_ambient (|T - r| - |T - r0|)

where r and r0 are the points at which the disturbed and the undisturbed ray cross the plane, and T is the target point.
The second term removes the effect of the angle between plane and ray: 0.1 wave at 2 degrees off the axis. The
deflected ray misses T; this effect is of second order in the deflection (Fermat), 3e-4 wave at 100 urad.

Millions of pairs of target point and pupil point would not fit in memory as rays. They are traced in chunks, and only
two sums per target point are kept.
"""

from dataclasses import dataclass, field

import numpy as np

from ..medium import IndexField
from ..pupils.base import lengths
from ..rays import RayBundle
from ..scene import Scene
from ..tracing import Plane, RayStatus, TraceResult, trace
from .paths import trace_options

# Distance of the stop plane ahead of the flow's box, clear of rounding at the box's face.
CLEARANCE = 1e-6  # [m]
# Rays per chunk: enough for every core or a GPU, and at most 100 MB including the tracer's arrays.
CHUNK_RAYS = 1 << 18  # speed only


@dataclass(frozen=True, eq=False)
class PupilSums:
    """Sums over the rays between some target points and the pupil.

    Attributes:
        open_share: Fraction of the pupil that each point's rays reach, 0 to 1, shape (k,).
        phasor: Sum of w exp(i k OPD) over those rays, complex, shape (k,).
        ray_count: Rays traced.
        evaluation_count: Field evaluations.
        seconds: Time in kernels [s].
        statuses: Number of rays by status name; whether they leave by a cut is not examined.
    """

    open_share: np.ndarray
    phasor: np.ndarray
    ray_count: int
    evaluation_count: int
    seconds: float
    statuses: dict[str, int] = field(default_factory=dict)

    @property
    def strehl(self) -> np.ndarray:
        """Exact Strehl ratio of the open part of the pupil, tilt not removed; 0 if nothing is open, shape (k,)."""
        open_share = np.where(self.open_share > 0.0, self.open_share, 1.0)
        return np.abs(self.phasor / open_share) ** 2


def receiver_pupil(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss points over the receiver's pupil [m], shape (n, 3), and weights that sum to 1, shape (n,)."""
    return scene.receiver.pupil.sample(scene.receiver.ray_count, "gauss")


def upper_half(start: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the half of a pupil's points that represents all of them if y and -y are equivalent."""
    edge = 1e-9 * np.abs(start[:, :2]).max()
    upper = start[:, 1] >= -edge
    return start[upper], np.where(np.abs(start[upper, 1]) <= edge, 1.0, 2.0) * weight[upper]


def reduce_pupils(
    scene: Scene, index: IndexField, target: np.ndarray, start: np.ndarray, weight: np.ndarray
) -> PupilSums:
    """Trace rays between target points and the pupil, and sum them over the pupil for each target point.

    Args:
        scene: The scene.
        index: The refractive index.
        target: Target points [m], shape (k, 3).
        start: Points of the pupil [m], shape (n, 3).
        weight: Fractions of the pupil that these points represent, shape (n,).

    Raises:
        ValueError: The target is not ahead of the flow, or no ray gets out toward any of the points.
    """
    check_ahead(index, target)
    wave_number = 2.0 * np.pi / scene.flow.wavelength
    open_share, phasor = np.zeros(len(target)), np.zeros(len(target), dtype=np.complex128)
    evaluation_count, seconds = 0, 0.0
    statuses: dict[str, int] = {}
    ray_count = len(target) * len(start)
    for first in range(0, ray_count, CHUNK_RAYS):
        # Ray r connects target point r // n with pupil point r % n; a chunk may begin or end within a pupil.
        of_target, of_pupil = np.divmod(np.arange(first, min(first + CHUNK_RAYS, ray_count)), len(start))
        opd, result = _trace_rays(scene, index, start[of_pupil], target[of_target])
        share = np.where(result.ok, weight[of_pupil], 0.0)
        begin, end = of_target[0], of_target[-1] + 1
        light = share * np.exp(1j * wave_number * opd)
        open_share[begin:end] += np.bincount(of_target - begin, share)
        phasor[begin:end] += np.bincount(of_target - begin, light.real) + 1j * np.bincount(
            of_target - begin, light.imag
        )
        evaluation_count += 0 if result.evaluation_count is None else int(result.evaluation_count.sum())
        seconds += result.seconds["kernel"]
        for code, count in zip(*np.unique(result.traced_status, return_counts=True), strict=True):
            name = RayStatus(int(code)).name
            statuses[name] = statuses.get(name, 0) + int(count)
    if not open_share.any():
        raise ValueError(
            f"no ray of the receiver's pupil gets out toward the target ({statuses}): "
            "check receiver.aperture_z and receiver.diameter against the body"
        )
    return PupilSums(open_share, phasor, ray_count, evaluation_count, seconds, statuses)


def check_ahead(index: IndexField, target: np.ndarray) -> None:
    """Check that target points [m], shape (k, 3), are ahead of the field's box.

    Raises:
        ValueError: One of them is not.
    """
    front = float(index.box[1][2])
    if target[:, 2].min() <= front + CLEARANCE:
        raise ValueError(
            f"the target reaches back to z = {target[:, 2].min():g} m, into the flow's box, which ends at {front:g} m: "
            "give a greater target.distance or a smaller tilt, or cut the field off ahead of the target"
        )


def _trace_rays(
    scene: Scene, index: IndexField, position: np.ndarray, point: np.ndarray
) -> tuple[np.ndarray, TraceResult]:
    """Return the OPD [m] of rays from pupil points to target points, shape (m,), 0 for failed rays; and the trace."""
    rays = RayBundle(position, point - position)
    stop_z = max(float(index.box[1][2]), scene.receiver.aperture_z) + CLEARANCE
    stop = Plane(np.array([0.0, 0.0, stop_z]), np.array([0.0, 0.0, 1.0]))
    wanted = ("position", "opd", "evaluation_count")
    result = trace(index, rays, until=stop, outputs=wanted, **trace_options(scene))
    assert result.position is not None and result.opd is not None  # requested outputs
    undisturbed = rays.position + ((stop_z - rays.position[:, 2]) / rays.direction[:, 2])[:, None] * rays.direction
    detour = lengths(point - result.position) - lengths(point - undisturbed)
    return np.where(result.ok, result.opd + index.ambient_index * detour, 0.0), result
