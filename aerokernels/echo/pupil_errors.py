"""Compute the error of an echo by the number of rays over the receiver's pupil: twice the change with four times as many.

Fewer rays do not tell: a structure of the flow between n rays is between half of them too. It is measured toward the
target's centre and toward points a beam radius beside it, in x and in y; of a set-up that is symmetric about the axis
in x alone, and with half of the pupil.
"""

import math

import numpy as np

from ..medium import IndexField
from ..scene import Scene
from ..tracing import Plane
from ..tracing.variants.spread import FACTOR
from .paths import trace_options
from .pupil_reduction import reduce_pupils, upper_half
from .return_paths import is_symmetric

# Errors cached on a field; the points of the target, and so the error, are the same for all tilts.
KEPT = 8
# Multiple of the rays that measures the error of a mean, and the least number of rays of which it is taken, some
# sixteen across the pupil.
FINER, LEAST_RAYS = 4, 256


def pupil_error(scene: Scene, field: IndexField) -> tuple[float, float]:
    """Return the errors of the mean Strehl ratio and, relative, of the return factor by the number of the pupil's rays.

    NaN and infinite if no ray gets out.
    """
    center = np.array([0.0, 0.0, scene.receiver.aperture_z + scene.target.distance])
    target = center + scene.beam.radius * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    key = ("pupil error", repr(scene.receiver), target.tobytes(), tuple(trace_options(scene).items()))
    found: tuple[float, float] = field.derive(key, lambda: _error(scene, field, target), KEPT)
    return found


def _error(scene: Scene, field: IndexField, target: np.ndarray) -> tuple[float, float]:
    pupil, count = scene.receiver.pupil, scene.receiver.ray_count
    rules = [pupil.sample(rays, "gauss") for rays in (count, FINER * max(count, LEAST_RAYS))]
    if is_symmetric(field, Plane(target[0], (0.0, 0.0, 1.0)), pupil):
        rules, target = [upper_half(*rule) for rule in rules], target[:2]
    try:
        few, many = (reduce_pupils(scene, field, target, *rule) for rule in rules)
    except ValueError:
        return math.nan, math.inf
    light = [
        one.open_share * one.strehl if scene.receiver.return_factor == "strehl" else one.open_share
        for one in (few, many)
    ]
    factor, change = float(light[0].mean()), _rms(light[0] - light[1])
    return FACTOR * _rms(few.strehl - many.strehl), FACTOR * change / factor if factor > 0.0 else math.inf


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
