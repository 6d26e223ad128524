"""Compute the error of an echo's return factor by the pupil's number of rays and the interpolation over the target.

At some of the points on which the beam's power falls, drawn by their shares of it, the factor is computed directly,
with four times as many rays over the pupil. Its changes there have a mean, which counts, and a standard error.
"""

import math

import numpy as np

from ..medium import IndexField
from ..scene import Scene
from ..tracing import Plane
from ..tracing.variants.causes import FACTOR
from .pupil_reduction import reduce_pupils, upper_half
from .result import EchoResult
from .return_paths import factor_of, is_symmetric

# Points; multiple of the rays, and the least number of rays of which it is taken, some sixteen across the pupil.
POINTS, FINER, LEAST_RAYS = 16, 4, 256


def factor_errors(result: EchoResult, scene: Scene, field: IndexField, plane: Plane) -> tuple[float, float, float]:
    """Return errors of an echo's mean Strehl ratio, relative of its return factor, and of its mean path by that [m].

    NaN, infinite and 0 if no ray gets out, or nothing returns. `plane` is the target's.
    """
    kind, pupil = scene.receiver.return_factor, scene.receiver.pupil
    if kind == "none":
        return math.nan, 0.0, 0.0
    points = np.flatnonzero(np.isfinite(result.return_factor) & (result.beam_share > 0.0))
    share = result.beam_share[points] / result.beam_share[points].sum()
    some = np.random.default_rng(0).choice(points, min(POINTS, len(points)), replace=False, p=share)
    place, rays = result.target_point[some], pupil.sample(FINER * max(scene.receiver.ray_count, LEAST_RAYS), "gauss")
    if is_symmetric(field, plane, pupil):
        place, rays = np.column_stack([np.hypot(*place.T[:2]), np.zeros(len(some)), place[:, 2]]), upper_half(*rays)
    try:
        sums = reduce_pupils(scene, field, place, *rays)
    except ValueError:
        return math.nan, math.inf, 0.0
    strehl, mean = _error(result.strehl[some] - sums.strehl), result.beam_mean(result.return_factor)
    if not mean > 0.0:
        return strehl, math.inf, 0.0
    change = (result.return_factor[some] - factor_of(kind, sums.strehl, sums.open_share)) / mean
    path = result.group_path[some] - result.beam_mean(result.group_path)
    return strehl, _error(change), _error(change * path)


def _error(change: np.ndarray) -> float:
    return FACTOR * math.sqrt(float(change.mean()) ** 2 + float(change.var()) / max(len(change) - 1, 1))
