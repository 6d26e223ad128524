"""Errors of a displacement and of a blur, computed again for some pixels whose rays change by each cause; cut views."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..inputs.checks import warn_caller
from ..medium import IndexField
from ..rays import RayBundle
from ..tracing import trace
from ..tracing.cuts import lost, may_lose
from ..tracing.pupil.air import GREATEST_SHARE
from ..tracing.some_pixels import SomePixels, total
from ..tracing.variants.paths import Rays
from .camera import Aperture, Camera

# Most points of the aperture whose rays change.
MOST_POINTS = 16


@dataclass(frozen=True, eq=False)
class KnownView:
    """A camera in front of a field: finds the pixels that look through disturbed air that was cut off the field."""

    field: IndexField
    camera: Camera
    aperture: Aperture
    tolerance: float  # greatest OPD that a ray may lose by cuts [m]

    def truncated(self, shape: tuple[int, int], stride: tuple[int, int] = (1, 1)) -> np.ndarray:
        """Return the share of the aperture that loses more than the tolerance, for every `stride`-th pixel."""
        x, y = (axis[step // 2 :: step] for axis, step in zip(self.camera.tangents(shape), stride[::-1], strict=True))
        found = np.zeros((len(y), len(x)))
        if not may_lose(self.field, self.tolerance):
            return found
        across, up = (axis.ravel() for axis in np.meshgrid(x, y))
        for point, weight in zip(self.aperture.points, self.aperture.weights, strict=True):
            rays = self.camera.rays(point, across, up)
            amount = lost(self.field, rays, self.camera.scene_plane, tolerance=self.tolerance)
            found.ravel()[np.abs(amount) > self.tolerance] += weight
        return found

    def check(self, shape: tuple[int, int], allowed: bool) -> None:
        """Check that at most a thousandth of a view is truncated, unless more is allowed; warn of less."""
        if allowed:
            return
        stride = tuple(max(1, count // 32) for count in shape)
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


class PixelErrors:
    """Errors of the maps of a camera's view."""

    def __init__(self, field: IndexField, camera: Camera, shape: tuple[int, int], own: Aperture, options: dict):
        """Trace rays of some pixels of a shape through an aperture's own points."""
        self.field, self.camera, self.options, self.own = field, camera, options, own
        self.few = own if len(own.points) <= MOST_POINTS else _thinned(own)
        self.pixels = SomePixels(shape, len(self.few.points))
        self.pixels.trace(field, self._rays(self.few, self.pixels.place), camera.scene_plane, options)

    def displacement(self, stored: np.ndarray, other: Aperture | None) -> np.ndarray:
        """Return the error of the size of a displacement [pixels]; `other` points of the aperture tell its sampling."""
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
            tried = np.arange(len(place))[:64]
            rays = self._rays(other, place[tried])
            traced = trace(
                self.field, rays, until=self.camera.scene_plane, outputs=("position", "direction"), **self.options
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
        each = [self.camera.rays(point, *self._tangents(place)) for point in aperture.points]
        position, direction = (
            np.stack([getattr(one, name) for one in each], axis=1).reshape(-1, 3) for name in ("position", "direction")
        )
        return RayBundle.of_units(position, direction)

    def _shifts(self, aperture: Aperture, place: np.ndarray, rays: Rays) -> np.ndarray:
        """Return the shifts of the rays [pixels], shape (m, n, 2)."""
        count = len(aperture.points)
        x, y = (np.repeat(tangent, count) for tangent in self._tangents(place))
        ends = rays.position if np.isfinite(self.camera.distance) else rays.direction
        shifts = self.camera.shift(ends, np.tile(aperture.points, (len(place), 1)), x, y)
        return shifts.reshape(len(place), count, 2)


def _thinned(aperture: Aperture) -> Aperture:
    """Return points of an aperture, drawn by their shares of the light."""
    chosen = np.random.default_rng(0).choice(len(aperture.weights), MOST_POINTS, replace=False, p=aperture.weights)
    return Aperture(aperture.points[chosen], np.full(MOST_POINTS, 1.0 / MOST_POINTS))
