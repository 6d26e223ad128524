"""Compute errors of rays over the receiver's pupil, for the errors of an echo.

The error of a mean over n rays of the pupil is twice the greatest change from it to the means over two and four times
as many: where an edge crosses the pupil these have up to half of its error themselves, and one of them may agree with
it by chance. Fewer rays do not tell: a structure of the flow between n rays is between half of them too, and rules of
few rays may have the same rings, whose means over a wavefront without angle are the same.
"""

import math
from collections.abc import Iterator

import numpy as np

from ..medium import IndexField
from ..scene import Scene
from ..strehl.estimate import estimate_strehl
from .paths import trace_options
from .pupil_reduction import PupilSums, reduce_pupils

# Enough for a mean within 1e-3; the error budget traces additional rays.
ESTIMATE_RAYS = 4096
# Errors cached on a field; the points of the target, and so the error, are the same for all tilts.
KEPT = 8
# Multiples of the rays that measure the error of a mean, the least number of rays of which they are taken, some sixteen
# across the pupil, and the factor on the change.
FINER, LEAST_RAYS, SAFETY = (2, 4), 256, 2.0
# A greater share of a pupil is all of it: rounding of a sum of weights.
OPEN = 1.0 - 1e-9


def own_phase_error(scene: Scene, field: IndexField) -> float:
    """Rms phase error [rad] of rays straight ahead through the receiver's pupil, from a small Strehl estimate.

    NaN (not known) if that estimate raises ValueError, for instance because none of its rays arrives.
    """
    pupil = scene.receiver.pupil
    try:
        # The echo was computed, so what the pupil misses is part of its error, and no reason to raise.
        options = trace_options(scene)
        return estimate_strehl(field, pupil, ray_count=ESTIMATE_RAYS, allow_truncation=True, **options).phase_error
    except ValueError:
        return math.nan


def pupil_error(scene: Scene, field: IndexField) -> float:
    """Return the error of a Strehl ratio due to the number of the pupil's rays; NaN if no ray gets out.

    It is the greatest error at the target's centre and a beam radius beside it.
    """
    return _at_target(scene, field)[0]


def is_blocked(scene: Scene, field: IndexField) -> bool:
    """Return whether a body blocks a part of the pupil, also one that falls between the scene's rays.

    More rays are looked at, toward the points of `pupil_error`.
    """
    return field.body is not None and _at_target(scene, field)[1]


def _at_target(scene: Scene, field: IndexField) -> tuple[float, bool]:
    center = np.array([0.0, 0.0, scene.receiver.aperture_z + scene.target.distance])
    target = center + scene.beam.radius * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    key = ("pupil error", repr(scene.receiver), target.tobytes(), tuple(trace_options(scene).items()))
    found: tuple[float, bool] = field.derive(key, lambda: _error_and_block(scene, field, target), KEPT)
    return found


def _error_and_block(scene: Scene, field: IndexField, target: np.ndarray) -> tuple[float, bool]:
    try:
        few, *finer = _with_more_rays(scene, field, target)
    except ValueError:
        return math.nan, True
    error = SAFETY * max(float(np.abs(few.strehl - many.strehl).max()) for many in finer)
    return error, any(bool((sums.open_share < OPEN).any()) for sums in (few, *finer))


def open_share_error(scene: Scene, field: IndexField, target: np.ndarray, weight: np.ndarray) -> float:
    """Relative error of the pupil's open share, as a weighted mean over target points [m], shape (k, 3).

    The edge of a body that blocks a part of the pupil is a step, at which a quadrature converges slowly. Infinite if no
    ray gets out.
    """
    try:
        few, *finer = (float(weight @ sums.open_share) for sums in _with_more_rays(scene, field, target))
    except ValueError:
        return math.inf
    return SAFETY * max(abs(few - many) for many in finer) / few if few > 0.0 else math.inf


def _with_more_rays(scene: Scene, field: IndexField, target: np.ndarray) -> Iterator[PupilSums]:
    """Yield the sums over the pupil's rays, and over some times as many, for target points [m], shape (k, 3).

    Raises:
        ValueError: No ray gets out toward any of the points.
    """
    pupil, count = scene.receiver.pupil, scene.receiver.ray_count
    for rays in (count, *(factor * max(count, LEAST_RAYS) for factor in FINER)):
        yield reduce_pupils(scene, field, target, *pupil.sample(rays, "gauss"))
