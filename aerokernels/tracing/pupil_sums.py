"""Sums over a pupil's rays that every backend delivers alike, and the plane they define."""

import numpy as np

# Per replicate: count, x, y, W, xx, xy, yy, xW, yW, WW over the rays that arrived, then the greatest step error and
# the field evaluations of all rays.
MOMENT_COUNT = 12


def fit_moments(total: np.ndarray) -> tuple[float, np.ndarray, float, float]:
    """Piston, tilt, rms about the piston and rms about the plane of a wavefront from its summed moments."""
    count, x, y, w, xx, xy, yy, xw, yw, ww = total[:10] / np.append(1.0, np.full(9, max(total[0], 1.0)))
    if count == 0:
        return 0.0, np.zeros(2), 0.0, 0.0
    normal = np.array([[xx - x * x, xy - x * y], [xy - x * y, yy - y * y]])
    right = np.array([xw - x * w, yw - y * w])
    tilt = np.linalg.lstsq(normal, right, rcond=1e-12)[0]
    variance = max(ww - w * w, 0.0)
    return float(w), tilt, float(np.sqrt(variance)), float(np.sqrt(max(variance - tilt @ right, 0.0)))
