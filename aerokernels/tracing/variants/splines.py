"""Interpolating splines of the first, third and fifth order along two axes of evenly spaced samples.

A spline of order p is a sum of B-splines. Its ends are not-a-knot: the p-th derivative has no jump at the outermost
(p - 1) / 2 knots within, so that the next order differs from it at the faces as it does elsewhere. The coefficient of a
node falls with the distance of the samples by 0.27 a node (p = 3) and 0.43 (p = 5): only samples about the points are
needed.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import comb

import numpy as np

from ...medium import IndexField
from ...medium.grid import UniformGrid

# Nodes beyond the points whose samples matter, and nodes that are solved for together.
MARGIN, BLOCK = 16, 256
# Least number of nodes for the fifth order.
LEAST_NODES = 8


def tap_weights(order: int, u: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the weights of order + 1 B-splines at places u in a cell, and their slopes per cell."""
    weights, before = [np.ones_like(u)], list[np.ndarray]()
    for p in range(1, order + 1):
        before, none = weights, np.zeros_like(u)
        low, high = [none, *weights], [*weights, none]
        weights = [((u + p - j) * low[j] + (j + 1 - u) * high[j]) / p for j in range(p + 1)]
    none = np.zeros_like(u)
    if order == 0:
        return weights, [none]
    return weights, [low - high for low, high in zip([none, *before], [*before, none], strict=True)]


def _solved(count: int, order: int) -> np.ndarray:
    """The matrix from samples at `count` nodes to count + order - 1 coefficients."""
    extra = order // 2
    matrix = np.zeros((count + 2 * extra, count + 2 * extra))
    at_node = [float(one) for one in tap_weights(order, np.zeros(()))[0]]
    for node in range(count):
        matrix[node, node : node + order + 1] = at_node[: count + 2 * extra - node]
    change = [(-1.0) ** k * comb(order + 1, k) for k in range(order + 2)]
    for end in range(extra):
        matrix[count + 2 * end, end : end + order + 2] = change
        matrix[count + 2 * end + 1, len(matrix) - end - order - 2 : len(matrix) - end] = change
    solved = np.linalg.inv(matrix)[:, :count]
    return solved


def order_for(order: int, count: int) -> int:
    """Return the order that so many nodes allow."""
    return order if count >= LEAST_NODES else min(order, 3) if count >= 4 else min(count - 1, 1)


def coefficients(samples: np.ndarray, order: int, axis: int) -> np.ndarray:
    """Return the spline's coefficients along an axis, of which there are order_for(order, n) - 1 more than samples."""
    order = order_for(order, samples.shape[axis])
    return samples if order < 2 else _along(samples, axis, lambda count: _solved(count, order))


def for_next_order(field: IndexField, orders: tuple[int, int]) -> IndexField:
    """Return the field through whose nodes the next order goes: where averages of cells are kept, it keeps them too."""
    grid = field.samples
    if not (isinstance(grid, UniformGrid) and grid.keeps_averages):
        return field
    found = np.asarray(grid.samples, np.float64)
    for axis in range(found.ndim):
        mirrored = min(MARGIN, found.shape[0] - 1) if grid.even_first_axis and axis == 0 else 0
        if mirrored:
            found = np.concatenate([found[mirrored:0:-1], found])
        before, after = (order_for(order, found.shape[axis]) for order in orders)
        found = _along(found, axis, partial(_exchanged, before=before, after=after))[mirrored:]
    return replace(field, samples=replace(grid, samples=found))


