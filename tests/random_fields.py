"""Random smooth fields of each kind, shared by several tracing tests."""

import numpy as np
from scipy.ndimage import gaussian_filter

from aerokernels.medium import IndexField, QuadMesh

AMBIENT = 1.0001
CELL = 1e-4


def noise(shape, amplitude, seed=3, width=3.0):
    """Random samples, smooth over `width` cells."""
    array = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), width, mode="nearest")
    return amplitude * array / np.abs(array).max()


def on_grid(samples: np.ndarray, geometry: str, interpolation: str, ambient: float) -> IndexField:
    """Samples on a grid centred on the z axis that starts at z = 0."""
    across = 0.0 if geometry == "axisymmetric" else -0.5 * CELL * (np.array(samples.shape[:-1]) - 1)
    return IndexField.from_samples(
        samples,
        origin=(*np.broadcast_to(across, samples.ndim - 1), 0.0),
        spacing=(CELL,) * samples.ndim,
        geometry=geometry,
        ambient_index=ambient,
        interpolation=interpolation,
    )


def uniform_field(geometry: str, interpolation: str = "cubic", amplitude: float = 3e-4, ambient: float = AMBIENT):
    """A field of about 3 x 3 x 4 mm."""
    shape = (31, 29, 41) if geometry == "volume" else (29, 41)
    return on_grid(noise(shape, amplitude), geometry, interpolation, ambient)


def mesh_field(interpolation: str = "bilinear", geometry: str = "planar"):
    """A wavy mesh over y in +-1.4 mm (r in 0 to 1.4 mm), z in 0 to 4 mm."""
    low = -14e-4 if geometry == "planar" else 0.0
    y, z = np.meshgrid(np.linspace(low, 14e-4, 29), np.linspace(0.0, 4e-3, 41), indexing="ij")
    wave = 4e-5 * np.sin(z / 3e-4) * np.sin(np.pi * (y - low) / (14e-4 - low))
    mesh = QuadMesh.structured(y + wave, z, geometry)
    return IndexField.from_mesh(mesh, noise((29, 41), 3e-4), ambient_index=AMBIENT, interpolation=interpolation)
