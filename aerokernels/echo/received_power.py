"""The power that comes back to the receiver: each target point's peak, and the whole echo in vacuum."""

import numpy as np

from ..scene import Scene
from .checks import check_aperture
from .paths import TransmitPaths
from .pulses import PulseShape
from .radiometry import plane_echo_power
from .reflectors import lobe_cosine, reflector_of
from .waveform import SPEED_OF_LIGHT, sum_of_pulses


def vacuum_power(
    scene: Scene, pulse: PulseShape, weight: np.ndarray, vacuum: TransmitPaths, time: np.ndarray, later: float = 0.0
) -> np.ndarray:
    """Received power [W] of the scene's echo in vacuum, of the shape of `time` [s]; `later` by that time [s]."""
    peak = point_power(scene, weight, vacuum, np.ones(len(weight)))
    return sum_of_pulses(time, 2.0 * vacuum.path / SPEED_OF_LIGHT + later, peak, pulse)


def point_power(scene: Scene, weight: np.ndarray, paths: TransmitPaths, factor: np.ndarray) -> np.ndarray:
    """Peak power of each point's pulse at the receiver [W], shape (m,)."""
    check_aperture(scene.receiver.diameter, scene.target.distance)
    to_receiver = np.array([0.0, 0.0, scene.receiver.aperture_z]) - paths.intersection
    to_receiver = to_receiver / np.linalg.norm(to_receiver, axis=1, keepdims=True)
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
