"""Fields of which several files of answers make cases."""

from dataclasses import replace

import numpy as np

from aerokernels.medium import IndexField, QuadMesh
from aerokernels.medium.grid import UniformGrid

from .records import Nudge

# Of inputs of kernels in single precision, whose results differ by more than rounding of the inputs in double.
SINGLE = 1e-6


def nudged(field: IndexField, nudge: Nudge) -> IndexField:
    """Return a field with its values changed by rounding."""
    name = "samples" if isinstance(field.samples, UniformGrid) else "values"
    return replace(field, samples=replace(field.samples, **{name: nudge(getattr(field.samples, name))}))


def lump(nudge: Nudge, strength: float = 2e-5) -> IndexField:
    """A lump of gas ahead of a pupil at the origin, off the axis, in a planar field."""
    y, z = np.arange(-0.04, 0.0401, 0.001), np.arange(-0.01, 0.0601, 0.001)
    contrast = strength * np.exp(-((y[:, None] - 0.004) ** 2 + (z - 0.02) ** 2) / 0.01**2)
    return IndexField.from_samples(nudge(contrast), origin=(-0.04, -0.01), spacing=(0.001, 0.001), geometry="planar")


def ball(nudge: Nudge, geometry: str = "volume", strength: float = 2e-6, center=(0.004, -0.003, 0.02)) -> IndexField:
    """A ball of air of 40 mm in a box of 100 mm that begins 30 mm behind the origin; on the axis where that is one."""
    axes = [np.linspace(-0.05, 0.05, 21), np.linspace(-0.05, 0.05, 25), np.linspace(-0.03, 0.07, 26)]
    if geometry == "axisymmetric":
        axes = [np.linspace(0.0, 0.05, 21), axes[2]]
    elif geometry == "planar":
        axes = axes[1:]
    middle = (0.0, center[2]) if geometry == "axisymmetric" else center[-len(axes) :]
    places = np.meshgrid(*axes, indexing="ij")
    square = sum((place - at) ** 2 for place, at in zip(places, middle, strict=True))
    return IndexField.from_samples(
        nudge(strength * np.exp(-square / 0.015**2)),
        origin=[axis[0] for axis in axes],
        spacing=[axis[1] - axis[0] for axis in axes],
        geometry=geometry,
        ambient_index=1.00027,
    )


def bent_mesh(count: int, geometry: str = "planar") -> QuadMesh:
    """Cells that grow by 4 % from one to the next along one direction, sheared and bent."""
    u, v = np.meshgrid(np.geomspace(1.0, 1.04**count, count) - 1.0, np.linspace(0.0, 1.0, count), indexing="ij")
    u = u / u.max()
    return QuadMesh.structured(0.2 + u + 0.3 * v + 0.1 * u * v, v + 0.1 * np.sin(3.0 * u), geometry)
