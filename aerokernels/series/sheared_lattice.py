r"""Sums along parallel lines through a volume: first along lines through the nodes, then interpolated between them.

Parallel lines that shift by the same amount from plane to plane cross each plane at the same fraction of its cells. So
for the lines through the nodes of one plane the spline's weights in another plane are the same four, w_k B_a(shift_k),
and the spline's inverse, which is a convolution, commutes with the sum over the planes:

    g(line) = inverse  sum over the planes k of  w_k sum_ab B_a B_b f_k(node of the line + shift_k + a, b)

g is then interpolated, by the same spline, to the requested lines. The node at offset (du, dv) from a line's own node
contributes in plane k with a weight C[(du, dv), k] that is the same for all lines:

    g(u, v) = sum over (du, dv) of  P[(du, dv)](u + du, v + dv),      P = C f,   f(k, node) = samples - offset

P is a matrix product, at the speed of the BLAS library, some rows at a time; the sum of the shifted P runs along rows.
The planes are divided into the number of parts that minimises the work: the lines drift, so fewer planes together have
fewer offsets. Fourth order, like the spline; along an axis without shift there is a single weight.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import sparse

from aerokernels.medium import spline
from aerokernels.medium.spline import node_values
from aerokernels.process.machine import core_count

BEYOND = 3  # cells beyond an edge to which samples are extrapolated, by the cubic through the last four
AT_ONCE = 1_000_000  # samples at a time; speed only


class ShearedLattice:
    """The map from samples of a volume to sums along parallel lines, on the processor's cores."""

    def __init__(self, shape, axis: int, places: np.ndarray, slope, middle: int, weights, within, averages: bool):
        """Compute the geometry.

        Args:
            shape: Nodes along each axis of the volume, four or more; those along `axis` count the planes.
            axis: The main axis, across the planes.
            places: Where the lines cross the plane number `middle` [cells], shape (n, 2).
            slope: Their shift from one plane to the next [cells], shape (2,).
            middle: See `places`.
            weights: Of the planes [m], shape (plane_count,).
            within: Which lines are needed; the others' sums are zero, shape (n,).
            averages: Whether the samples are cell averages.
        """
        self._axis = axis
        self._counts = counts = [shape[k] for k in range(3) if k != axis]
        shift = np.asarray(slope)[None, :] * (np.arange(shape[axis]) - middle)[:, None]
        sheared = np.abs(shift).max(axis=0) > 1e-9  # a smaller shift over the box counts as none
        base = np.where(sheared, np.floor(shift), 0.0)
        blends = [
            spline.weights("cubic", shift[:, a] - base[:, a])[0].T if sheared[a] else np.ones((len(shift), 1))
            for a in range(2)
        ]
        wanted = places[within] if within.any() else np.zeros((1, 2))
        margin = np.where(sheared, 2, 8)  # cells beyond the requested lines
        low = np.floor(wanted.min(axis=0)).astype(int) - margin
        high = np.ceil(wanted.max(axis=0)).astype(int) + margin
        for a in range(2):  # without shift no line is beyond the box
            if not sheared[a]:
                low[a], high[a] = max(low[a], 0), min(high[a], counts[a] - 1)
        self._low, self._size = low, high - low + 1  # the lattice's first line [cells] and its lines, along each axis
        self._values = PlaneValues(places - low, self._size, within, "cubic", False, averages, tuple(sheared))
        first_node = (base - sheared).astype(np.int32)  # from a line's own node, in each plane
        result = [_parts(first_node, blends, np.asarray(weights), n) for n in (1, 2, 3, 4, 6, 8) if n <= len(weights)]
        self._parts = min(result, key=_cost)
        offsets = np.concatenate([offset for _, offset, _ in self._parts])
        first = np.clip(low + offsets.min(axis=0), -BEYOND, np.add(counts, BEYOND - 1))
        last = np.clip(high + offsets.max(axis=0), -BEYOND, np.add(counts, BEYOND - 1))
        self._first, self._stop = first, last + 1  # range of the nodes that are needed, along each axis
        self._drift = int(offsets[:, 0].min()), int(offsets[:, 0].max())
        self._matrices: dict[np.dtype, list[np.ndarray]] = {}

    def __call__(self, samples: np.ndarray, offset: float = 0.0) -> np.ndarray:
        """Return sums of samples minus a constant, shape (n,), float64."""
        if samples.dtype not in self._matrices:
            self._matrices[samples.dtype] = [part[2].astype(samples.dtype) for part in self._parts]
        first, stop, count = int(self._first[0]), int(self._stop[0]), self._counts[0]
        rows = max(8, AT_ONCE // (int(self._stop[1] - self._first[1]) * samples.shape[self._axis]))
        edges = {first, stop, 0, count, *range(max(first, 0), min(stop, count), rows)}
        bounds = sorted(edge for edge in edges if first <= edge <= stop)
        moved = np.moveaxis(samples, self._axis, 2 if self._axis == 2 else 0)

        def summed(rows: tuple[int, int]) -> tuple[int, np.ndarray]:
            return self._summed(moved, *rows, offset)

        total = np.zeros(self._size, samples.dtype)
        blocks = list(pairwise(bounds))
        with ThreadPoolExecutor(max(1, min(core_count(), len(blocks)))) as pool:
            for line, part in pool.map(summed, blocks):  # in a fixed order, so that results are reproducible
                total[line : line + len(part)] += part
        return self._values(total)

    def _summed(self, moved: np.ndarray, begin: int, end: int, offset: float) -> tuple[int, np.ndarray]:
        """Return the contribution of some rows of nodes to the lines that pass them: the first line, and the sums."""
        drift = self._drift
        lines = max(begin - self._low[0] - drift[1], 0), min(end - self._low[0] - drift[0], self._size[0])
        if begin < 0:  # lines further out use the last of these rows
            lines = 0, lines[1]
        if end > self._counts[0]:
            lines = lines[0], int(self._size[0])
        total = np.zeros((max(lines[1] - lines[0], 0), self._size[1]), moved.dtype)
        block = self._block(moved, begin, end, offset)
        for (planes, offsets, _), matrix in zip(self._parts, self._matrices[moved.dtype], strict=True):
            # Row by row: BLAS computes such small products in one thread, without waiting for others.
            product = np.matmul(matrix, block[:, planes])
            for number, (du, dv) in enumerate(offsets.tolist()):
                low = self._low[0] + lines[0] + du, self._low[1] + dv
                some, rows = _lines_at(int(low[0]), len(total), self._counts[0], begin, end)
                _, columns = _lines_at(
                    int(low[1]), int(self._size[1]), self._counts[1], int(self._first[1]), int(self._stop[1])
                )
                if some.stop > some.start:
                    total[some] += product[rows, number][:, columns]
        return lines[0], total

    def _block(self, moved: np.ndarray, begin: int, end: int, offset: float) -> np.ndarray:
        """Return some rows of the samples minus the constant, shape (rows, planes, nodes of a row).

        Rows and ends of rows beyond the volume are extrapolated by the cubics through the last nodes.
        """
        at = 0 if self._axis == 2 else 1  # the axis of rows; that of a row's nodes is the next one
        count, width = self._counts
        first, stop = int(self._first[1]), int(self._stop[1])
        rows = slice(0, 4) if begin < 0 else slice(count - 4, count) if end > count else slice(begin, end)
        across = slice(0, width) if first < 0 or stop > width else slice(first, stop)
        block = np.subtract(moved[(*[slice(None)] * at, rows, across)], moved.dtype.type(offset), order="C")
        block = _drawn_out(block, at, begin - rows.start, end - rows.start)
        block = _drawn_out(block, at + 1, first - across.start, stop - across.start)
        return block.transpose((0, 2, 1) if self._axis == 2 else (1, 0, 2))


def _drawn_out(values: np.ndarray, axis: int, first: int, stop: int) -> np.ndarray:
    """Return the nodes from `first` to `stop` along an axis, those beyond an end by the cubic through the last four."""
    count = values.shape[axis]
    if (first, stop) == (0, count):
        return values
    parts = []
    if first < 0:
        parts.append(_beyond(np.take(values, range(4), axis), axis, -1 - np.arange(first, min(stop, 0)), True))
    if first < count and stop > 0:
        parts.append(np.take(values, range(max(first, 0), min(stop, count)), axis))
    if stop > count:
        numbers = np.arange(max(first, count), stop) - count
        parts.append(_beyond(np.take(values, range(count - 4, count), axis), axis, numbers, False))
    return np.concatenate(parts, axis=axis)


def _lines_at(first: int, size: int, count: int, begin: int, end: int) -> tuple[slice, Any]:
    """Return which of `size` lines at the nodes from `first` meet the nodes from `begin` to `end`, and where.

    A line further beyond the edge than the extrapolated samples uses the last one.
    """
    least, most = -BEYOND, count + BEYOND - 1
    if least < begin and end <= most:  # neither end is among them: a contiguous run of nodes
        start, stop = max(begin - first, 0), min(end - first, size)
        return slice(start, max(stop, start)), slice(first + start - begin, first + max(stop, start) - begin)
    nodes = np.clip(np.arange(first, first + size), least, most)
    start, stop = np.searchsorted(nodes, (begin, end))
    return slice(int(start), int(stop)), nodes[start:stop] - begin


def _beyond(last: np.ndarray, axis: int, numbers: np.ndarray, before: bool) -> np.ndarray:
    """Return values beyond an end of an axis, from the last four; `numbers` 0, 1, 2: one, two, three cells beyond."""
    cubic = np.array([[4.0, -6.0, 4.0, -1.0], [10.0, -20.0, 15.0, -4.0], [20.0, -45.0, 36.0, -10.0]])[numbers]
    weights = cubic if before else cubic[:, ::-1]
    return np.moveaxis(np.tensordot(weights.astype(last.dtype), last, (1, axis)), 0, axis)


def _parts(shift: np.ndarray, blends, weights: np.ndarray, count: int) -> list[tuple[slice, np.ndarray, np.ndarray]]:
    """Return planes, offsets (m, 2) and weights (m, planes) of each part."""
    bounds = np.linspace(0, len(weights), count + 1).round().astype(int)
    result = []
    for begin, end in pairwise(bounds):
        planes = slice(int(begin), int(end))
        along = [shift[planes, a, None] + np.arange(blends[a].shape[1]) for a in range(2)]
        pairs = np.stack(np.broadcast_arrays(along[0][:, :, None], along[1][:, None, :]), axis=-1)
        share = blends[0][planes][:, :, None] * blends[1][planes][:, None, :] * weights[planes, None, None]
        offsets, which = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
        matrix = np.zeros((len(offsets), end - begin))
        plane = np.repeat(np.arange(end - begin), share[0].size)
        np.add.at(matrix, (which.ravel(), plane), share.ravel())
        result.append((planes, offsets, matrix))
    return result


def _cost(parts: list[tuple[slice, np.ndarray, np.ndarray]]) -> float:
    """Return the work of a division of the planes; shifting a value of P costs as much as 50 multiplications."""
    return sum(len(matrix) * (matrix.shape[1] + 50.0) for _, _, matrix in parts)


REST = 1e-13
SPARSEST = 4.0  # grid points for each place on the grid; above it places are interpolated one by one; speed only


def to_coefficients(count: int, interpolation: str, even: bool, cell_averages: bool) -> np.ndarray:
    """Return the matrix from the samples of an axis to its coefficients, shape (coefficient_count, count)."""
    unit = np.eye(count)
    samples = to_nodes(count, interpolation, even) if cell_averages else unit
    return samples if interpolation == "linear" else spline.spline_along(samples, 0, even)


def to_nodes(count: int, interpolation: str, even: bool) -> np.ndarray:
    """Return the matrix from averages over the cells of an axis to values at its nodes, shape (count, count)."""
    unit = np.eye(count)
    return np.stack([node_values(unit[:, k], interpolation, even) for k in range(count)], axis=1)


def nodes_along(samples: np.ndarray, axes: Any, interpolation: str, even: bool) -> np.ndarray:
    """Convert cell averages to values at the nodes along some of the axes, in the samples' own precision."""
    for axis in axes:
        matrix = to_nodes(samples.shape[axis], interpolation, even and axis == 0).astype(samples.dtype)
        if axis == samples.ndim - 1:
            samples = samples @ matrix.T
        else:
            flat = samples.reshape(*samples.shape[: axis + 1], -1)
            samples = np.matmul(matrix, flat).reshape(samples.shape)
    return samples


def basis_rows(places: np.ndarray, count: int, interpolation: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the first coefficient and the weights of places [cells] along an axis, shapes (n,) and (n, support)."""
    held = np.clip(places, 0.0, count - 1.0)
    cell = np.minimum(held.astype(np.int64), count - 2)
    return cell, spline.weights(interpolation, held - cell)[0].T


def thinned(matrix: np.ndarray) -> sparse.csr_matrix:
    """Return a matrix without its entries below REST of the greatest one."""
    return sparse.csr_matrix(np.where(np.abs(matrix) > REST * np.abs(matrix).max(initial=0.0), matrix, 0.0))


class PlaneValues:
    """The map from the samples of a plane to the values at points of it."""

    def __init__(
        self,
        places: np.ndarray,
        counts: Any,
        within: np.ndarray,
        interpolation: str,
        even: bool = False,
        cell_averages: bool = False,
        inverted: tuple[bool, ...] = (False, False),
    ):
        """Compute the map for points at `places` [cells], shape (n, 1 or 2); values are zero where not `within`.

        `counts` are the nodes along each axis; an `even` plane is mirrored at the first node of its first one. Along
        `inverted` axes the samples are sums of the spline's basis functions.
        """
        inverses = []
        for axis, count in enumerate(counts):
            once = to_coefficients(count, interpolation, even and axis == 0, False)
            twice = once @ once[1:-1] if inverted[axis] else once
            inverses.append(twice @ to_nodes(count, interpolation, even and axis == 0) if cell_averages else twice)
        self._within = within
        unique = [np.unique(np.round(places[:, k], 9), return_inverse=True) for k in range(len(counts))]
        cells = int(np.prod([len(values) for values, _ in unique]))
        self._index: np.ndarray | None = None
        if len(counts) == 1 or cells <= SPARSEST * len(places):
            self._maps = [
                thinned(tensor_rows(values[:, None], [count], interpolation) @ inverse)
                for (values, _), count, inverse in zip(unique, counts, inverses, strict=True)
            ]
            self._index = np.ravel_multi_index([where for _, where in unique], [len(values) for values, _ in unique])
        else:
            self._maps = [thinned(inverse) for inverse in inverses]
            self._rows = tensor_rows(places, counts, interpolation)

    def __call__(self, plane: np.ndarray) -> np.ndarray:
        """Return values at the points, shape (n,), float64."""
        result = np.asarray(plane, np.float64)
        for axis, one in enumerate(self._maps):
            result = one @ result if axis == 0 else (one @ np.ascontiguousarray(result.T)).T
        values = self._rows @ result.ravel() if self._index is None else np.take(result, self._index)
        return np.where(self._within, values, 0.0)


def tensor_rows(places: np.ndarray, counts, interpolation: str, keep: np.ndarray | None = None) -> sparse.csr_matrix:
    """Return the matrix from a plane's coefficients to values at places [cells], shape (n, axes); 0 unless `keep`."""
    columns = np.zeros((len(places), 1), dtype=np.int64)
    values = np.ones((len(places), 1)) if keep is None else keep[:, None].astype(np.float64)
    size = 1
    for axis, count in enumerate(counts):
        cell, weight = basis_rows(places[:, axis], count, interpolation)
        support = weight.shape[1]
        total = count + support - 2
        column = cell[:, None] + np.arange(support)
        columns = (columns[:, :, None] * total + column[:, None, :]).reshape(len(places), -1)
        values = (values[:, :, None] * weight[:, None, :]).reshape(len(places), -1)
        size *= total
    starts = np.arange(len(places) + 1) * columns.shape[1]
    return sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(len(places), size))
