"""The deviation of a tracer from the true rays of the cone scene."""

from typing import Any

import numpy as np

from aerokernels.benchmark.cone import CONE_AMBIENT, CONE_HALF
from aerokernels.benchmark.scenes import WAVELENGTH
from aerokernels.benchmark.truth import Truth

TRUTH_RAYS = 256
# Optical path of an undisturbed ray from face to face [m].
UNDISTURBED = CONE_AMBIENT * 2.0 * CONE_HALF[2]


def chosen_rays(ray_count: int) -> np.ndarray:
    """Up to TRUTH_RAYS row numbers, sorted, of the rays compared with the truth; the same at every call."""
    return np.sort(np.random.default_rng(905).choice(ray_count, min(TRUTH_RAYS, ray_count), replace=False))


def errors(truth: Truth, direction: Any, opd: Any, good: Any = None) -> dict:
    """OPD errors in waves, without removing piston, and the greatest angle error [urad], over the rays that arrived.

    Args:
        truth: The true ends.
        direction: Unit tangents of the same rays, shape (n, 3).
        opd: Their optical paths less the undisturbed ones [m], shape (n,).
        good: Which rays arrived, shape (n,); None for all.
    """
    good = np.ones(len(opd), dtype=bool) if good is None else np.asarray(good)
    found: dict[str, float | None] = dict.fromkeys(("opd_rms_waves", "opd_max_waves", "direction_max_urad"))
    if good.any():
        waves = (np.asarray(opd) - truth.opd)[good] / WAVELENGTH
        angle = np.linalg.norm((np.asarray(direction) - truth.direction)[good], axis=1)
        found["opd_rms_waves"] = float(np.sqrt(np.mean(waves**2)))
        found["opd_max_waves"] = float(np.abs(waves).max())
        found["direction_max_urad"] = float(1e6 * angle.max())
    return {**found, "ray_count": int(good.sum()), "lost_ray_count": int((~good).sum())}
