"""Camera model: an entrance pupil before a flow, a lens in it, and pixels behind it.

A pixel at the position p of the sensor looks along the tangent t = p / b from the pupil's middle, b being the image
distance of the plane in focus: 1 / b = 1 / f - 1 / focus. A ray of the pixel that starts at the point q of the pupil
goes through the point of the plane in focus that the pixel looks at:

    tangent = t - q / focus,      without a flow it meets a scene at the distance D at D t + q (1 - D / focus)

The second term is the depth of field. Positions are along the two axes of the pupil, x and y if it looks along +z.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_positive, warn_caller
from ..medium import IndexField
from ..pupils import Pupil
from ..rays import RayBundle
from ..tracing import Plane
from ..tracing.cuts import lost, may_lose
from ..tracing.pupil.air import GREATEST_SHARE

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
            raise TypeError(
                f"pupil must be a Disc, Annulus, Rectangle, Polygon or Mask, got {type(self.pupil).__name__}"
            )
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
    def image_distance(self) -> float:
        """Distance from the lens to the sensor [m]."""
        return 1.0 / (1.0 / self.focal_length - 1.0 / self.focus_distance)

    @property
    def pixel_tangent(self) -> float:
        """Tangent of the angle between neighbouring pixels on the axis."""
        return self.pixel / self.image_distance

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
        found = np.empty((len(size), 3))
        for axis in range(3):
            found[:, axis] = x * first[axis] + y * second[axis] + size * self.pupil.normal[axis]
        return found

    def across(self, vectors: np.ndarray) -> np.ndarray:
        """Return the components of vectors (n, 3) along the pupil's axes, shape (n, 2)."""
        found = np.empty((len(vectors), 2))
        for column, axis in enumerate(self.pupil.axes):
            found[:, column] = along(vectors, axis)
        return found


def along(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the components of vectors (.., 3) along an axis; without BLAS, whose threads would compete with ours."""
    return np.asarray(vectors[..., 0] * axis[0] + vectors[..., 1] * axis[1] + vectors[..., 2] * axis[2])


def rows_and_columns(counts: Any, name: str) -> tuple[int, int]:
    """Return rows and columns of a picture from one number or two.

    Raises:
        ValueError: `counts`, called `name` in the message, is not one or two positive whole numbers, or too large.
    """
    numbers = np.asarray(counts)
    if numbers.dtype.kind not in "iu" or numbers.shape not in ((), (2,)) or (numbers < 1).any():
        raise ValueError(f"{name} must be one whole number of at least 1, or two, got {counts!r}")
    rows, columns = (int(count) for count in np.broadcast_to(numbers, (2,)))
    if rows * columns > GREATEST_PIXELS:
        raise ValueError(f"{rows} x {columns} pixels are more than {GREATEST_PIXELS:.0e}")
    return rows, columns


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
