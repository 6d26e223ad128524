"""Landing points in the scene of the rays of one aperture point, by blocks of the picture's rows.

A picture has millions of rays. Arrays of all rays are written once and read once: intermediate results stay in a core's
cache, block by block, and blocks are distributed to threads.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..medium import IndexField
from ..process.threads import in_threads
from ..rays import RayBundle
from ..tracing import trace
from ..tracing.result import TraceResult
from ..tracing.status import reached
from .camera import Camera, along, scene_plane

# Rays per block.
BLOCK = 1 << 14  # speed only


@dataclass(frozen=True, eq=False)
class Landing:
    """Traced rays of one point of the aperture, one per pixel.

    Attributes:
        camera: The camera.
        shape: Rows and columns of the picture.
        point: The point of the aperture along its axes [m], shape (2,).
        traced: The rays.
        ends: End points of the rays [m], or their final directions if the scene is far, shape (rays, 3).
        status: Status codes of the rays.
    """

    camera: Camera
    shape: tuple[int, int]
    point: np.ndarray
    traced: TraceResult
    ends: np.ndarray
    status: np.ndarray

    def moved(self, rows: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return the shift by the flow of the scene points seen in some rows of the picture, and which rays arrive.

        Returns:
            Shifts along x and y [pixels], shape (rows, columns, 2), 0 where a ray does not arrive; mask of the rays
            that arrive, shape (rows, columns).
        """
        camera, pupil, columns = self.camera, self.camera.pupil, self.shape[1]
        part = slice(rows.start * columns, rows.stop * columns)
        ends = self.ends[part]
        if np.isfinite(camera.distance):
            place = (camera.across(ends - pupil.center) - self.point) / camera.distance
        else:
            place = camera.across(ends) / along(ends, pupil.normal)[:, None]
        found = place.reshape(-1, columns, 2)
        x, y = _tangents(camera, self.shape, self.point)
        found[..., 0] -= x
        found[..., 1] -= y[rows, None]
        found /= camera.pixel_tangent
        arrived = reached(self.status[part]).reshape(-1, columns)
        if not arrived.all():
            found[~arrived] = 0.0
        return found, arrived


def land(
    field: IndexField, camera: Camera, shape: tuple[int, int], point: np.ndarray, options: dict[str, Any]
) -> Landing:
    """Trace the rays of one point of the aperture to the scene; `options` are those of `trace`."""
    far = not np.isfinite(camera.distance)
    name = "direction" if far else "position"
    rays = pixel_rays(camera, shape, point)
    traced = trace(field, rays, until=scene_plane(camera), outputs=(name,), **options)
    return Landing(camera, shape, point, traced, getattr(traced, name), traced.traced_status)


def pixel_rays(camera: Camera, shape: tuple[int, int], point: np.ndarray) -> RayBundle:
    """Return the rays of a point of the aperture [m], one per pixel, row by row."""
    first, second = camera.pupil.axes
    x, y = _tangents(camera, shape, point)
    direction = np.empty((*shape, 3))

    def look(rows: slice) -> None:
        size = 1.0 / np.sqrt(1.0 + x**2 + y[rows, None] ** 2)
        for axis in range(3):
            toward = x * first[axis] + (y[rows, None] * second[axis] + camera.pupil.normal[axis])
            np.multiply(toward, size, out=direction[rows, :, axis])

    by_rows(look, shape)
    start = camera.pupil.center + point[0] * first + point[1] * second
    return RayBundle.of_units(np.broadcast_to(start, (shape[0] * shape[1], 3)), direction.reshape(-1, 3))


def by_rows(work: Callable[[slice], None], shape: tuple[int, int]) -> None:
    """Call `work` for each block of rows of a picture, in threads."""
    step = max(1, BLOCK // shape[1])  # speed only
    in_threads(work, [slice(first, min(first + step, shape[0])) for first in range(0, shape[0], step)])


def _tangents(camera: Camera, shape: tuple[int, int], point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the tangents of the rays of a point of the aperture: x of the columns, y of the rows."""
    x, y = (t - place / camera.focus_distance for t, place in zip(camera.tangents(shape), point, strict=True))
    return x, y
