"""Errors of a map, such as a picture, from the rays of some of its pixels.

A pixel's error is FACTOR times the root mean square, over the nearest pixels that were traced again, of what the
changes by each cause make of its number; between them it is interpolated.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..medium import IndexField
from ..rays import RayBundle
from .cuts import lost
from .trace import trace
from .variants.causes import FACTOR, Variants, of_each, variants
from .variants.paths import Rays

# Least and most rays of all pixels, the share of the map's rays between, and least number of pixels.
LEAST_RAYS, MOST_RAYS, SHARE, LEAST_PIXELS = 256, 1024, 1.0 / 16.0, 64
# Pixels about a pixel by which its error is found, and the factor on a root mean square of so many that covers 95 of
# 100 (Student's t), over FACTOR.
NEAR, STUDENT = 12, 2.18 / 2.0
# What the rays bring, those of a pixel one after another -> the number of each pixel, shape (pixels, ...).
PixelNumber = Callable[[Rays], np.ndarray]


class SomePixels:
    """Some pixels of a map, `rows` by `columns` (`place` is both of each), and the rays through them.

    `kept` are the pixels all of whose rays arrived, in random order; `found` their rays and the changes, if there are
    any.
    """

    def __init__(self, shape: tuple[int, int], group: int):
        """Choose pixels of a map that have a number of rays each."""
        self.shape, self.group, step = shape, group, 1
        rays = np.clip(SHARE * np.prod(shape) * group, LEAST_RAYS, MOST_RAYS)
        while np.prod([-(-count // step) for count in shape]) > max(rays // group, LEAST_PIXELS):
            step += 1
        self.rows, self.columns = (np.arange((count - 1) % step // 2, count, step) for count in shape)
        self.place = np.stack(np.meshgrid(self.rows, self.columns, indexing="ij"), axis=-1).reshape(-1, 2)
        self.kept = np.zeros(0, int)
        self.found: Variants | None = None

    def trace(self, field: IndexField, rays: RayBundle, until, options: dict[str, Any]) -> None:
        """Trace the pixels' rays, those of a pixel one after another, to a stop, and find how they change."""
        traced = trace(field, rays, until=until, outputs=("opd", "position", "direction"), bundle="off", **options)
        whole = np.flatnonzero(traced.ok.reshape(-1, self.group).all(axis=1))
        self.kept = np.random.default_rng(0).permutation(whole)
        if not len(whole):
            return
        rows = (self.kept[:, None] * self.group + np.arange(self.group)).ravel()
        assert traced.opd is not None and traced.direction is not None and traced.position is not None  # requested
        base = Rays(traced.opd[rows], traced.direction[rows], traced.position[rows])
        some = rays.rows(rows)
        beyond = lost(field, some, until, (base.position, base.direction))
        self.found = variants(field, some, base, traced.plan, until, traced.wavelength, lost=beyond, group=self.group)

    def errors(self, number: PixelNumber, stored: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Return the errors of a number by cause, shape (pixels, ...) of all pixels.

        `stored` is the whole map where it differs from the number by interpolation between the rays of its bundle only.
        """
        assert self.found is not None
        base = self.found.base
        plain = number(base)
        near = self._near(np.arange(len(plain)))
        errors = of_each(lambda change: number(base + change) - plain, self.found, near)
        errors = {name: STUDENT * error for name, error in errors.items()}
        if stored is not None:
            at = self.place[self.kept]
            errors["bundle"] = self.spread(stored[at[:, 0], at[:, 1]] - plain)
        return errors

    def spread(self, change: np.ndarray) -> np.ndarray:
        """Return the error of all pixels by one change of the first of those that were kept, shape (pixels, ...)."""
        good = np.flatnonzero(np.isfinite(change).reshape(len(change), -1).all(axis=1))
        if not len(good):
            return np.full((len(self.place), *change.shape[1:]), np.nan)
        return np.asarray(STUDENT * FACTOR * np.sqrt((change[good][self._near(good)] ** 2).mean(axis=1)))

    def _near(self, some: np.ndarray) -> np.ndarray:
        """Return for each pixel the numbers of the nearest of some of those kept, shape (pixels, k)."""
        from scipy.spatial import cKDTree

        count = min(NEAR, len(some))
        return cKDTree(self.place[self.kept[some]]).query(self.place, count)[1].reshape(-1, count)

    def whole_map(self, values: np.ndarray) -> np.ndarray:
        """Return the map of values at the pixels, interpolated between them, shape (*shape, ...)."""
        values = values.reshape(len(self.rows), len(self.columns), *values.shape[1:])
        for axis, (count, nodes) in enumerate(zip(self.shape, (self.rows, self.columns), strict=True)):
            hats = np.array([np.interp(np.arange(count), nodes, one) for one in np.eye(len(nodes))])
            values = np.moveaxis(np.tensordot(hats, values, (0, axis)), 0, axis)
        return values


def total(errors: dict[str, np.ndarray]) -> np.ndarray:
    """Return the root sum of squares of errors by cause."""
    return np.asarray(np.sqrt(sum(error**2 for error in errors.values())))
