r"""Averages of exact densities over the cells of a rectangular grid.

A density f that depends only on the direction from the origin (a wedge, a plane shock, an expansion fan) is homogeneous
of degree 0. Hence div(f x) = 2 f, and the integral over a cell becomes one over the cell's edges:

    2 int f dA = z+ int_{z+} f dy - z- int_{z-} f dy + y+ int_{y+} f dz - y- int_{y-} f dz

Along an edge f is smooth except where it crosses a shock, a Mach line or a contact. The edge is split there, and each
part is integrated by Gauss's rule. The area behind a shock in a cell is therefore exact at any angle, and so is the
average over a cell at the origin, where a fan has all its densities. Rounding error: 1e-16 of the change within a cell,
times the number of cells from the origin.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

POINTS, SMOOTH_POINTS = 12, 8


def unit_gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and weights of Gauss's rule on the interval from 0 to 1, shape (points,) each."""
    node, weight = np.polynomial.legendre.leggauss(points)
    return 0.5 * (node + 1.0), 0.5 * weight


def piecewise_means(
    function: Callable[[np.ndarray], np.ndarray], edges: np.ndarray, breaks: Sequence[float]
) -> np.ndarray:
    """Return means of a function over the intervals between edges, shape (len(edges) - 1,).

    Args:
        function: Takes an array of any shape; smooth between breaks.
        edges: Increasing, shape (n,).
        breaks: Positions of jumps and kinks.
    """
    share, weight = unit_gauss(POINTS)
    low, high = edges[:-1], edges[1:]
    cuts = np.stack([low, *(np.clip(place, low, high) for place in sorted(breaks)), high])
    start, width = cuts[:-1], np.diff(cuts, axis=0)
    values = function(start[..., None] + width[..., None] * share)
    # Averaging differences from the first value returns a constant function to the last bit.
    first = values[..., 0]
    mean = first + (values - first[..., None]) @ weight
    return (width / (high - low) * mean).sum(axis=0)


def direction_averages(
    function: Callable[[np.ndarray], np.ndarray], breaks: Sequence[float], y: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Return averages over rectangular cells of a function of the direction from the origin.

    Args:
        function: Takes the angle from the downstream direction -z towards +y [rad], -pi to pi.
        breaks: Angles of its jumps and kinks [rad], -pi to pi.
        y: Edges of the cells along y [m], increasing, shape (ny + 1,).
        z: Edges of the cells along z [m], increasing, shape (nz + 1,).

    Returns:
        Averages, shape (ny, nz).
    """
    cosine, sine = np.cos(breaks), np.sin(breaks)
    # Means along the edges of constant y and of constant z: each edge belongs to two cells and is integrated once.
    level = np.empty((len(y), len(z) - 1))
    for row, height in enumerate(y):
        # A break is a ray from the origin: where it meets the line of this height.
        meets = sine * height > 0.0
        places = -height * cosine[meets] / sine[meets]
        level[row] = piecewise_means(partial(_seen_from_origin, function, height), z, places)
    upright = np.empty((len(y) - 1, len(z)))
    for column, depth in enumerate(z):
        meets = -cosine * depth > 0.0
        places = -depth * sine[meets] / cosine[meets]
        upright[:, column] = piecewise_means(partial(_seen_from_origin, function, z=depth), y, places)
    # A constant is homogeneous too: subtracting the value in the middle returns uniform gas to the last bit.
    middle = function(np.arctan2((0.5 * (y[:-1] + y[1:]))[:, None], -0.5 * (z[:-1] + z[1:])))
    across = (z[1:] * (upright[:, 1:] - middle) - z[:-1] * (upright[:, :-1] - middle)) / np.diff(z)
    along = y[1:, None] * (level[1:] - middle) - y[:-1, None] * (level[:-1] - middle)
    return middle + 0.5 * (across + along / np.diff(y)[:, None])


def _seen_from_origin(function, y, z):
    """Return a function of direction at positions (y, z)."""
    return function(np.arctan2(y, -z))


def smooth_averages(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray], y: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Return averages over rectangular cells of a function of (y, z), smooth in each, by a product Gauss rule."""
    share, weight = unit_gauss(SMOOTH_POINTS)
    across = y[:-1, None] + np.diff(y)[:, None] * share
    along = z[:-1, None] + np.diff(z)[:, None] * share
    result = np.empty((len(across), len(along)))
    for row, place in enumerate(across):
        values = function(place[:, None, None], along[None])
        result[row] = np.einsum("inj,i,j->n", values, weight, weight)
    return result
