r"""Estimate a displacement's error from the terms that the field's interpolant omits, without coarser grids.

The scene point that a pixel sees is displaced by \int (D - z) grad m dz, where m is the contrast, z the depth beyond
the pupil and D the distance of the scene. As a tangent that is the change of the path \int m dz along the line from the
pupil to the undisturbed point, per shift of its start across the line:

    1/D \int (D - z) grad m dz = d/du \int m dz,        the line's point at z moves by u (1 - z/D).

So the error of the displacement is the change of the path's error per shift, and
tracing/error_budget/grid_error.py estimates that error along lines. Differences of coarser grids may vanish by chance,
these terms may not.
"""

import math

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from ..tracing.beyond import ways_through
from ..tracing.error_budget.grid_error import grid_error
from ..tracing.lines import box_size
from .camera import Camera, along
from .known_view import scene_plane
from .landing import pixel_rays

# Most lines in a picture, and lines whose points are in memory at once.
MOST_LINES, AT_ONCE = 1024, 256
# Shift of the lines [cells], and the least share of a shift at the pupil that arrives in the air.
SHIFT, LEAST_SHARE = 0.1, 0.05
# Greatest slope of the bound of the rest over its greatest value [1 / cell]: that of u^2 (1 - u)^2.
STEEPNESS = 3.1


def omitted_displacement(field: IndexField, camera: Camera, shape: tuple[int, int]) -> np.ndarray:
    """Return the estimated error [pixels] at every k-th row and column of a picture of a shape; 0 on a mesh.

    Row i of the result stands for rows i k to i k + k - 1, and columns likewise, k = `stride(shape)`.
    """
    step = stride(shape)
    direction = pixel_rays(camera, shape, np.zeros(2)).direction.reshape(*shape, 3)[
        step // 2 :: step, step // 2 :: step
    ]
    if not field.is_uniform:
        return np.zeros(direction.shape[:2])
    pupil, until, cell = camera.pupil, scene_plane(camera), float(np.min(field.spacing))
    share = max(1.0 - middle_distance(field, camera) / camera.distance, LEAST_SHARE)
    shift = SHIFT * cell / share
    starts = [pupil.center, *(pupil.center + shift * axis for axis in pupil.axes)]
    sizes = []
    for part in np.array_split(direction.reshape(-1, 3), math.ceil(direction.size / (3 * AT_ONCE))):
        errors = []
        for start in starts:
            turned = part
            if math.isfinite(camera.distance):
                turned = pupil.center + (camera.distance / along(part, pupil.normal))[:, None] * part - start
            errors.append(grid_error(field, RayBundle(np.broadcast_to(start, part.shape), turned), until))
        (middle, rest), (first, _), (second, _) = errors
        sizes.append(np.hypot(first - middle, second - middle) / shift + STEEPNESS * share / cell * rest)
    return np.concatenate(sizes).reshape(direction.shape[:2]) / camera.pixel_tangent


def stride(shape: tuple[int, int]) -> int:
    """Return the step between the rows and columns whose lines are examined."""
    return min(max(1, math.ceil(math.sqrt(shape[0] * shape[1] / MOST_LINES))), *shape)


def middle_distance(field: IndexField, camera: Camera) -> float:
    """Return the distance [m] along the camera's axis to the middle of the field's box, at least the box's size."""
    middle, *_ = ways_through(field.box, camera.pupil.center, camera.pupil.normal)
    return max(float(middle), box_size(field))
