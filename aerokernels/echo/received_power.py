"""Compute the power that returns to the receiver from each target point."""

import numpy as np

from ..inputs.checks import check_aperture
from ..pupils.base import lengths
from ..scene import Scene
from .paths import TransmitPaths
from .radiometry import plane_echo_power
from .reflectors import lobe_cosine, reflector_of


def point_power(scene: Scene, weight: np.ndarray, paths: TransmitPaths, factor: np.ndarray) -> np.ndarray:
    """Return the peak power of each point's pulse at the receiver [W], shape (m,)."""
    check_aperture(scene.receiver.diameter, scene.target.distance)
    to_receiver = np.array([0.0, 0.0, scene.receiver.aperture_z]) - paths.intersection
    to_receiver = to_receiver / lengths(to_receiver)[:, None]
    lobe = lobe_cosine(paths.direction, scene.target.orientation[:, 2], to_receiver)
    whole = plane_echo_power(
        scene.beam.peak_power,
        scene.receiver.equal_diameter,
        paths.path,
        np.maximum(paths.incidence_cosine, 0.0),
        reflector_of(scene).reflectance(lobe),
        scene.atmosphere.transmission,
        scene.receiver.efficiency,
    )
    return weight * factor * whole
