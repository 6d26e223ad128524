"""Find the pixels of a camera that look through disturbed air that was cut off the field.

Straight rays from the points of the aperture are tested, as for a pupil (tracing/pupil/air.py): a ray counts if it
loses more of its optical path than the tolerance. A field whose box is its whole flow costs nothing. The rule is the
one of a pupil, applied to the light of the whole picture: more than a thousandth of it is rejected unless the caller
allows it. Fewer pixels, at a rim, cause a warning only, since a picture, unlike a Strehl ratio, can mark them.
"""

from dataclasses import dataclass

import numpy as np

from aerokernels.inputs.checks import warn_caller

from ..medium import IndexField
from ..rays import RayBundle
from ..tracing import Plane
from ..tracing.cuts import lost, may_lose
from ..tracing.pupil.air import GREATEST_SHARE
from .camera import Camera

# Pixels along a side of the picture that are tested for a warning.
LOOKED_AT = 32


@dataclass(frozen=True, eq=False)
class KnownView:
    """A camera in front of a field.

    Attributes:
        field: The refractive index.
        camera: The camera.
        points: Points of the aperture along its axes [m], shape (n, 2).
        weights: Shares of the light of these points, shape (n,).
        tolerance: Greatest OPD that a ray may lose by cuts [m].
    """

    field: IndexField
    camera: Camera
    points: np.ndarray
    weights: np.ndarray
    tolerance: float

    def truncated(self, shape: tuple[int, int], stride: tuple[int, int] = (1, 1)) -> np.ndarray:
        """Return the share of the aperture that loses more than the tolerance, for every `stride`-th pixel."""
        x, y = (axis[step // 2 :: step] for axis, step in zip(self.camera.tangents(shape), stride[::-1], strict=True))
        found = np.zeros((len(y), len(x)))
        if not may_lose(self.field, self.tolerance):
            return found
        across, up = (axis.ravel() for axis in np.meshgrid(x, y))
        for point, weight in zip(self.points, self.weights, strict=True):
            rays = rays_of(self.camera, point, across, up)
            amount = lost(self.field, rays, scene_plane(self.camera), tolerance=self.tolerance)
            found.ravel()[np.abs(amount) > self.tolerance] += weight
        return found

    def check(self, shape: tuple[int, int], allowed: bool) -> None:
        """Check that at most a thousandth of a view is truncated, unless more is allowed; warn of less.

        Raises:
            ValueError: More is truncated.
        """
        if allowed:
            return
        stride = tuple(max(1, count // LOOKED_AT) for count in shape)
        share = self.truncated(shape, (stride[0], stride[1]))
        concerned = 100.0 * float(np.mean(share > GREATEST_SHARE))
        if concerned == 0.0:
            return
        text = f"{concerned:.3g} % of the picture looks through disturbed air that was cut off the field"
        if float(np.mean(share)) <= GREATEST_SHARE:
            warn_caller(f"{text}; those pixels are marked in `known`", RuntimeWarning)
            return
        raise ValueError(
            f"{text}. Give the field a larger region there, look another way, or take allow_truncation=True and read "
            "`known`, where those pixels are marked"
        )


def rays_of(camera: Camera, point: np.ndarray, x: np.ndarray, y: np.ndarray) -> RayBundle:
    """Return rays of a point of the aperture [m] for pixels that look along tangents x and y, both of shape (n,)."""
    first, second = camera.pupil.axes
    start = camera.pupil.center + point[0] * first + point[1] * second
    tangent = (t - place / camera.focus_distance for t, place in zip((x, y), point, strict=True))
    return RayBundle(np.broadcast_to(start, (len(x), 3)), camera.directions(*tangent))


def scene_plane(camera: Camera) -> Plane | None:
    """Return the plane of the scene, on which rays end; None for a far scene: rays end where they leave the field."""
    pupil = camera.pupil
    far = not np.isfinite(camera.distance)
    return None if far else Plane(pupil.center + camera.distance * pupil.normal, pupil.normal)
