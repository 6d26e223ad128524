"""Compute errors of rays over the receiver's pupil, for the errors of an echo."""

import math

import numpy as np

from ..medium import IndexField
from ..scene import Scene
from ..strehl.estimate import estimate_strehl
from .paths import trace_options
from .pupil_reduction import reduce_pupils

# Enough for a mean within 1e-3; the error budget traces additional rays.
ESTIMATE_RAYS = 4096
# Errors cached on a field; the target's centre, and so its error, is the same for all tilts.
KEPT = 8


def own_phase_error(scene: Scene, field: IndexField) -> float:
    """Rms phase error [rad] of rays straight ahead through the receiver's pupil, from a small Strehl estimate.

    NaN (not known) if that estimate raises ValueError, for instance because none of its rays arrives.
    """
    pupil = scene.receiver.pupil
    try:
        # The echo was computed, so a loss where the known air ends is part of its error, and no reason to raise.
        options = trace_options(scene)
        return estimate_strehl(field, pupil, ray_count=ESTIMATE_RAYS, allow_truncation=True, **options).phase_error
    except ValueError:
        return math.nan


def pupil_error(scene: Scene, field: IndexField) -> float:
    """Change of the Strehl ratio at the target's centre when half of the pupil's rays are left out.

    This is more than the error with all rays. NaN if no ray gets out.
    """
    center = (0.0, 0.0, scene.receiver.aperture_z + scene.target.distance)
    key = ("pupil error", repr(scene.receiver), center, tuple(trace_options(scene).items()))
    return float(field.derive(key, lambda: _halving_error(scene, field, np.array([center])), KEPT))


def _halving_error(scene: Scene, field: IndexField, center: np.ndarray) -> float:
    pupil, count = scene.receiver.pupil, scene.receiver.ray_count
    try:
        ratios = [
            float(reduce_pupils(scene, field, center, *pupil.sample(rays, "gauss")).strehl[0])
            for rays in (count, max(count // 2, 1))
        ]
    except ValueError:
        return math.nan
    return abs(ratios[0] - ratios[1])


def open_share_error(scene: Scene, field: IndexField, target: np.ndarray, weight: np.ndarray) -> float:
    """Relative error of the pupil's open share, as a weighted mean over target points [m], shape (k, 3).

    The edge of a body that blocks a part of the pupil is a step, at which a quadrature converges slowly. The error is
    the greatest change when a third or half of the pupil's rays are left out; infinite if no ray gets out then.
    """
    pupil, count = scene.receiver.pupil, scene.receiver.ray_count
    try:
        shares = [
            float(weight @ reduce_pupils(scene, field, target, *pupil.sample(rays, "gauss")).open_share)
            for rays in (count, max(2 * count // 3, 1), max(count // 2, 1))
        ]
    except ValueError:
        return math.inf
    return max(abs(shares[0] - other) for other in shares[1:]) / shares[0] if shares[0] > 0.0 else math.inf
