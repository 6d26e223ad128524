"""Width of a point spread function at half of its maximum, between the samples.

The area above half of the maximum is the one within contours through the samples. Straight lines between them leave out
an area of second order in the sampling, so the area within contours through every second sample gives a better one
(Richardson) and its error. The maximum is that of a paraboloid through the greatest sample and its neighbours.
"""

import numpy as np

# Fewest samples along an axis of which every second one still shows a spot.
FEWEST = 9


def width_at_half(angle: np.ndarray, intensity: np.ndarray) -> tuple[float, float]:
    """Return the full width at half maximum [rad] and its error due to the sampling; NaN if it reaches the edge.

    Args:
        angle: Angles of rows and columns [rad], shape (n,).
        intensity: Intensity, shape (n, n).
    """
    half = 0.5 * _maximum(angle, intensity)
    if max(intensity[0].max(), intensity[-1].max(), intensity[:, 0].max(), intensity[:, -1].max()) >= half:
        return float("nan"), float("nan")
    area = _area_above(half, angle, intensity)
    width = _diameter(area)
    if len(angle) < FEWEST:
        return width, width  # the error is not known: as great as the width
    coarse = _area_above(half, angle[::2], intensity[::2, ::2])
    found = _diameter(area + (area - coarse) / 3.0)
    return found, abs(found - width)


def _diameter(area: float) -> float:
    return 2.0 * float(np.sqrt(abs(area) / np.pi))


def _area_above(level: float, angle: np.ndarray, intensity: np.ndarray) -> float:
    from contourpy import contour_generator

    # Closed contour lines have the higher side to their left, so that holes count negative.
    area = 0.0
    for line in contour_generator(angle, angle, intensity).lines(level):
        x, y = np.asarray(line).T
        area += 0.5 * float(np.sum(x[:-1] * np.diff(y) - y[:-1] * np.diff(x)))
    return area


def _maximum(angle: np.ndarray, intensity: np.ndarray) -> float:
    """Return the greatest intensity between the samples: of a paraboloid about the greatest sample, if it has one."""
    row, column = np.unravel_index(int(np.argmax(intensity)), intensity.shape)
    greatest = float(intensity[row, column])
    if not (0 < row < len(angle) - 1 and 0 < column < len(angle) - 1):
        return greatest
    about = intensity[row - 1 : row + 2, column - 1 : column + 2]
    up, right = (angle[place - 1 : place + 2] - angle[place] for place in (row, column))
    y, x = np.meshgrid(up, right, indexing="ij")
    step = float(max(np.abs(up).max(), np.abs(right).max()))
    x, y = x.ravel() / step, y.ravel() / step
    terms = np.stack([np.ones(9), x, y, x * x, x * y, y * y], axis=1)
    level, in_x, in_y, xx, xy, yy = np.linalg.lstsq(terms, about.ravel(), rcond=None)[0].tolist()
    curved = 4.0 * xx * yy - xy * xy
    if not (xx < 0.0 < curved):
        return greatest
    place = (xy * in_y - 2.0 * yy * in_x) / curved, (xy * in_x - 2.0 * xx * in_y) / curved
    if max(map(abs, place)) > 1.0:
        return greatest
    return max(greatest, level + 0.5 * (in_x * place[0] + in_y * place[1]))
