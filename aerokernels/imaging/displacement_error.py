"""Errors of a displacement and of a blur, computed again for some pixels whose rays change by each cause.

The rays are those of the aperture's points, or of fewer such points where there are many. The number of points is the
cause "sampling": what another number of points makes of the same pixels.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from ..tracing import trace
from ..tracing.some_pixels import SomePixels, total
from ..tracing.variants.paths import Rays
from .camera import Camera, along, rays_of, scene_plane

# Most points of the aperture whose rays change, and most pixels that another number of points is tried on.
MOST_POINTS, TRIED = 16, 64


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


class PixelErrors:
    """Errors of the maps of a camera's view.

    Attributes:
        pixels: The pixels, their rays and changes.
    """

    def __init__(self, field: IndexField, camera: Camera, shape: tuple[int, int], own: Aperture, options: dict):
        """Trace rays of some pixels of a shape through an aperture's own points."""
        self.field, self.camera, self.options, self.own = field, camera, options, own
        self.few = own if len(own.points) <= MOST_POINTS else _thinned(own)
        self.pixels = SomePixels(shape, len(self.few.points))
        self.pixels.trace(field, self._rays(self.few, self.pixels.place), scene_plane(camera), options)

    def displacement(self, stored: np.ndarray, other: Aperture | None) -> np.ndarray:
        """Return the error of the size of a displacement [pixels], shape (rows, columns).

        Args:
            stored: The displacement [pixels], shape (rows, columns, 2).
            other: Another number of points of the aperture; None for no cause "sampling".
        """
        return np.linalg.norm(self._errors(Aperture.mean, stored, other), axis=-1)

    def blur(self, stored: np.ndarray, other: Aperture) -> np.ndarray:
        """Return the error of a blur along x and y [pixels], shape (rows, columns, 2); arguments as above."""
        return self._errors(Aperture.blur, stored, other)

    def _errors(self, number: Any, stored: np.ndarray, other: Aperture | None) -> np.ndarray:
        pixels = self.pixels
        if pixels.found is None:
            return np.full(stored.shape, np.nan)
        place = pixels.place[pixels.kept]
        errors = pixels.errors(
            lambda rays: number(self.few, self._shifts(self.few, place, rays)),
            stored if self.few is self.own else None,
        )
        if other is not None:
            tried = np.arange(len(place))[:TRIED]
            rays = self._rays(other, place[tried])
            traced = trace(
                self.field, rays, until=scene_plane(self.camera), outputs=("position", "direction"), **self.options
            )
            assert traced.direction is not None and traced.position is not None  # requested
            ends = Rays(np.zeros(rays.ray_count), traced.direction, traced.position)
            at = place[tried]
            change = number(other, self._shifts(other, at, ends)) - stored[at[:, 0], at[:, 1]]
            errors["sampling"] = pixels.spread(change)
        return pixels.whole_map(total(errors))

    def _tangents(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = self.camera.tangents(self.pixels.shape)
        return x[place[:, 1]], y[place[:, 0]]

    def _rays(self, aperture: Aperture, place: np.ndarray) -> RayBundle:
        """Return the rays of all points of the aperture for each pixel at rows and columns (m, 2)."""
        each = [rays_of(self.camera, point, *self._tangents(place)) for point in aperture.points]
        position, direction = (
            np.stack([getattr(one, name) for one in each], axis=1).reshape(-1, 3) for name in ("position", "direction")
        )
        return RayBundle.of_units(position, direction)

    def _shifts(self, aperture: Aperture, place: np.ndarray, rays: Rays) -> np.ndarray:
        """Return where the rays meet the scene less where they would without the flow [pixels], shape (m, n, 2)."""
        camera, points = self.camera, aperture.points
        shape = len(place), len(points), 2
        if np.isfinite(camera.distance):
            met = (camera.across(rays.position - camera.pupil.center).reshape(shape) - points) / camera.distance
        else:
            met = (camera.across(rays.direction) / along(rays.direction, camera.pupil.normal)[:, None]).reshape(shape)
        straight = np.stack(self._tangents(place), axis=1)[:, None] - points / camera.focus_distance
        return np.asarray((met - straight) / camera.pixel_tangent)


def _thinned(aperture: Aperture) -> Aperture:
    """Return points of an aperture, drawn by their shares of the light."""
    chosen = np.random.default_rng(0).choice(len(aperture.weights), MOST_POINTS, replace=False, p=aperture.weights)
    return Aperture(aperture.points[chosen], np.full(MOST_POINTS, 1.0 / MOST_POINTS))
