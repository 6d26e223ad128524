"""Boxes full of disturbed air, for tests of where a field ends."""

import numpy as np

from aerokernels import IndexField, QuadMesh

WAVE = 905e-9
CONTRAST = 1e-5
HALF, LENGTH = 4e-3, 8e-3
UP = (0.0, 0.0, 1.0)
GEOMETRIES = ("volume", "planar", "axisymmetric")


def box(geometry: str = "volume", scale: float = 1.0, value=None, on_mesh: bool = False) -> IndexField:
    """Contrast CONTRAST (or `value` of the places) within 4 mm of the axis and of z = 0, times `scale`; 9 nodes."""
    across = np.linspace(0.0 if geometry == "axisymmetric" else -HALF, HALF, 9) * scale
    along = np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, 9) * scale
    axes = (across, across, along) if geometry == "volume" else (across, along)
    places = np.meshgrid(*axes, indexing="ij")
    samples = np.full(places[0].shape, CONTRAST) if value is None else value(*places)
    if on_mesh:
        return IndexField.from_mesh(QuadMesh.structured(*places, geometry), samples)
    origin, spacing = [axis[0] for axis in axes], [axis[1] - axis[0] for axis in axes]
    return IndexField.from_samples(samples, origin=origin, spacing=spacing, geometry=geometry)
