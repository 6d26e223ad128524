"""Test whether the reported error of a random scene covers its actual error.

The scene is traced by the choice of method "auto", in float32. The truth's own error is subtracted from the error
found: for a ray by steps twice as long, for a Strehl ratio by half of the points. Requirement: the reported total
covers the true error of the Strehl ratio, and that of 95 % of the rays, in at least 95 % of the scenes; where it does
not, a status or a warning says so in at least 99 % of the scenes.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from aerokernels.focus.estimate import estimate_strehl
from aerokernels.tracing import RayStatus, trace

from .scene_draws import RAYS, WAVELENGTH, Scene, true_opd

COMPARED = 200


@dataclass(frozen=True)
class Finding:
    """Reported and true error, in waves for rays, as a number for the Strehl ratio."""

    what: str
    true_error: float
    total: float
    flagged: bool

    @property
    def covered(self) -> bool:
        """Whether the reported total is at least the actual error."""
        return self.true_error <= self.total


def check(scene: Scene, backend: str, device: str | None = None) -> list[Finding]:
    """Trace the scene, and its pupil, on a device of a backend."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        result = trace(scene.field, scene.rays, until=scene.stop, backend=backend, device=device)
        total = result.error["total"] / WAVELENGTH
    rows = np.linspace(0, RAYS - 1, COMPARED).astype(int)
    rows = rows[result.ok[rows]]
    start, _ = scene.leave_body(scene.rays.position[rows], scene.rays.direction[rows])
    good = result.status[rows] == RayStatus.OK
    found = []
    if len(rows):
        coarse, truth = (
            true_opd(scene.air, start, scene.rays.direction[rows], scene.stop, h, scene.field)
            for h in (scene.step, 0.5 * scene.step)
        )
        own = np.abs(truth - coarse) / 15.0  # for a method of fourth order
        error = np.maximum(np.abs(result.opd[rows] - truth) - own, 0.0) / WAVELENGTH
        arrived = [name for name in result.status_summary() if name in ("LEFT_DISTURBED_AIR", "TOLERANCE_NOT_MET")]
        flagged = bool(said) or bool(arrived) or not np.isfinite(total)
        most = float(np.quantile(error[good] if good.any() else error, 0.95))
        found.append(Finding("rays", most, total, flagged))
    found += _check_pupil(scene, backend=backend, device=device)
    return found


def _check_pupil(scene: Scene, **engine: str | None) -> list[Finding]:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            seen = estimate_strehl(scene.field, scene.pupil, ray_count=8192, allow_truncation=True, **engine)
        except ValueError:
            return []  # refused: the disturbed air is not met, or everything is blocked
        total = seen.error["total"]
    truth = scene.true_strehl
    if truth is None:
        return []
    value, own = truth
    flagged = bool(said) or not np.isfinite(total) or total > 1.0
    return [Finding("strehl", max(abs(seen.value - value) - own, 0.0), total, flagged)]
