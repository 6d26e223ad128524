"""Errors of the light over the receiver's pupil, for the errors of an echo."""

import numpy as np

from ..medium import IndexField
from ..rays import Disc
from ..scene import Scene
from ..strehl import estimate_strehl
from .pupil_reduction import reduce_pupils

# Enough for a mean within 1e-3 and an error budget, which takes rays of its own.
ESTIMATE_RAYS = 4096


def own_phase_error(scene: Scene, field: IndexField) -> float:
    """Rms phase error [rad] of rays straight ahead through the receiver's pupil, from a small Strehl estimate."""
    table = scene.trace
    estimate = estimate_strehl(
        field,
        Disc(0.5 * scene.receiver.diameter, np.array([0.0, 0.0, scene.receiver.aperture_z])),
        wavelength=scene.flow.wavelength,
        ray_count=ESTIMATE_RAYS,
        method=table.method,
        tolerance=table.tolerance,
        step=table.step,
        max_steps=table.max_steps,
        backend=table.backend,
        device=table.device,
        precision=table.precision,
    )
    return estimate.phase_error


def pupil_error(scene: Scene, field: IndexField) -> float:
    """Change of the Strehl ratio of the target's centre when half of the rays over the pupil are left out.

    The rule with all of them is better than that: its error is smaller.
    """
    pupil = Disc(0.5 * scene.receiver.diameter, center=np.array([0.0, 0.0, scene.receiver.aperture_z]))
    center = np.array([[0.0, 0.0, scene.receiver.aperture_z + scene.target.distance]])
    count = scene.receiver.ray_count
    ratios = [
        float(reduce_pupils(scene, field, center, *pupil.sample(rays, "gauss")).strehl[0])
        for rays in (count, max(count // 2, 1))
    ]
    return abs(ratios[0] - ratios[1])
