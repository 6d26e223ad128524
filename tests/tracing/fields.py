"""Fields that several tracing tests share: random but smooth, one of each kind."""

import numpy as np
from scipy.ndimage import gaussian_filter

from aerokernels.medium import IndexField, QuadMesh
from aerokernels.rays import RayBundle

AMBIENT = 1.0001
CELL = 1e-4


def noise(shape, amplitude, seed=3):
    """Smooth random samples."""
    array = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), 3, mode="nearest")
    return amplitude * array / np.abs(array).max()


def uniform_field(geometry: str, interpolation: str = "cubic", amplitude: float = 3e-4, ambient: float = AMBIENT):
    """A field of about 3 x 3 x 4 mm."""
    shape, origin = {
        "volume": ((31, 29, 41), (-15e-4, -14e-4, 0.0)),
        "planar": ((29, 41), (-14e-4, 0.0)),
        "axisymmetric": ((29, 41), (0.0, 0.0)),
    }[geometry]
    return IndexField.from_samples(
        noise(shape, amplitude),
        origin=origin,
        spacing=(CELL,) * len(shape),
        geometry=geometry,
        ambient_index=ambient,
        interpolation=interpolation,
    )


def mesh_field(interpolation: str = "bilinear", geometry: str = "planar"):
    """A wavy mesh over y in +-1.4 mm (r in 0 to 1.4 mm), z in 0 to 4 mm."""
    low = -14e-4 if geometry == "planar" else 0.0
    y, z = np.meshgrid(np.linspace(low, 14e-4, 29), np.linspace(0.0, 4e-3, 41), indexing="ij")
    wave = 4e-5 * np.sin(z / 3e-4) * np.sin(np.pi * (y - low) / (14e-4 - low))
    mesh = QuadMesh.structured(y + wave, z, geometry)
    return IndexField.from_mesh(mesh, noise((29, 41), 3e-4), ambient_index=AMBIENT, interpolation=interpolation)


def slanted_rays(count: int, seed: int = 5) -> RayBundle:
    """Rays from 1 mm ahead of the box into it, within 0.1 rad of the axis."""
    rng = np.random.default_rng(seed)
    position = np.c_[rng.uniform(-0.8e-3, 0.8e-3, (count, 2)), np.full(count, -1e-3)]
    return RayBundle(position, np.c_[rng.normal(0.0, 0.05, (count, 2)), np.ones(count)])
