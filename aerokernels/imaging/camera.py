"""Camera model: an entrance pupil before a flow, a lens in it, and pixels behind it.

A pixel at the position p of the sensor looks along t = p / b, with 1 / b = 1 / f - 1 / focus. Its ray from the point q
of the pupil has the tangent t - q / focus, and without a flow meets a scene at D at D t + q (1 - D / focus): the second
term is the depth of field. Positions are along the two axes of the pupil, x and y if it looks along +z.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_count, check_positive
from ..inputs.kinds import wrong_kind
from ..pupils import Pupil
from ..rays import RayBundle
from ..tracing import Plane

GREATEST_PIXELS = 100_000_000


@checked
@dataclass(frozen=True)
class Camera:
    """A camera looking along its pupil's normal.

    Pictures have the axes [y, x], both ascending along the pupil's axes, as maps of wavefronts have.

    Attributes:
        pupil: The entrance pupil, with its position and viewing direction.
        focal_length: Focal length of the lens [m].
        pixel: Side of a pixel [m].
        pixel_count: Number of pixels: rows and columns, or one number for a square; None takes the scene's.
        distance: Distance from the pupil to the plane of the scene, along the normal [m]; infinite for a far scene.
        focus: Distance of the plane in focus [m]; None takes the scene's.

    Raises:
        TypeError: `pupil` is not a pupil.
        ValueError: A number is out of range.
    """

    pupil: Pupil
    focal_length: float
    pixel: float
    pixel_count: int | tuple[int, int] | None = None
    distance: float = float("inf")
    focus: float | None = None

    def __post_init__(self):
        """Check the values."""
        if not isinstance(self.pupil, Pupil):
            raise wrong_kind(self.pupil, "pupil", "a Disc, Annulus, Rectangle, Polygon or Mask")
        check_positive(self.focal_length, "focal_length", "m")
        check_positive(self.pixel, "pixel", "m")
        if not (np.ndim(self.distance) == 0 and self.distance > 0.0):
            raise ValueError(f"distance must be a positive length [m], or infinite, got {self.distance!r}")
        if not self.focus_distance > self.focal_length:
            raise ValueError(
                f"focus = {self.focus_distance!r} m: the plane in focus must lie beyond the focal length of "
                f"{self.focal_length:g} m"
            )
        if self.pixel_count is not None:
            self.shape()

    @property
    def focus_distance(self) -> float:
        """Distance of the plane in focus [m]."""
        return float(self.distance if self.focus is None else self.focus)

    @property
    def pixel_tangent(self) -> float:
        """Tangent of the angle between neighbouring pixels on the axis."""
        return self.pixel * (1.0 / self.focal_length - 1.0 / self.focus_distance)

    @property
    def scene_pixel(self) -> float:
        """Size of a pixel in the plane of the scene [m]; infinite for a far scene."""
        return self.pixel_tangent * self.distance

    def shape(self, scene: Any = None) -> tuple[int, int]:
        """Return rows and columns of the picture; the scene's if the camera has no `pixel_count`.

        Raises:
            ValueError: Neither has any, or a number is out of range.
        """
        if self.pixel_count is None and scene is None:
            raise ValueError("the camera needs a pixel_count: rows and columns")
        return rows_and_columns(np.shape(scene)[:2] if self.pixel_count is None else self.pixel_count, "pixel_count")

    def tangents(self, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return the tangents along which the columns and rows look: x, shape (columns,), and y, shape (rows,)."""
        rows, columns = shape
        x, y = (self.pixel_tangent * (np.arange(count) - 0.5 * (count - 1)) for count in (columns, rows))
        return x, y

    def directions(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return unit vectors along tangents x and y, each of shape (n,): shape (n, 3)."""
        first, second = self.pupil.axes
        size = 1.0 / np.sqrt(1.0 + x**2 + y**2)
        x, y = x * size, y * size
        result = np.empty((len(size), 3))
        for axis in range(3):
            result[:, axis] = x * first[axis] + y * second[axis] + size * self.pupil.normal[axis]
        return result

    @property
    def scene_plane(self) -> Plane | None:
        """The plane of the scene, on which rays end; None for a far scene: rays end where they leave the field."""
        if not np.isfinite(self.distance):
            return None
        return Plane(self.pupil.center + self.distance * self.pupil.normal, self.pupil.normal)

    def rays(self, point: np.ndarray, x: np.ndarray, y: np.ndarray) -> RayBundle:
        """Return rays of a point of the aperture [m] for pixels that look along tangents x and y, of shape (n,)."""
        first, second = self.pupil.axes
        start = self.pupil.center + point[0] * first + point[1] * second
        directions = self.directions(x - point[0] / self.focus_distance, y - point[1] / self.focus_distance)
        return RayBundle.of_units(np.broadcast_to(start, (len(x), 3)), directions)

    def shift(self, ends: np.ndarray, point: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return where rays meet the scene less where they would without the flow [pixels], shape (n, 2).

        `ends` are end points [m], or final directions if the scene is far; `point` are the points of the aperture at
        which rays start [m], (2,) or (n, 2); x and y the tangents of their pixels, (n,).
        """
        if np.isfinite(self.distance):
            met = (self.across(ends - self.pupil.center) - point) / self.distance
        else:
            met = self.across(ends) / along(ends, self.pupil.normal)[:, None]
        straight = np.stack([x, y], axis=1) - np.asarray(point) / self.focus_distance
        return np.asarray((met - straight) / self.pixel_tangent)

    def aperture(self, count: int) -> "Aperture":
        """Return about so many points of the aperture, or its middle alone for 1."""
        if check_count(count, "aperture_rays") == 1:
            return Aperture(np.zeros((1, 2)), np.ones(1))
        points, weight = self.pupil.sample(int(count), "gauss")
        flat = self.across(points - self.pupil.center)
        # The sampling weights include the amplitude transmission once: light has its square.
        light = weight * self.pupil.transmission(flat[:, 0], flat[:, 1])
        return Aperture(flat, light / light.sum())

    def across(self, vectors: np.ndarray) -> np.ndarray:
        """Return the components of vectors (n, 3) along the pupil's axes, shape (n, 2)."""
        result = np.empty((len(vectors), 2))
        for column, axis in enumerate(self.pupil.axes):
            result[:, column] = along(vectors, axis)
        return result


def along(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the components of vectors (.., 3) along an axis; without BLAS, whose threads would compete with ours."""
    return np.asarray(vectors[..., 0] * axis[0] + vectors[..., 1] * axis[1] + vectors[..., 2] * axis[2])


def rows_and_columns(counts: Any, name: str) -> tuple[int, int]:
    """Return rows and columns of a picture from one number or two."""
    numbers = np.asarray(counts)
    if numbers.dtype.kind not in "iu" or numbers.shape not in ((), (2,)) or (numbers < 1).any():
        raise ValueError(f"{name} must be one whole number of at least 1, or two, got {counts!r}")
    rows, columns = (int(count) for count in np.broadcast_to(numbers, (2,)))
    if rows * columns > GREATEST_PIXELS:
        raise ValueError(f"{rows} x {columns} pixels are more than {GREATEST_PIXELS:.0e}")
    return rows, columns


@dataclass(frozen=True, eq=False)
class Aperture:
    """Points of an aperture along its axes [m], shape (n, 2), and their shares of the light, shape (n,)."""

    points: np.ndarray
    weights: np.ndarray

    def mean(self, shift: np.ndarray) -> np.ndarray:
        """Return the displacement of the picture's content [pixels], shape (m, 2), of shifts (m, n, 2)."""
        return np.asarray(-np.einsum("j,ijk->ik", self.weights, shift))

    def blur(self, shift: np.ndarray) -> np.ndarray:
        """Return the root mean square distances from the mean [pixels], shape (m, 2), of shifts (m, n, 2)."""
        apart = shift + self.mean(shift)[:, None]
        return np.asarray(np.sqrt(np.einsum("j,ijk->ik", self.weights, apart**2)))