def _exchanged(count: int, before: int, after: int) -> np.ndarray:
    """The matrix from a spline's values at `count` nodes to those of the spline of another order with its averages."""

    def rows(order: int, places: Sequence[tuple[float, float]]) -> np.ndarray:
        found, node = np.zeros((count, count + 2 * (order // 2))), np.arange(count)
        for place, share in places:
            cell = np.clip(np.floor(node + place).astype(np.int64), 0, count - 2)
            for k, weight in enumerate(tap_weights(order, node + place - cell)[0]):
                found[node, cell + k] += share * weight
        return found

    gauss, share = np.polynomial.legendre.leggauss(3)
    cell = [(0.25 * (one + side), 0.25 * part) for one, part in zip(gauss, share, strict=True) for side in (-1.0, 1.0)]
    averages = [rows(order, cell) @ _solved(count, order) for order in (before, after)]
    return np.asarray(np.linalg.solve(averages[1], averages[0]))


def _along(samples: np.ndarray, axis: int, matrix: Callable[[int], np.ndarray]) -> np.ndarray:
    """Multiply by the matrix for a number of nodes along an axis, by BLOCK nodes at a time where there are more."""
    moved = np.moveaxis(samples, axis, 0)
    count, flat = len(moved), moved.reshape(len(moved), -1)
    whole = matrix(min(count, BLOCK))
    more = len(whole) - whole.shape[1]
    if count <= BLOCK:
        found = whole @ flat
    else:
        found = np.empty((count + more, flat.shape[1]))
        starts = [*range(0, count - BLOCK, BLOCK - 4 * MARGIN), count - BLOCK]
        for start in starts:
            low = 0 if start == 0 else 2 * MARGIN
            high = BLOCK + more if start == count - BLOCK else BLOCK - 2 * MARGIN + more
            found[start + low : start + high] = whole[low:high] @ flat[start : start + BLOCK]
    return np.moveaxis(found.reshape(-1, *moved.shape[1:]), 0, axis)


class Surface:
    """Splines along two axes on each of some planes of samples.

    Only samples about the points of use are held, and those of a mirrored first axis are continued beyond it.
    """

    def __init__(self, samples: np.ndarray, low: np.ndarray, high: np.ndarray, order: int, even: bool):
        """Prepare splines for points between two corners.

        Args:
            samples: Samples, shape (planes, m, n).
            low: Least places of points along both axes [nodes], shape (2,).
            high: Greatest places, shape (2,).
            order: 1, 3 or 5.
            even: Whether the samples are mirrored at the first node of the first axis.
        """
        self.order, self.first = [], []
        for axis in (0, 1):
            count = samples.shape[axis + 1]
            begin, end = int(np.floor(low[axis])) - MARGIN, int(np.ceil(high[axis])) + MARGIN + 1
            begin = max(begin, 1 - count) if even and axis == 0 else max(begin, 0)
            end = min(end, count)
            if end - begin < LEAST_NODES:
                begin, end = max(end - LEAST_NODES, 0), min(max(end, begin + LEAST_NODES), count)
            samples = np.take(samples, np.abs(np.arange(begin, end)), axis=axis + 1)
            self.first.append(begin)
            self.order.append(order_for(order, end - begin))
        table = np.asarray(samples, np.float64)
        for axis in (0, 1):
            table = coefficients(table, order, axis + 1)
        self.table = np.ascontiguousarray(table)
        self.cells = [samples.shape[axis + 1] - 1 for axis in (0, 1)]

    def __call__(self, plane: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return values (m,) and slopes per node (m, 2) at points: their planes (m,), places along both axes (m, 2)."""
        _, rows, columns = self.table.shape
        start = plane * (rows * columns)
        weights, slopes = [], []
        for axis, pitch in ((0, columns), (1, 1)):
            u = place[:, axis] - self.first[axis]
            cell = np.clip(np.floor(u).astype(np.int64), 0, max(self.cells[axis] - 1, 0))
            weight, slope = tap_weights(self.order[axis], u - cell)
            weights.append(weight)
            slopes.append(slope)
            start = start + cell * pitch
        flat = self.table.reshape(-1)
        value, along, across = np.zeros((3, len(place)))
        for i in range(len(weights[0])):
            inner, inner_slope = np.zeros((2, len(place)))
            for j in range(len(weights[1])):
                picked = flat.take(start + (i * columns + j))
                inner += weights[1][j] * picked
                inner_slope += slopes[1][j] * picked
            value += weights[0][i] * inner
            along += slopes[0][i] * inner
            across += weights[0][i] * inner_slope
        return value, np.stack([along, across], axis=1)


def in_space(field: IndexField, points: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return gradients along a grid's own axes, (m, d), as vectors in space at points, both (m, 3)."""
    if field.geometry == "volume":
        return slope
    if field.geometry == "planar":
        return np.concatenate([np.zeros((len(points), 1)), slope], axis=1)
    radius = np.hypot(points[:, 0], points[:, 1])
    outward = points[:, :2] / np.where(radius > 0.0, radius, 1.0)[:, None]
    return np.concatenate([outward * slope[:, :1], slope[:, 1:]], axis=1)
