r"""The bilinear map from the unit square to a quadrilateral cell, its inverse, and the test whether a point is inside.

With corners a, b, c, d in order around the cell, xi increasing from a to b and eta from a to d,

    p(xi, eta) = a + xi e + eta f + xi eta g,    e = b - a,  f = d - a,  g = (a - b) + (c - d).
"""

import numpy as np

# Relative tolerance of the containment test, so that a point on an edge belongs to at least one of the two cells.
EDGE_TOLERANCE = 1e-9
# Newton's method converges quadratically: after a step of this size (in xi, eta) only rounding errors remain.
LAST_STEP = 1e-9
MAX_STEPS = 12


def bilinear_point(corners: np.ndarray, xi, eta) -> tuple[np.ndarray, np.ndarray]:
    """Return the point at (xi, eta) of each cell, shape (n, 2), and the Jacobian determinant, shape (n,)."""
    xi, eta = np.asarray(xi)[..., None], np.asarray(eta)[..., None]
    a, b, c, d = (corners[:, k] for k in range(4))
    point = (1 - xi) * (1 - eta) * a + xi * (1 - eta) * b + xi * eta * c + (1 - xi) * eta * d
    along = (1 - eta) * (b - a) + eta * (c - d)
    across = (1 - xi) * (d - a) + xi * (c - b)
    return point, along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]


def invert_bilinear(corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return bilinear coordinates (xi, eta), shape (n,) each, of points in their cells, by Newton's method."""
    xi = np.full(len(points), 0.5)
    eta = np.full(len(points), 0.5)
    # Each component has its own array, because arithmetic on columns of (n, 2) arrays is several times slower.
    a, b, c, d = (corners[:, k].T for k in range(4))
    e0, e1 = b - a
    f0, f1 = d - a
    g0, g1 = (a - b) + (c - d)
    p0, p1 = points.T - a
    for _ in range(MAX_STEPS):
        along0, along1 = e0 + eta * g0, e1 + eta * g1
        miss0, miss1 = xi * along0 + eta * f0 - p0, xi * along1 + eta * f1 - p1
        across0, across1 = f0 + xi * g0, f1 + xi * g1
        rate = 1.0 / (along0 * across1 - along1 * across0)
        step_xi = (miss0 * across1 - miss1 * across0) * rate
        step_eta = (along0 * miss1 - along1 * miss0) * rate
        xi, eta = np.clip(xi - step_xi, -0.5, 1.5), np.clip(eta - step_eta, -0.5, 1.5)
        if max(np.abs(step_xi).max(initial=0.0), np.abs(step_eta).max(initial=0.0)) < LAST_STEP:
            break
    return xi, eta


def contains(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return whether each counter-clockwise convex cell (n, 4, 2) contains its point (n, 2), edges included."""
    x, y = np.ascontiguousarray(np.moveaxis(corners, -1, 0).swapaxes(1, 2))  # (4, n) each
    across, up = np.roll(x, -1, axis=0) - x, np.roll(y, -1, axis=0) - y
    side = across * (points[:, 1] - y) - up * (points[:, 0] - x)
    return (side >= -EDGE_TOLERANCE * (across**2 + up**2)).all(axis=0)
