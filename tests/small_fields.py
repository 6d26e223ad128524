"""Small random fields and the rays that several tests send through them."""

import numpy as np

from aerokernels.medium import IndexField, QuadMesh
from aerokernels.rays import RayBundle
from tests.random_fields import AMBIENT, CELL, noise, on_grid


def random_field(geometry: str, interpolation: str, seed: int, width: float = 3.0, amplitude: float = 3e-4):
    """A small field on grid or mesh, 10 cells across and 13 along z: little work for the reference.

    Its samples are random, smooth over `width` cells; so are the mesh's inner vertices, by up to 0.2 cells.
    """
    across, along = 11, 14
    if interpolation in ("cubic", "linear", "monotone"):
        shape = (across, across, along) if geometry == "volume" else (across, along)
        return on_grid(noise(shape, amplitude, seed, width), geometry, interpolation, AMBIENT)
    low = -5e-4 if geometry == "planar" else 0.0
    y, z = np.meshgrid(low + CELL * np.arange(across), CELL * np.arange(along), indexing="ij")
    shift = np.random.default_rng(seed + 1000).uniform(-0.2 * CELL, 0.2 * CELL, (2, across - 2, along - 2))
    y[1:-1, 1:-1] += shift[0]
    z[1:-1, 1:-1] += shift[1]
    mesh = QuadMesh.structured(y, z, geometry)
    contrast = noise((across, along), amplitude, seed, width)
    return IndexField.from_mesh(mesh, contrast, ambient_index=AMBIENT, interpolation=interpolation)


def oblique_rays(count: int, seed: int = 5) -> RayBundle:
    """Rays from 1 mm ahead of the box into it, within 0.1 rad of the axis."""
    rng = np.random.default_rng(seed)
    position = np.c_[rng.uniform(-0.8e-3, 0.8e-3, (count, 2)), np.full(count, -1e-3)]
    return RayBundle(position, np.c_[rng.normal(0.0, 0.05, (count, 2)), np.ones(count)])
