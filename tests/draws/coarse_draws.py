"""Random fields that their grids barely resolve, 1 to 6 cells a length, with the error of straight lines through them.

A field is a Gaussian blob (its length is sigma), a sine (1 / wavenumber) or a shear (a tanh layer, its thickness), at a
random place or phase, planar, axisymmetric (rings and cones, even in r) or a volume; linear or cubic. Contrasts are
1e-6 to 1e-4, so that rays are straight: the error due to the grid is the integral of the interpolant minus the formula
along the line.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle

CELL = 1e-3
# Pieces of three Gauss points along a line.
PIECES = 200


@dataclass(frozen=True, eq=False)
class CoarseField:
    """A field and its formula.

    Attributes:
        name: Geometry, kind and interpolant.
        field: The samples.
        value: The contrast of the formula at (x, y, z) [m].
        rays: From z = 0; they stay inside the box up to z = `length`.
        length: Side of the box [m].
    """

    name: str
    field: IndexField
    value: Callable[..., np.ndarray]
    rays: RayBundle
    length: float

    def grid_errors(self) -> np.ndarray:
        """Errors of the line integrals due to the grid [m], shape (ray_count,)."""
        gauss, weight = np.polynomial.legendre.leggauss(3)
        share = ((np.arange(PIECES)[:, None] + 0.5 * (gauss + 1.0)) / PIECES).ravel()
        reach = self.length / self.rays.direction[:, 2]
        way = (reach[:, None] * self.rays.direction)[:, None, :]
        points = (self.rays.position[:, None, :] + share[:, None] * way).reshape(-1, 3)
        error = (self.field.contrast_at(points) - self.value(*points.T)).reshape(len(reach), -1)
        return np.asarray(reach * (error @ np.tile(0.5 * weight / PIECES, PIECES)))


def draw(seed: int, least: float = 1.0, most: float = 6.0) -> CoarseField:
    """The field of a seed, `least` to `most` cells a length."""
    rng = np.random.default_rng([seed, 77])
    geometry = ("planar", "axisymmetric", "volume")[seed % 3]
    kind = ("blob", "sine", "shear")[seed // 3 % 3]
    interpolation = ("linear", "cubic")[seed // 9 % 2]
    cells = np.exp(rng.uniform(np.log(least), np.log(most)))
    nodes = int(rng.integers(17, 34 if geometry == "volume" else 49))
    nodes = max(nodes, int((5 if geometry == "volume" else 6) * cells) + 1) if cells > 6.0 else nodes
    size = CELL * (nodes - 1)
    value = _formula(rng, geometry, kind, cells * CELL, size)
    z = CELL * np.arange(nodes)
    axes = {"planar": (z - 0.5 * size, z), "axisymmetric": (z, z), "volume": (z - 0.5 * size, z - 0.5 * size, z)}
    at = np.meshgrid(*axes[geometry], indexing="ij")
    field = IndexField.from_samples(
        value(*[np.zeros_like(at[0])] * (3 - len(at)), *at),
        origin=[axis[0] for axis in axes[geometry]],
        spacing=[CELL] * len(at),
        geometry=geometry,
        interpolation=interpolation,
    )
    return CoarseField(f"{geometry} {kind} {interpolation}", field, value, _rays(rng, size), size)


def _formula(rng, geometry: str, kind: str, length: float, size: float):
    amplitude = 10.0 ** rng.uniform(-6.0, -4.0)
    middle = np.array([0.0, 0.0, 0.5 * size]) + rng.uniform(-0.5, 0.5, 3) * CELL
    way = rng.normal(size=3) * [geometry == "volume" or geometry == "axisymmetric", 1.0, 1.0]
    way, phase, ring = way / np.linalg.norm(way), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 3.0) * length

    def even(x, y, z):
        r, z = np.hypot(x, y) / length, (z - middle[2]) / length
        at = ring / length
        if kind == "blob":
            return amplitude * (np.exp(-0.5 * ((r - at) ** 2 + z**2)) + np.exp(-0.5 * ((r + at) ** 2 + z**2)))
        if kind == "sine":
            return amplitude * np.cos(np.hypot(way[0], way[1]) * r) * np.cos(way[2] * z + phase)
        return amplitude * 0.5 * (np.tanh(r - at) - np.tanh(r + at)) * (1.0 + 0.3 * np.tanh(z))

    def plain(x, y, z):
        x, y, z = ((part - centre) / length for part, centre in zip((x, y, z), middle, strict=True))
        if kind == "blob":
            return amplitude * np.exp(-0.5 * (x * x * (geometry == "volume") + y * y + z * z))
        along = way[0] * x + way[1] * y + way[2] * z
        return amplitude * (np.sin(along + phase) if kind == "sine" else np.tanh(along))

    return even if geometry == "axisymmetric" else plain


def _rays(rng, size: float) -> RayBundle:
    count = int(rng.choice([1, 3, 10, 64]))
    position = np.c_[rng.uniform(-0.28, 0.28, (count, 2)) * size, np.zeros(count)]
    slope = rng.uniform(-0.2, 0.2, (count, 2)) * (rng.random() < 0.6)
    return RayBundle(position, np.c_[slope, np.ones(count)])
