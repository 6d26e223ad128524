"""Random cameras viewing random air of closed form, to test the reported errors of displacement and blur.

`background_displacement` looks through sampled air (closed_air.py). The truth follows rays from many points of the
aperture through the closed form by the classic Runge-Kutta scheme in steps along the camera's axis.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerokernels.imaging import Camera, background_displacement
from aerokernels.pupils import Annulus, Disc, Pupil, Rectangle

from .closed_air import HALF, DrawnAir, draw_air, log_uniform

STRENGTHS = (1e-6, 1e-4)
# Rows and columns of a picture.
SHAPE = (3, 4)
# For the truth: points of the aperture, steps along a ray, and the step of the differences for the gradient [m].
TRUE_POINTS, STEPS, DIFFERENCE = 144, 300, 2e-6


@dataclass(frozen=True, eq=False)
class DrawnCamera:
    """Air, its samples, a camera before it and the number of points of its aperture."""

    air: DrawnAir
    camera: Camera
    aperture_rays: int


@dataclass(frozen=True)
class ViewCheck:
    """Displacement and blur of a picture's pixels beside the truth [pixels].

    Attributes:
        displacement_missed: Distance from the true displacement, shape (rows, columns).
        displacement_error: Its reported error.
        blur: Blur, shape (rows, columns, 2).
        blur_missed: Difference from the true blur.
        blur_error: Its reported error.
    """

    displacement_missed: np.ndarray
    displacement_error: np.ndarray
    blur: np.ndarray
    blur_missed: np.ndarray
    blur_error: np.ndarray


def draw_camera(seed: int) -> DrawnCamera:
    """Return the camera and the air of a seed."""
    rng = np.random.default_rng([29, seed])
    air = draw_air(rng, STRENGTHS)
    normal = rng.normal(size=3) * ((0.3, 1.0, 1.0) if air.field.geometry == "planar" else (1.0, 1.0, 1.0))
    normal /= np.linalg.norm(normal)
    away = log_uniform(rng, 9e-3, 0.2)
    size = min(log_uniform(rng, 1e-4, 3e-3), 3.0 * air.smallest)
    pupil = _pupil(rng, size, -away * normal + rng.uniform(-1e-3, 1e-3, 3), normal)
    far = rng.random() < 0.3
    distance = np.inf if far else away + log_uniform(rng, 0.02, 2.0)
    focus = None if rng.random() < 0.5 else away + log_uniform(rng, 0.02, 2.0)
    # The picture covers some millimetres of the air.
    length = 0.5 * min(away, distance)
    camera = Camera(pupil, length, length * rng.uniform(0.1, 0.6) * HALF / away, SHAPE, distance, focus)
    return DrawnCamera(air, camera, int(rng.choice([4, 4, 9, 16])))


def check_camera(drawn: DrawnCamera, **options) -> ViewCheck:
    """Compare displacement and blur with the truth; options are passed to `background_displacement`."""
    seen = background_displacement(
        drawn.air.field, drawn.camera, aperture_rays=drawn.aperture_rays, allow_truncation=True, **options
    )
    light = drawn.camera.aperture(TRUE_POINTS)
    points, weights = light.points, light.weights
    normal = drawn.camera.pupil.normal
    slant = float(np.hypot(normal[1], normal[2])) if drawn.air.field.geometry == "planar" else 1.0
    shifts = true_shifts(drawn.air.contrast, drawn.camera, SHAPE, points, slant)
    mean = np.einsum("p,pyxc->yxc", weights, shifts)
    blur = np.sqrt(np.einsum("p,pyxc->yxc", weights, (shifts - mean) ** 2))
    return ViewCheck(
        np.linalg.norm(seen.displacement + mean, axis=-1),
        seen.error,
        seen.blur,
        np.abs(seen.blur - blur),
        seen.blur_error,
    )


def true_shifts(
    contrast: Callable[[np.ndarray], np.ndarray],
    camera: Camera,
    shape: tuple[int, int],
    points: np.ndarray,
    slant: float = 1.0,
) -> np.ndarray:
    """Shifts [pixels] of rays from points of the aperture (n, 2) [m], shape (n, rows, columns, 2); vacuum elsewhere.

    `slant` is the part of the camera's direction that leads out of the air, less than 1 where it is endless along x.
    """
    pupil = camera.pupil
    first, second = pupil.axes
    x, y = np.meshgrid(*camera.tangents(shape))
    start = np.broadcast_to(points[:, None, None, :], (len(points), *shape, 2)).reshape(-1, 2)
    tangent = np.stack([x, y], axis=-1)[None] - points[:, None, None, :] / camera.focus_distance
    tangent = tangent.reshape(-1, 2)
    frame = np.stack([first, second, pupil.normal])
    middle = -float(pupil.center @ pupil.normal)
    reach = 2.2 * HALF / slant
    ends = max(middle - reach, 0.0), middle + reach
    if np.isfinite(camera.distance):
        ends = ends[0], min(ends[1], camera.distance)
    place = np.concatenate([start + tangent * ends[0], np.full((len(start), 1), ends[0])], axis=1)
    direction = np.concatenate([tangent, np.ones((len(start), 1))], axis=1)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    offsets = DIFFERENCE * np.eye(3)

    def index(where: np.ndarray) -> np.ndarray:
        return 1.0 + contrast(pupil.center + where @ frame)

    def change(where: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = np.stack([index(where + each) - index(where - each) for each in offsets], axis=1) / (2.0 * DIFFERENCE)
        return along / along[:, 2:], index(where)[:, None] * slope / along[:, 2:]

    step = (ends[1] - ends[0]) / STEPS
    for _ in range(STEPS):
        a = change(place, direction)
        b = change(place + 0.5 * step * a[0], direction + 0.5 * step * a[1])
        c = change(place + 0.5 * step * b[0], direction + 0.5 * step * b[1])
        d = change(place + step * c[0], direction + step * c[1])
        place = place + step / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
        direction = direction + step / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
    turned = direction[:, :2] / direction[:, 2:]
    if np.isfinite(camera.distance):
        met = place[:, :2] + (camera.distance - ends[1]) * turned
        turned = (met - start) / camera.distance
    return np.asarray((turned - tangent) / camera.pixel_tangent).reshape(len(points), *shape, 2)


def _pupil(rng: np.random.Generator, size: float, center: np.ndarray, normal: np.ndarray) -> Pupil:
    kind = rng.integers(3)
    if kind == 0:
        return Annulus(size, size * rng.uniform(0.2, 0.7), center, normal)
    if kind == 1:
        return Rectangle(2.0 * size, 2.0 * size * rng.uniform(0.3, 1.0), center, normal)
    return Disc(size, center, normal)
