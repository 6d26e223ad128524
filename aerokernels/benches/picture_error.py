"""Error of the brightness of a picture's pixels, without noise of the sensor.

Rays of some pixels are traced again, with how they change by each cause (tracing/some_pixels.py), and the same light
is made of them. What few rays leave out of a pixel's mean is the cause "sampling": h rays apart, a smooth light is off
by a 24th of its second difference over h^2, and where it jumps, as its fourth difference tells, by two fifths over h.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from ..tracing.some_pixels import SomePixels, total
from ..tracing.variants.causes import FACTOR
from ..tracing.variants.paths import Rays
from .bench import Bench
from .line_of_sight import LineOfSight, ParallelLight, Window

# Most rays along a side of a pixel that are traced again.
MOST_RAYS = 3
# Error of a mean over a pixel by one ray, as a share of the second difference, where light jumps; and where it is
# smooth: of rays that are seen at their pixel; of light spread evenly on squares between rays; and if that light is
# also a mean of the squares' corners.
JUMPING, SMOOTH, SPREAD, OF_CORNERS = 0.4, 1.0 / 24.0, 1.0 / 12.0, 5.0 / 24.0
# The fourth difference of a jump over its second.
OF_A_JUMP = 3.0


@dataclass(frozen=True, eq=False)
class SomeLight:
    """Rays of some pixels; arrays of shape (pixels, rays, ...)."""

    window: Window  # the picture's window
    wavelength: float  # vacuum wavelength [m]
    focus: float  # coordinate of the focal plane along the light [m]
    place: np.ndarray  # undisturbed places toward right and up [m]
    deflection: np.ndarray  # deflections toward right and up [rad]
    displacement: np.ndarray  # displacements in the focal plane toward right and up [m]
    opd: np.ndarray  # optical path differences seen there [m]

    @property
    def ray_grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Undisturbed places of the rays along right and up [m], each of shape (pixels, rays)."""
        return self.place[..., 0], self.place[..., 1]


class Kind(Protocol):
    """A kind of picture: makes the light of pixels of their rays."""

    def light_of(self, some: SomeLight) -> np.ndarray:
        """Return the light of some pixels, 1 for full light, shape (pixels,)."""


def shared_attributes(
    kind: Kind,
    traced: LineOfSight,
    light: np.ndarray,
    exposure: float,
    bench: Bench | None = None,
    known: np.ndarray | None = None,
    **of_error: Any,
) -> dict[str, Any]:
    """Return the attributes of a `TracedPicture` of some light, shape (ny, nx), as a bench's sensor sees it.

    `traced` are the rays that were traced, of a bench those of its source's middle point. `known` is by default theirs;
    `of_error` has arguments of `picture_error`.
    """
    light = exposure * light
    brightness = np.clip(light, 0.0, 1.0)
    # Light above white included: a sensor may not be saturated by it.
    exposed = brightness if bench is None or bench.sensor is None else bench.sensor.expose(light, bench.seed)
    hidden = traced.pixel_mean(traced.through.astype(np.float64)) == 0.0
    window = traced.window
    return {
        "horizontal": window.horizontal,
        "vertical": window.vertical,
        "right": window.right,
        "up": window.up,
        "blocked": traced.pixel_mean(traced.blocked.astype(np.float64)) > 0.5,  # more than half of the pixel
        "known": traced.known if known is None else known,
        "intensity": exposed,
        "exposure": float(exposure),
        "measure_error": partial(picture_error, brightness, hidden, traced.light, kind, exposure, **of_error),
    }


def picture_error(
    shown: np.ndarray,  # the brightness, shape (ny, nx)
    hidden: np.ndarray,  # pixels without light, shape (ny, nx)
    light: ParallelLight,
    kind: Kind,
    exposure: float,
    square: float | None = None,  # side of the squares at whose corners rays are [m]; None takes the pixel's own rays
    curved: float = SMOOTH,  # error of a mean over a pixel by one ray, as a share of the second difference
    is_same: bool = True,  # whether the picture is made of the pixels' own rays alone
) -> np.ndarray:
    """Return the error of a picture's brightness, shape (ny, nx)."""
    k, window = light.rays_per_pixel, light.window
    few = min(k, MOST_RAYS)
    inner = (np.arange(few) - 0.5 * (few - 1)) / few
    lines = [inner * pitch if square is None else np.array([-0.5, 0.5]) * square for pitch in window.pitch]
    right, up = (line.ravel() for line in np.meshgrid(*lines))
    pixels = SomePixels(shown.shape, len(right))
    row, column = pixels.place.T
    place = np.stack([window.horizontal[column][:, None] + right, window.vertical[row][:, None] + up], axis=-1)
    pixels.trace(light.field, light.rays(place[..., 0], place[..., 1]), light.until, light.options)
    sampling = _sampling(shown, k, curved)
    if pixels.found is None:
        return sampling
    kept, wavelength = place[pixels.kept], light.field.wavelength_for(light.options["wavelength"])

    def brightness(rays: Rays) -> np.ndarray:
        seen = light.seen(kept[..., 0], kept[..., 1], rays)
        some = SomeLight(window, wavelength, light.focus, kept, *seen)
        return np.clip(exposure * kind.light_of(some), 0.0, 1.0)

    errors = pixels.errors(brightness, shown if square is None and few == k and is_same else None)
    return np.hypot(np.where(hidden, 0.0, pixels.whole_map(total(errors))), sampling)


def light_on_squares(some: SomeLight, shift: np.ndarray, share: np.ndarray | None = None) -> np.ndarray:
    """Return the irradiance on the squares of some pixels' rays, 1 where nothing is shifted, shape (pixels,).

    `shift` displaces the landing points of the corners' rays [m], (pixels, 4, 2); `share` of their light is
    transmitted.
    """
    before, after = (_area(corners) for corners in (some.place, some.place + shift))
    lit = 1.0 if share is None else share.mean(axis=1)
    return np.asarray(lit * before / np.maximum(np.abs(after), 1e-300))


def _area(corners: np.ndarray) -> np.ndarray:
    """Return twice the areas of quadrilaterals, shape (n,), of corners row by row, shape (n, 4, 2)."""
    one, other = corners[:, 3] - corners[:, 0], corners[:, 2] - corners[:, 1]
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])


def _sampling(shown: np.ndarray, k: int, curved: float) -> np.ndarray:
    """Return the error of a picture by k x k rays for each pixel, of its shape."""
    from scipy.ndimage import uniform_filter

    second, fourth = (np.array([_difference(shown, axis, order) for axis in (0, 1)]) for order in (2, 4))
    smooth = curved * second.sum(axis=0) / k**2
    size = np.abs(second)
    jumps = np.minimum(1.0, np.abs(fourth) / (OF_A_JUMP * np.maximum(size, 1e-300))) ** 2
    jumping = JUMPING * (size * jumps).sum(axis=0) / k
    square = uniform_filter(smooth**2 + jumping**2, 3, mode="nearest")
    return np.asarray(FACTOR * np.sqrt(np.maximum(square, 0.0)))  # running sums round below 0


def _difference(values: np.ndarray, axis: int, order: int) -> np.ndarray:
    """Return differences of an even order about each value; beyond the ends those nearest to them."""
    if values.shape[axis] <= order:
        return np.zeros(values.shape)
    width = [(order // 2, order // 2) if one == axis else (0, 0) for one in (0, 1)]
    return np.pad(np.diff(values, order, axis=axis), width, mode="edge")
