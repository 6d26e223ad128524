"""Tell air that fades out at a face of its box from air that continues beyond: by the whole face, not by single rays.

Turbulence within a smooth window, or a flow that ends in quiet air, is known up to its end: nothing continues beyond
the face. One ray cannot tell that from a zero of air that continues. Over a whole face the rms of the layers of samples
can: air that continues has an rms in the outermost layer, or, at a zero, a slope of the rms.
"""

import math

import numpy as np

from ...medium import IndexField
from ..lines import FACES, SIDE

# The rms of two layers of the same air may differ by this factor.
SURE = 2.0
# Layers of samples at a face, and the weights of their rms in the rise over two cells from the face on, in third order.
LAYERS = 4
RISE = np.array([-11.0, 18.0, -9.0, 2.0]) / 3.0


def face_shares(field: IndexField) -> np.ndarray:
    """How much of the air within two cells of each of FACES of a uniform grid may continue beyond it, from 0 to 1.

    It is what the rms at the face (times SURE), or the rise of the rms over two cells by its slope at the face, is of
    the greatest rms within these two cells. The slope is one of third order, because air in a window rises as a square.
    """
    return field.derive("face shares", lambda: _find_face_shares(field))


def _find_face_shares(field: IndexField) -> np.ndarray:
    found = np.ones(len(FACES))
    samples = field.samples.samples
    first_axis = 3 - samples.ndim
    for axis, count in enumerate(samples.shape):
        if count < LAYERS:
            continue
        for side in range(2):
            layers = (-1 - layer if side else layer for layer in range(LAYERS))
            rms = np.array([_rms(samples.take(layer, axis)) for layer in layers])
            if (greatest := rms[:-1].max()) > 0.0:
                found[2 * (first_axis + axis) + side] = min(1.0, max(SURE * rms[0], abs(rms @ RISE)) / greatest)
    if field.geometry == "axisymmetric":
        found[SIDE] = found[3]
    return found


def _rms(layer: np.ndarray) -> float:
    values = np.asarray(layer, np.float64).ravel()
    return math.sqrt(float(values @ values) / values.size)


def face_toward(field: IndexField, outward: np.ndarray) -> np.ndarray:
    """Number in FACES of the face of the box behind which places are, by vectors from the box to them, shape (n,)."""
    round_box = field.geometry == "axisymmetric"
    if round_box:
        radius = np.hypot(outward[:, 0], outward[:, 1])
        outward = np.stack([radius, np.zeros(len(outward)), outward[:, 2]], axis=1)
    axis = np.argmax(np.abs(outward), axis=1)
    face = 2 * axis + (outward[np.arange(len(outward)), axis] > 0.0)
    return np.where(axis == 0, SIDE, face) if round_box else face
