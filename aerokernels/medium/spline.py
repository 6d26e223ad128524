"""Coefficients of the tensor-product interpolants on a uniform grid.

Along each axis a cell uses `support` consecutive coefficients from `stride` times its index on: "linear" the samples,
"cubic" a C2 B-spline with not-a-knot ends, "monotone" value and limited slope of a C1 Hermite interpolant in the range
of the cell's corners. References: C. de Boor, A Practical Guide to Splines (2001); F. N. Fritsch and R. E. Carlson,
SIAM J. Numer. Anal. 17 (1980) 238.
"""

from collections.abc import Callable
from functools import partial
from itertools import product

import numpy as np

from aerokernels.process.threads import in_threads, slabs

INTERPOLATIONS = ("cubic", "linear", "monotone")
SUPPORT = {"linear": 2, "cubic": 4, "monotone": 4}
STRIDE = {"linear": 1, "cubic": 1, "monotone": 2}
BAND = 4  # diagonals on either side of the main one in the spline's matrices: the extent of an end row


def weights(interpolation: str, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return weights and their derivatives with respect to u, each of shape (support, *u.shape)."""
    v = 1.0 - u
    if interpolation == "linear":
        value, slope = [v, u], [-np.ones_like(u), np.ones_like(u)]
    elif interpolation == "cubic":
        value = [v**3 / 6, (3 * u**3 - 6 * u**2 + 4) / 6, (3 * v**3 - 6 * v**2 + 4) / 6, u**3 / 6]
        slope = [-(v**2) / 2, (3 * u**2 - 4 * u) / 2, -(3 * v**2 - 4 * v) / 2, u**2 / 2]
    else:
        value = [(1 + 2 * u) * v**2, u * v**2, u**2 * (3 - 2 * u), -(u**2) * v]
        slope = [-6 * u * v, v * (1 - 3 * u), 6 * u * v, u * (3 * u - 2)]
    return np.stack(value), np.stack(slope)


def coefficients(
    samples: np.ndarray,
    interpolation: str,
    even_first_axis: bool,
    value_of: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Return the coefficient array of values at nodes, float32 if the samples are, else float64; computed in float64.

    `even_first_axis` mirrors the field at the first node of axis 0; `value_of` gives the values, float64, of some
    samples.
    """
    value_of = value_of or partial(np.asarray, dtype=np.float64)
    kind = np.dtype(np.float32 if samples.dtype == np.float32 else np.float64)
    if interpolation == "cubic":
        return _spline(samples, even_first_axis, value_of, np.empty([count + 2 for count in samples.shape], kind))
    values = value_of(samples)
    result = values if interpolation == "linear" else _limited_hermite(values, even_first_axis)
    return np.ascontiguousarray(result, kind)


def _spline(samples: np.ndarray, even_first_axis: bool, value_of, result: np.ndarray) -> np.ndarray:
    """Fill an array with the coefficients of the spline, along the first axis and then along the others, by slabs."""
    sides = samples.shape[1:]
    inner = result[(slice(None), *(slice(1, -1) for _ in sides))]

    def along_first(part: slice) -> None:
        inner[:, part] = spline_along(value_of(samples[:, part]), 0, even_first_axis)

    def along_others(rows: slice) -> None:
        values = np.asarray(inner[rows], np.float64)
        for axis in range(1, samples.ndim):
            values = spline_along(values, axis, False)
        result[rows] = values

    if not sides:
        return spline_along(value_of(samples), 0, even_first_axis)
    in_threads(along_first, slabs(sides[0], result.size))
    in_threads(along_others, slabs(len(result), result.size))
    return result


def end_conditions(count: int, even_start: bool) -> np.ndarray:
    """Return the matrix for the n + 2 B-spline coefficients along an axis of n nodes, with only its end rows filled.

    Stored by diagonals, entry (i, j) at [BAND + i - j, j]. An end row demands mirror symmetry, or no jump of the third
    derivative at the second node (for two or three nodes no second or third derivative).
    """
    matrix = np.zeros((2 * BAND + 1, count + 2))
    if count >= 4:
        row = [1.0, -4.0, 6.0, -4.0, 1.0]
    elif count == 3:
        row = [-1.0, 3.0, -3.0, 1.0]
    else:
        row = [1.0, -2.0, 1.0]
    fill_row(matrix, count + 1, count + 2 - len(row), row)
    fill_row(matrix, 0, 0, [1.0, 0.0, -1.0] if even_start else row)
    return matrix


def fill_row(matrix: np.ndarray, row: int, first_column: int, entries) -> None:
    """Set consecutive entries of a row of a matrix stored by diagonals."""
    column = first_column + np.arange(len(entries))
    matrix[BAND + row - column, column] = entries


def solve_along(matrix: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
    """Solve for all lines of `values` along an axis, with zero right-hand sides of both end rows; that axis first."""
    from scipy.linalg import solve_banded

    moved = np.moveaxis(values, axis, 0)
    right = np.zeros((len(moved) + 2, moved[0].size), order="F")  # LAPACK's order
    right[1:-1] = moved.reshape(len(moved), -1)
    solved = solve_banded((BAND, BAND), matrix, right, overwrite_ab=True, overwrite_b=True, check_finite=False)
    return np.asarray(solved.reshape((len(moved) + 2, *moved.shape[1:])))


def spline_along(values: np.ndarray, axis: int, even_start: bool) -> np.ndarray:
    """Solve for the n + 2 uniform B-spline coefficients of the n values along one axis."""
    count = values.shape[axis]
    if count >= 4:
        return _solve_by_elimination(values, axis, even_start)
    matrix = end_conditions(count, even_start)
    node = np.arange(count)
    for offset, weight in enumerate((1 / 6, 4 / 6, 1 / 6)):
        matrix[BAND + 1 - offset, node + offset] = weight  # row node + 1, column node + offset
    return np.moveaxis(solve_along(matrix, values, axis), 0, axis)


def _solve_by_elimination(values: np.ndarray, axis: int, even_start: bool) -> np.ndarray:
    """`spline_along` for four nodes and more, by elimination of all lines at once: twenty times as fast as LAPACK.

    The not-a-knot condition determines the coefficient of the second node, c = f - (second difference of f) / 6;
    between two such nodes, or from the mirror on, the equations c[i-1] + 4 c[i] + c[i+1] = 6 f[i] are tridiagonal.
    """
    nodes = np.moveaxis(values, axis, 0)
    if 0 < axis == values.ndim - 1:
        nodes = np.ascontiguousarray(nodes)  # each row of all lines is then contiguous
        coefficient = np.empty((len(nodes) + 2, *nodes.shape[1:]))
    else:
        shape = list(values.shape)
        shape[axis] += 2
        coefficient = np.moveaxis(np.empty(shape), axis, 0)
    np.multiply(nodes, 6.0, out=coefficient[1:-1])
    last, spare = len(nodes) - 1, np.empty(nodes.shape[1:])
    coefficient[last] = nodes[-2] - (nodes[-3] - 2.0 * nodes[-2] + nodes[-1]) / 6.0
    inverse, first = pivots(last + 1, even_start).tolist(), 2 if even_start else 3
    if not even_start:
        coefficient[2] = nodes[1] - (nodes[0] - 2.0 * nodes[1] + nodes[2]) / 6.0
    # `coefficient[row] -= ...` would index and write each row twice.
    rows = [coefficient[row, ...] for row in range(len(coefficient))]
    for row in range(first, last):
        np.multiply(rows[row - 1], inverse[row - 1], out=spare)
        np.subtract(rows[row], spare, out=rows[row])
    for row in range(last - 1, first - 1, -1):
        np.subtract(rows[row], rows[row + 1], out=rows[row])
        np.multiply(rows[row], inverse[row], out=rows[row])
    if even_start:
        coefficient[1] = 0.25 * (coefficient[1] - 2.0 * coefficient[2])
        coefficient[0] = coefficient[2]
    else:
        for row in (1, 0):
            coefficient[row] = 6.0 * nodes[row] - 4.0 * coefficient[row + 1] - coefficient[row + 2]
    for row in (last + 1, last + 2):
        coefficient[row] = 6.0 * nodes[row - 2] - 4.0 * coefficient[row - 1] - coefficient[row - 2]
    return np.moveaxis(coefficient, 0, axis)


def pivots(count: int, even_start: bool) -> np.ndarray:
    """Return the reciprocal of the pivot of each equation of `_solve_by_elimination`, shape (count - 1,)."""
    inverse, first = np.ones(count - 1), 3
    if even_start:
        first, inverse[1] = 2, 0.25
    for row in range(first, count - 1):
        coupling = (2.0 if even_start else 0.0) if row == first else 1.0
        inverse[row] = 1.0 / (4.0 - coupling * inverse[row - 1])
    return inverse


def _limited_slope(values: np.ndarray, axis: int, even_start: bool) -> np.ndarray:
    """Return central slopes per cell along one axis, limited so that no control point leaves the range of its edge."""
    moved = np.moveaxis(values, axis, 0)
    step = np.diff(moved, axis=0)
    slope = np.zeros_like(moved)
    bound = 3.0 / values.ndim
    behind, ahead = step[:-1], step[1:]
    central = 0.5 * (behind + ahead)
    limit = bound * np.minimum(np.abs(behind), np.abs(ahead))
    slope[1:-1] = np.where(behind * ahead > 0.0, np.sign(central) * np.minimum(np.abs(central), limit), 0.0)
    slope[0] = 0.0 if even_start else min(1.0, bound) * step[0]
    slope[-1] = min(1.0, bound) * step[-1]
    return np.moveaxis(slope, 0, axis)


def _limited_hermite(values: np.ndarray, even_first_axis: bool) -> np.ndarray:
    """Return value, slopes and cross slopes of every node, interleaved: index 2 i + 1 along an axis is a derivative."""
    dimension = values.ndim
    axes = range(dimension)
    part = {(0,) * dimension: values}
    for axis in axes:
        key = tuple(int(a == axis) for a in axes)
        part[key] = _limited_slope(values, axis, even_first_axis and axis == 0)
    for key in product((0, 1), repeat=dimension):
        if sum(key) < 2:
            continue
        mixed = []
        for axis in (a for a in axes if key[a]):
            lower = tuple(k - int(a == axis) for a, k in enumerate(key))
            if values.shape[axis] > 2:
                mixed.append(np.gradient(part[lower], axis=axis, edge_order=2))
            else:
                mixed.append(np.zeros_like(values))
        part[key] = sum(mixed) / len(mixed)
        if even_first_axis and key[0]:
            part[key][0] = 0.0
    keep = _cross_share(values, part)
    result = np.empty(tuple(2 * n for n in values.shape))
    for key, array in part.items():
        target = tuple(slice(k, None, 2) for k in key)
        result[target] = array * keep if sum(key) >= 2 else array
    return result


def _cross_share(values: np.ndarray, part: dict[tuple[int, ...], np.ndarray]) -> np.ndarray:
    """Return the greatest fraction of each node's cross slopes with all Bernstein points in their cell's range."""
    dimension = values.ndim
    share = np.ones_like(values)
    for sign in product((-1, 1), repeat=dimension):
        here = tuple(slice(1, None) if s < 0 else slice(None, -1) for s in sign)
        corners = [
            values[tuple(slice(o, values.shape[a] - 1 + o) for a, o in enumerate(offset))]
            for offset in product((0, 1), repeat=dimension)
        ]
        low, high = np.minimum.reduce(corners), np.maximum.reduce(corners)
        for chosen in product((0, 1), repeat=dimension):
            if sum(chosen) < 2:
                continue
            base, cross = np.zeros_like(low), np.zeros_like(low)
            for key, array in part.items():
                if any(k > c for k, c in zip(key, chosen, strict=True)):
                    continue
                factor = np.prod([s / 3.0 for s, k in zip(sign, key, strict=True) if k])
                if sum(key) < 2:
                    base += factor * array[here]
                else:
                    cross += factor * array[here]
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(cross > 0.0, (high - base) / cross, np.where(cross < 0.0, (low - base) / cross, 1.0))
            share[here] = np.minimum(share[here], np.clip(room, 0.0, 1.0))
    return share


def node_values(average: np.ndarray, interpolation: str, even_first_axis: bool) -> np.ndarray:
    """Return values at the nodes, float64, from averages over cells one spacing wide centred on them.

    For "cubic" those of the spline that has the averages along each axis, which keeps the position of a shock in its
    cell; the others use the averages, off by h^2 / 24 times the second derivative, within their own error.
    """
    values = np.asarray(average, dtype=np.float64)
    if interpolation != "cubic":
        return values
    for axis in range(values.ndim):
        values = _along(values, axis, even_first_axis and axis == 0)
    return values


def _along(average: np.ndarray, axis: int, even_start: bool) -> np.ndarray:
    count = average.shape[axis]
    matrix = end_conditions(count, even_start)
    before, after = _piece(0.5, 1.0), _piece(0.0, 0.5)
    inner = np.zeros(5)
    inner[:4] += before
    inner[1:] += after
    for node in range(1, count - 1):
        fill_row(matrix, node + 1, node - 1, inner)
    fill_row(matrix, 1, 0, 2.0 * after if even_start else _piece(-0.5, 0.5))
    fill_row(matrix, count, count - 2, _piece(0.5, 1.5))
    coefficient = solve_along(matrix, average, axis)
    return np.moveaxis((coefficient[:-2] + 4.0 * coefficient[1:-1] + coefficient[2:]) / 6.0, 0, axis)


def _piece(low: float, high: float) -> np.ndarray:
    """Return integrals of the four cubic B-spline weights over a part of one cell, by two-point Gauss (exact)."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    place = middle + half / np.sqrt(3.0) * np.array([-1.0, 1.0])
    value: np.ndarray = weights("cubic", place)[0]
    return half * value.sum(axis=1)
