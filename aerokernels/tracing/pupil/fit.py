"""Evaluate the moments of a pupil's rays: convert them to metres, and fit piston, tilt and focus."""

import math

import numpy as np

from .sums import MOMENT_COUNT, PupilTask

# Coordinates of the surfaces are x, y and q = x^2 + y^2; these are the coordinates of each term.
COLUMNS = {"piston": (), "tilt": (0, 1), "focus": (2,)}
# The power of length in each of the moments.
LENGTHS = np.array([0, 1, 1, 0, 2, 2, 2, 1, 1, 0, 0, 0, 3, 3, 4, 2])
assert len(LENGTHS) == MOMENT_COUNT
# Moments that are zero where everything is symmetric about the axis.
ODD = np.array([1, 2, 5, 7, 8, 12, 13])


def fit_surface(moments: np.ndarray, terms: tuple[str, ...]) -> np.ndarray:
    """Fit the surface from which phases are measured to all replicates' moments: height, two slopes, focus, shape (4,).

    The height is in the unit of W, the slopes in that unit over the unit of x and y, the focus over its square.
    """
    total = moments.sum(axis=0)
    slopes, _ = fit_terms(total, terms)
    height = total[3] / total[0] if total[0] else 0.0
    return np.array([height, *slopes])


def metres_of(task: PupilTask) -> np.ndarray:
    """Factors that convert moments, whose x and y are in units of the pupil's reach, to metres, (MOMENT_COUNT,)."""
    factors: np.ndarray = task.pupil.reach**LENGTHS
    return factors


def moments_in_metres(moments: np.ndarray, task: PupilTask, factors: np.ndarray | None = None) -> np.ndarray:
    """Convert moments (replicates, MOMENT_COUNT), whose x and y are in units of the pupil's reach, to metres.

    Moments of radial quadrature, whose points all lie along x, are converted to those of the whole disc. `factors` are
    those of `metres_of`, if they are known, with more of them if the moments are followed by other sums.
    """
    moments = moments * (metres_of(task) if factors is None else factors)
    if task.is_radial:
        moments[:, ODD] = 0.0
        moments[:, 4] *= 0.5
        moments[:, 6] = moments[:, 4]
    return moments


def fit_moments(total: np.ndarray) -> tuple[float, np.ndarray, float, float]:
    """Piston, tilt, rms about the piston and rms about the plane of a wavefront from its summed moments."""
    # In Python floats: for a symmetric pupil a few NumPy calls would take as long as the whole estimate.
    count, *sums = total[:10].tolist()
    if count == 0:
        return 0.0, np.zeros(2), 0.0, 0.0
    x, y, w, xx, xy, yy, xw, yw, ww = [number / count for number in sums]
    a, b, c = xx - x * x, xy - x * y, yy - y * y
    right, up = xw - x * w, yw - y * w
    determinant = a * c - b * b
    if determinant > 1e-12 * max(a, c) ** 2:
        along, across = (c * right - b * up) / determinant, (a * up - b * right) / determinant
    else:  # all points on one line, or a single point
        along, across = np.linalg.lstsq(np.array([[a, b], [b, c]]), np.array([right, up]), rcond=1e-12)[0].tolist()
    variance = max(ww - w * w, 0.0)
    about_plane = variance - along * right - across * up
    return w, np.array([along, across]), math.sqrt(variance), math.sqrt(max(about_plane, 0.0))


def rms_about(
    total: np.ndarray, terms: tuple[str, ...], fit: tuple[float, np.ndarray, float, float] | None = None
) -> float:
    """Return the rms about the surface of these terms that `fit_terms` fits.

    `fit` is the result of `fit_moments`, if it is known.
    """
    if "focus" in terms:
        return fit_terms(total, terms)[1]
    _, _, about_piston, about_plane = fit_moments(total) if fit is None else fit
    return about_plane if "tilt" in terms else about_piston


def fit_terms(total: np.ndarray, terms: tuple[str, ...]) -> tuple[np.ndarray, float]:
    """Fit a surface of these terms: slopes along x, y and x^2 + y^2, shape (3,), and the rms about the surface.

    Slopes of terms that are not named are 0. The mean is always fitted; whether "piston" is named changes nothing.
    """
    slopes = np.zeros(3)
    if "focus" not in terms:
        _, tilt, about_piston, about_plane = fit_moments(total)
        if "tilt" not in terms:
            return slopes, about_piston
        slopes[:2] = tilt
        return slopes, about_plane
    if total[0] == 0:
        return slopes, 0.0
    chosen = [column for term in terms for column in COLUMNS[term]]
    x, y, w, xx, xy, yy, xw, yw, ww = total[1:10] / total[0]
    xq, yq, qq, qw = total[12:16] / total[0]
    q = xx + yy
    mean = np.array([x, y, q])
    matrix = np.array([[xx, xy, xq], [xy, yy, yq], [xq, yq, qq]]) - np.outer(mean, mean)
    right = np.array([xw, yw, qw]) - mean * w
    size = math.sqrt(q) or 1.0  # the unit in which all columns are of similar size
    scale = np.array([size, size, size * size])
    matrix, right = matrix / np.outer(scale, scale), right / scale
    found = np.linalg.lstsq(matrix[np.ix_(chosen, chosen)], right[chosen], rcond=1e-12)[0]
    slopes[chosen] = found / scale[chosen]
    return slopes, math.sqrt(max(ww - w * w - float(found @ right[chosen]), 0.0))
