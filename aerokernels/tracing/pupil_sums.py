"""Sums over a pupil's rays that every backend delivers alike, the plane they define, and the seeds of its points."""

import numpy as np

from ..rays import Disc

# Per replicate: count, x, y, W, xx, xy, yy, xW, yW, WW over the rays that arrived, then the greatest step error and
# the field evaluations of all rays.
MOMENT_COUNT = 12
# Per-ray outputs of the tracer that the sums need, besides the status.
PUPIL_OUTPUTS = frozenset(("opd", "step_error", "evaluation_count"))


def replicate_seeds(seed: int, replicates: int) -> np.ndarray:
    """Seeds of the scramble, uint32, shape (replicates, 2): one for each axis of each replicate."""
    return np.random.default_rng(seed).integers(0, 2**32, size=(replicates, 2), dtype=np.uint32)


def join_groups(rows: np.ndarray) -> np.ndarray:
    """Moments of a replicate, shape (MOMENT_COUNT,), from those of its groups, (group_count, MOMENT_COUNT)."""
    joined = rows.sum(axis=0)
    joined[10] = rows[:, 10].max()
    return joined


def fit_plane(moments: np.ndarray, with_tilt: bool) -> np.ndarray:
    """Height and both rises of the plane that phases are measured from, shape (3,), from all replicates' moments.

    The heights are in the unit of W, the rises in that over the unit of x and y.
    """
    piston, tilt, _, _ = fit_moments(moments.sum(axis=0))
    return np.array([piston, *(tilt if with_tilt else (0.0, 0.0))])


def moments_in_metres(moments: np.ndarray, pupil: Disc) -> np.ndarray:
    """Moments (replicates, MOMENT_COUNT) whose x and y are in units of the pupil's radius, in metres."""
    radius = pupil.radius
    return moments * np.array([1, radius, radius, 1, *[radius**2] * 3, radius, radius, 1, 1, 1])


def fit_moments(total: np.ndarray) -> tuple[float, np.ndarray, float, float]:
    """Piston, tilt, rms about the piston and rms about the plane of a wavefront from its summed moments."""
    count, x, y, w, xx, xy, yy, xw, yw, ww = total[:10] / np.append(1.0, np.full(9, total[0] or 1.0))
    if count == 0:
        return 0.0, np.zeros(2), 0.0, 0.0
    normal = np.array([[xx - x * x, xy - x * y], [xy - x * y, yy - y * y]])
    right = np.array([xw - x * w, yw - y * w])
    tilt = np.linalg.lstsq(normal, right, rcond=1e-12)[0]
    variance = max(ww - w * w, 0.0)
    return float(w), tilt, float(np.sqrt(variance)), float(np.sqrt(max(variance - tilt @ right, 0.0)))
