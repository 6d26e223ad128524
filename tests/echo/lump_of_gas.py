"""A lump of gas ahead of the pupil of the shipped scenes."""

import numpy as np

from aerokernels.medium import IndexField


def lump(strength: float) -> IndexField:
    """A lump of gas ahead of the pupil, off the axis, in a planar field."""
    y, z = np.arange(-0.04, 0.0401, 0.001), np.arange(-0.01, 0.0601, 0.001)
    contrast = strength * np.exp(-((y[:, None] - 0.004) ** 2 + (z - 0.02) ** 2) / 0.01**2)
    return IndexField.from_samples(contrast, origin=(-0.04, -0.01), spacing=(0.001, 0.001), geometry="planar")
