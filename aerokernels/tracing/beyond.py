r"""Stops beyond a field: how far light runs until all of the field's box lies behind it.

A planar field has no ends in x. Light along the unit vector d crosses it in y and z, by p = |(d_y, d_z)| a metre, and
is beyond it where it has passed the corner that is farthest along (d_y, d_z). Other fields end along all axes: p = 1.

Its momentum along x is conserved, so that in y and z light moves as through a contrast m / p^2, which may turn it. For
contrasts up to NEARLY_TRAPPED p^2 that makes the way longer by less than the share ROOM (1 - p^2) that is added to it.
Light nearer to the x axis may be guided along the field, and no plane is beyond it.
"""

import numpy as np

from ..medium import IndexField
from ..rays import Pupil
from .meeting import greatest_contrast
from .stop import Plane

# Over the size of the box: how far beyond it a stop is at least, so that they never are the same surface.
CLEARANCE = 1e-3
ROOM, NEARLY_TRAPPED = 0.125, 1.0 / 32.0
Box = tuple[np.ndarray, np.ndarray]  # lowest and highest corner [m], infinite along an axis without ends


def ways_through(box: Box, start: np.ndarray, look: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return lengths [m] along unit vectors from points to the middle of a box and to beyond all of it, and p^2.

    `start` and `look` have shape (.., 3), the results (..). Lengths are negative for what is behind the start.
    """
    ends = np.isfinite(box[1] - box[0])
    low, high = (np.where(ends, corner, 0.0) for corner in box)
    toward = np.where(ends, look, 0.0)
    square = np.sum(toward**2, axis=-1)
    middle, corner = 0.5 * (low + high), np.where(look > 0.0, high, low)
    lengths = (np.sum((place - start) * toward, axis=-1) / np.maximum(square, 1e-300) for place in (middle, corner))
    return *lengths, square


def way_beyond(box: Box, start: np.ndarray, reach: float, look: np.ndarray, contrast: float = 0.0) -> np.ndarray:
    """Return the length [m] along unit vectors from points to where light is beyond a field's box, shape (..).

    That holds for all light along a unit vector that starts within `reach` [m] of the point.

    Raises:
        ValueError: A planar field of so great a contrast that light along a unit vector may never leave it.
    """
    _, end, square = ways_through(box, start, look)
    ends = np.isfinite(box[1] - box[0])
    slowest, least = float(np.min(square)), contrast / NEARLY_TRAPPED
    if not ends.all() and not slowest > least:
        near, limit = (np.degrees(np.arcsin(np.sqrt(min(part, 1.0)))) for part in (slowest, least))
        raise ValueError(
            f"a planar field never ends along x, and light at {near:.2g} degrees from x may not leave it: look more "
            f"than {limit:.2g} degrees away from x, or give the air as a volume"
        )
    size = float(np.linalg.norm(np.where(ends, box[1] - box[0], 0.0)))
    length = np.maximum(end, 0.0) + (reach + CLEARANCE * size) / np.sqrt(square)
    return np.asarray(length * (1.0 + ROOM * np.maximum(1.0 - square, 0.0)))


def plane_beyond(field: IndexField, pupil: Pupil, look: np.ndarray) -> Plane:
    """Return the plane across a unit vector, beyond a field for all light of a pupil along it.

    Raises:
        ValueError: Light along the vector may never leave the field, see `way_beyond`.
    """
    way = way_beyond(field.box, pupil.center, pupil.reach, look, greatest_contrast(field))
    return Plane(pupil.center + way * look, look)
