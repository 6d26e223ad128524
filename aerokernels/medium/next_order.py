r"""Estimate an interpolant's error along lines from the terms that it leaves out, at all nodes of a uniform grid.

Richardson's estimate (levels.py) compares a grid with coarser ones, on which a feature of a few cells is gone, so that
their differences may vanish by chance. The estimate here needs no coarser grid. The error of a cubic spline through the
samples of f along one axis, in units of the node spacing h, is

    S f - f = h^4 f'''' E_4(x) + h^5 f''''' E_5(x) + ...,     E_k = S[y^k / k!] about x, minus the same polynomial

where E_4 = -u^2 (1 - u)^2 / 24 at the place u in a cell far from the ends (C. de Boor, A Practical Guide to Splines
(2001)), and greater in the first cells beside a not-a-knot end. The derivatives are differences of the samples, and
the errors of the axes add. What is left out is bounded by absolute values, which cannot cancel along a line: half of
|E_4| h^6 |f^(6)| + |E_5| h^7 |f^(7)|. Where the samples resolve f, this is small. The error of another interpolant is
its difference from the spline, plus the spline's error.

A feature below about one cell wide, or noise of the samples, is not in the samples' differences: Richardson's estimate
sees these.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from . import spline
from .grid import UniformGrid

FOURTH, SIXTH = (1.0, -4.0, 6.0, -4.0, 1.0), (1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0)
# Share of E_4 h^6 f^(6) in the error: 1/6 of it is in the fourth difference, at most 1/8 in its interpolation.
SIXTH_SHARE = 0.5
# Nodes of the axis on which E_k is computed: the effect of an end falls by 3.7 a cell.
KERNEL_NODES = 24


def next_order_error(grid: UniformGrid, local: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the estimated error of integrals of the contrast along lines, and the bound of the rest [m], shape (2, n).

    Args:
        grid: The samples and their interpolant.
        local: Places on the lines, in the grid's coordinates [m], shape (n, place_count, d), inside its box.
        weight: Length of the line that each place stands for [m], shape (n, place_count).
    """
    points = local.reshape(-1, local.shape[-1])
    omitted, bound = _spline_error(grid, points)
    if grid.interpolation != "cubic":
        cubic = replace(grid, interpolation="cubic")
        omitted = omitted + grid.evaluate(points)[0] - cubic.evaluate(points)[0]
    return np.stack([(part.reshape(weight.shape) * weight).sum(axis=1) for part in (omitted, bound)])


def _spline_error(grid: UniformGrid, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the spline's error at points (n, d) to fifth order, and the bound of the rest, each of shape (n,)."""
    place = (points - grid.origin) / grid.spacing
    cell = np.clip(np.floor(place).astype(np.int64), 0, np.array(grid.shape) - 2)
    share = place - cell
    error, bound = np.zeros(len(points)), np.zeros(len(points))
    for axis, count in enumerate(grid.shape):
        if count < len(FOURTH):
            continue
        fourth, fifth = _kernels(place[:, axis], count, axis == 0 and grid.even_first_axis)
        u = share[:, axis]
        nearest = np.where(np.arange(len(grid.shape)) == axis, cell, np.rint(place).astype(np.int64))
        # Along the axis, f'''' at the place and its slope from the differences at both ends of the cell.
        for step, factor in ((0, (1.0 - u) * fourth - fifth), (1, u * fourth + fifth)):
            for corner in product((0, 1), repeat=len(grid.shape)):
                if corner[axis] == step:
                    error += factor * _lateral(share, corner, axis) * _difference(grid, cell + corner, axis, FOURTH)
        step = np.eye(len(grid.shape), dtype=np.int64)[axis]
        sixth = SIXTH if count >= len(SIXTH) else FOURTH
        low, high = (_difference(grid, node, axis, sixth) for node in (nearest, nearest + step))
        bound += np.abs(fourth) * np.maximum(np.abs(low), np.abs(high)) + np.abs(fifth * (high - low))
    return error, SIXTH_SHARE * bound


def _lateral(share: np.ndarray, corner: tuple[int, ...], axis: int) -> np.ndarray:
    """Return the weight of a cell's corner in linear interpolation across an axis, shape (n,)."""
    weight = np.ones(len(share))
    for other, end in enumerate(corner):
        if other != axis:
            weight *= share[:, other] if end else 1.0 - share[:, other]
    return weight


def _difference(grid: UniformGrid, node: np.ndarray, axis: int, weights: tuple[float, ...]) -> np.ndarray:
    """Return a central difference along an axis at nodes (n, d), or at the nearest ones that have it, shape (n,)."""
    half, count = len(weights) // 2, grid.shape[axis]
    node = np.clip(node, 0, np.array(grid.shape) - 1)
    middle = np.minimum(node[:, axis], count - 1 - half)
    if not (axis == 0 and grid.even_first_axis):
        middle = np.maximum(middle, half)
    here, change = list(node.T), np.zeros(len(node))
    for offset, weight in enumerate(weights, -half):
        here[axis] = np.abs(middle + offset)  # the mirror image across an axis
        change += weight * grid.samples[tuple(here)].astype(np.float64)
    return change


def _kernels(place: np.ndarray, count: int, even_start: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return E_4 and E_5 at places along an axis of `count` nodes [cells], each of shape (n,)."""
    if even_start:  # the spline is that of the mirrored axis, whose middle is not an end
        place, count = place + (count - 1), 2 * count - 1
    few = min(count, KERNEL_NODES)
    middle = few // 2
    from_end = place - (count - few)
    x = np.where(place < middle, place, np.where(from_end > middle, from_end, middle + place % 1.0))
    cell = np.clip(np.floor(x).astype(np.int64), 0, few - 2)
    weights = spline.values("cubic", x - cell)
    nodes, x = np.arange(few) - float(middle), x - middle
    found = []
    for power, factorial in ((4, 24.0), (5, 120.0)):
        coefficient = spline.coefficients(nodes**power / factorial, "cubic", False)
        found.append(sum(w * coefficient[cell + k] for k, w in enumerate(weights)) - x**power / factorial)
    # S[(y - x)^5 / 5!] is S[y^5 / 5!] - x S[y^4 / 4!] and polynomials that the spline reproduces.
    return found[0], found[1] - x * found[0]
