r"""Slabs of a field across a line of sight: integrals of the contrast over each slab, not samples.

Along z of a uniform grid the interpolant is a tensor product, so that the integral over a slab is a sum over
coefficients,

    \int c(x, y, z) dz = sum_ijk a_ijk B_i(x) B_j(y) \int B_k(z) dz,

exact (two Gauss points for each cubic piece), and computed once for HELD slabs: fewer slabs are sums of these.
Elsewhere (a slanted line of sight, a mesh) the integral is the mean of layers. Either way a thin shock between two
samples is not missed.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.process.threads import product_on_one_core

from ..medium import IndexField, spline
from ..medium.grid import UniformGrid
from ..medium.tensor_points import contrast_without_gradient

# Most slabs of the disturbed air; layers of the box where the integral is not a sum over coefficients, for up to FEW
# slabs, and twice as many for more; fewest slabs integrated at once; slabs integrated and cached until more are
# requested.
FINEST, LAYERS, FEW, TOGETHER, HELD = 64, 32, 8, 2, 16
# Positions of two Gauss points, in half widths of a piece from its middle.
GAUSS = np.array([[-1.0], [1.0]]) / math.sqrt(3.0)
# Greatest phase [rad] of the air left out at either end; coefficients above which it is searched on a part of them.
LEFT_OUT, MANY_COEFFICIENTS = 0.01, 1 << 18


@dataclass(frozen=True, eq=False)
class LookingAlong:
    """A square window and its line of sight.

    Attributes:
        center: Middle of the window [m], shape (3,).
        normal: Direction of the line of sight, shape (3,).
        axes: Unit vectors across it.
        half: Half the window's width [m].
    """

    center: np.ndarray
    normal: np.ndarray
    axes: tuple[np.ndarray, np.ndarray]
    half: float


class Slabs(ABC):
    """Slabs of equal thickness of the disturbed air in a window's view.

    Attributes:
        first: Start of the slabs along the line of sight [m].
        last: End of the slabs [m].
        most_pixels: Most pixels along a side of a window for which the slabs are computed quickly.
    """

    first: float
    last: float
    most_pixels: int

    @abstractmethod
    def paths(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        """Return the optical paths [m] of `count` slabs, a power of two up to FINEST, float32, shape (count, y, x).

        The path of one line is subtracted from each slab: a delay common to all lines does not matter, and would cost
        digits of the differences.

        Args:
            x: Coordinates along the window's first axis [m], shape (m,).
            y: Coordinates along the second axis [m], shape (n,).
            count: Number of slabs.
        """

    def opaque(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray | None:
        """Return masks of where light ends in `count` slabs, (count, y, x), arguments as in `paths`; None: nowhere."""
        return None


def slabs_of(field: IndexField, look: LookingAlong, begin: float, end: float, wavelength: float) -> Slabs:
    """Return the slabs of a field between two distances along a line of sight [m]."""
    if is_summed(field, look.normal):
        return SlabsAlongZ(field, look, begin, end, wavelength)
    return SlabsOfLayers(field, look, begin, end)


def is_summed(field: IndexField, normal: np.ndarray) -> bool:
    """Return whether slabs of a field across a line of sight are sums over coefficients."""
    return field.is_uniform and abs(abs(float(normal[2])) - 1.0) < 1e-15


def without_piston(paths: np.ndarray) -> np.ndarray:
    """Return paths of slabs (count, y, x) minus the first line of each, float32."""
    return (paths - paths[:, :1, :1]).astype(np.float32)


class SlabsAlongZ(Slabs):
    """Slabs of a uniform grid along its z axis, as sums over its coefficients; paths in single precision."""

    most_pixels = 192

    def __init__(self, field: IndexField, look: LookingAlong, begin: float, end: float, wavelength: float):
        """Find the disturbed air."""
        assert isinstance(field.samples, UniformGrid)
        self._field, self._grid, self._look = field, field.samples, look
        grid = self._grid
        self._sees_past = False
        self._across = tuple(self._window(axis) for axis in range(grid.samples.ndim - 1))
        across = tuple(slice(low, high) for low, high, _ in self._across)
        self._coefficients = np.asarray(grid.coefficients[across], np.float64)
        self.first, self.last = self._disturbed(self._coefficients, begin, end, wavelength)
        self._integrated: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._latest: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._known: dict[tuple[tuple[float, ...], bytes], tuple[Any, np.ndarray]] = {}

    def _window(self, axis: int) -> tuple[int, int, int]:
        """Return the range of coefficients along an axis that the window depends on, and the cell of the first one."""
        grid, look = self._grid, self._look
        if self._field.geometry == "axisymmetric":
            farthest = float(np.hypot(*look.center[:2])) + math.sqrt(2.0) * look.half
            low, high = max(farthest - 2.0 * math.sqrt(2.0) * look.half, 0.0), farthest
        else:
            middle = look.center[axis if self._field.geometry == "volume" else 1]
            low, high = middle - look.half, middle + look.half
        cells, most = (
            [(float(end) - grid.origin[axis]) / grid.spacing[axis] for end in (low, high)],
            grid.shape[axis] - 1,
        )
        self._sees_past |= cells[1] > most or (cells[0] < 0.0 and self._field.geometry != "axisymmetric")
        first, last = (
            min(max(math.floor(cell) + beside, 0), most - 1) for cell, beside in zip(cells, (-1, 1), strict=True)
        )
        stride = spline.STRIDE[grid.interpolation]
        return first * stride, last * stride + spline.SUPPORT[grid.interpolation], first

    def _disturbed(self, coefficients: np.ndarray, begin: float, end: float, wavelength: float) -> tuple[float, float]:
        """Return where the air begins and ends to differ across the window by more than LEFT_OUT."""
        grid, look = self._grid, self._look
        stride, support = spline.STRIDE[grid.interpolation], spline.SUPPORT[grid.interpolation]
        # Of a large volume a quarter of the lines shows where its air is at rest.
        thinned = 2 if coefficients.size > MANY_COEFFICIENTS else 1
        lines = coefficients[(slice(None, None, thinned),) * (coefficients.ndim - 1)].reshape(
            -1, coefficients.shape[-1]
        )
        highest, lowest = np.maximum.reduce(lines), np.minimum.reduce(lines)
        if self._sees_past:  # the window is wider than the box, outside which the contrast is zero
            highest, lowest = np.maximum(highest, 0.0), np.minimum(lowest, 0.0)
        phase = 2.0 * math.pi / wavelength * float(grid.spacing[-1]) / grid.ambient_index * (highest - lowest)
        cells = grid.shape[-1] - 1
        low = int(np.add.accumulate(phase).searchsorted(LEFT_OUT))
        high = len(phase) - 1 - int(np.add.accumulate(phase[::-1]).searchsorted(LEFT_OUT))
        if low > high:
            low, high = 0, len(phase) - 1
        # A coefficient affects the `support` cells up to its own.
        near = (max(low // stride - support + 1, 0), min(high // stride + 1, cells))
        start, sign = float(grid.origin[-1] - look.center[2]), float(look.normal[2])
        depths = sorted(sign * (start + node * float(grid.spacing[-1])) for node in near)
        first, last = max(depths[0], begin), min(depths[1], end)
        return (first, last) if last > first else (begin, end)

    def _means(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return means of the coefficients over so many slabs minus the first line's, float32, shape (..., count).

        The means of the first line, shape (count,), are returned too. Coefficients are integrated over no more slabs
        than necessary: TOGETHER first, then HELD, then FINEST; fewer slabs are means of these.
        """
        made = _made_for(count)
        if made not in self._integrated:
            look, stride = self._look, spline.STRIDE[self._grid.interpolation]
            step = (self.last - self.first) / made
            edges = float(look.center[2]) + float(look.normal[2]) * (self.first + step * np.arange(made + 1))
            means = _slab_means(self._coefficients, self._grid, edges)
            line = means[(0,) * (means.ndim - 1)].copy()
            # Only coefficients of values: their weights add up to one. Coefficients of slopes, in between, are left as
            # they are.
            means[(slice(None, None, stride),) * (means.ndim - 1)] -= line
            self._integrated[made] = means.astype(np.float32), line
        means, line = self._integrated[made]
        if made == count:
            return means, line
        return means.reshape(*means.shape[:-1], count, -1).mean(axis=-1), line.reshape(count, -1).mean(axis=-1)

    def paths(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        """See `Slabs.paths`. At least TOGETHER slabs are computed and cached; fewer are sums of these."""
        # One column costs less than the function calls, so more slabs are computed at once.
        made = max(count, TOGETHER) if len(x) > 1 else max(HELD, _made_for(count))
        latest = self._latest
        if latest is None or latest[0] is not x or latest[1] is not y or len(latest[2]) != made:
            self._latest = latest = x, y, self._integrals(x, y, made)
        cached = latest[2]
        return cached if made == count else cached.reshape(count, -1, *cached.shape[1:]).sum(axis=1)

    def _integrals(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        look, geometry, (values, line) = self._look, self._field.geometry, self._means(count)
        up = look.center[1] + y * look.axes[1][1]
        across = look.center[0] + x * look.axes[0][0]
        if geometry == "volume":
            (columns, inside_x), (rows, inside_y) = (
                self._matrix(points, values.shape[axis], axis) for axis, points in enumerate((across, up))
            )
            part = product_on_one_core(rows, np.ascontiguousarray(values.transpose(2, 1, 0)))
            potential, inside = product_on_one_core(part, columns.T), inside_y[:, None] & inside_x
        elif geometry == "planar":
            rows, inside = self._matrix(up, len(values), 0)
            part = np.ascontiguousarray(product_on_one_core(rows, values).T)
            potential, inside = part[:, :, None] + np.zeros(len(x), dtype=np.float32), inside[:, None]
        else:
            # In a window about the axis each distance from it occurs four times or more: it is evaluated once.
            (up, row), (across, column) = (np.unique(np.abs(place), return_inverse=True) for place in (up, across))
            radius = np.hypot(up[:, None], across)
            part, inside = self._interpolated(radius.ravel(), values)
            there = row[:, None], column
            potential, inside = part.reshape(count, *radius.shape)[:, *there], inside.reshape(radius.shape)[there]
        # The index minus the line's index: the potentials differ by half the difference of the squared indices.
        ambient, thickness = self._grid.ambient_index, (self.last - self.first) / count
        index = np.sqrt(np.maximum(ambient**2 + 2.0 * line, 0.0))[:, None, None]
        sum_of_both = potential * np.float32(2.0)
        sum_of_both += (index**2).astype(np.float32)
        np.sqrt(np.maximum(sum_of_both, np.float32(0.0), out=sum_of_both), out=sum_of_both)
        sum_of_both += index.astype(np.float32)
        potential *= np.float32(2.0 * thickness)
        potential /= sum_of_both
        # Single precision everywhere: in double precision the wave's phase factors take ten times as long.
        return potential if inside.all() else np.where(inside, potential, (thickness * (ambient - index)).astype("f4"))

    def _interpolated(self, points: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Interpolate values (n, count) along the first axis to points [m]: (count, points), and a mask of the box."""
        key = (self._along(0), points.tobytes())
        if key not in self._known:
            self._known[key] = self._weights(points, len(values), 0)
        (column, weight), inside = self._known[key]
        values = np.ascontiguousarray(values.T)
        return sum(each * values[:, place] for place, each in zip(column, weight, strict=True)), inside

    def _along(self, axis: int) -> tuple[float, ...]:
        """Return the numbers of an axis on which weights depend: axes that are alike share them."""
        grid, (low, high, _) = self._grid, self._across[axis]
        return float(grid.origin[axis]), float(grid.spacing[axis]), grid.shape[axis], low, high

    def _matrix(self, points: np.ndarray, coefficient_count: int, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrix from coefficients along an axis to values at points [m], and a mask of the box."""
        key = (self._along(axis), points.tobytes())
        if key not in self._known:
            (column, weight), inside = self._weights(points, coefficient_count, axis)
            matrix = np.zeros((len(points), coefficient_count), dtype=np.float32)
            np.add.at(matrix, (np.arange(len(points)), column), weight)
            self._known[key] = matrix, inside
        return self._known[key]

    def _weights(
        self, points: np.ndarray, coefficient_count: int, axis: int
    ) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Return indices and weights of the coefficients along an axis for points [m], and a mask of the box."""
        grid, first = self._grid, self._across[axis][2]
        support, stride = spline.SUPPORT[grid.interpolation], spline.STRIDE[grid.interpolation]
        place = (points - grid.origin[axis]) / grid.spacing[axis]
        last = grid.shape[axis] - 1
        inside = (place >= -1e-12 * last) & (place <= last * (1.0 + 1e-12))
        cell = np.minimum(np.maximum(np.floor(place).astype(np.int64), first), last - 1)
        weight = spline.values(grid.interpolation, np.where(inside, place - cell, 0.0))
        column = np.minimum((cell - first) * stride + np.arange(support)[:, None], coefficient_count - 1)
        return (column, weight.astype(np.float32)), inside


def _made_for(count: int) -> int:
    """Return the number of slabs to integrate when `count` are requested."""
    return next(made for made in (TOGETHER, HELD, FINEST) if count <= made)


def _slab_means(coefficients: np.ndarray, grid: UniformGrid, edges: np.ndarray) -> np.ndarray:
    """Return means of coefficients (..., z) over slabs between edges along z [m], shape (..., slabs)."""
    stride, support = spline.STRIDE[grid.interpolation], spline.SUPPORT[grid.interpolation]
    last, count = grid.shape[-1] - 1, len(edges) - 1
    ends = np.minimum(np.maximum((edges - grid.origin[-1]) / grid.spacing[-1], 0.0), float(last))
    low, high = float(ends.min()), float(ends.max())
    # Pieces that are inside one cell and one slab, with two Gauss points in each.
    knots = np.sort(np.concatenate([ends, np.arange(math.floor(low) + 1, math.ceil(high))]))
    middle, half = 0.5 * (knots[1:] + knots[:-1]), 0.5 * (knots[1:] - knots[:-1])
    slab = np.minimum(((middle - ends[0]) * (count / (ends[-1] - ends[0]))).astype(int), count - 1)
    cell = np.minimum(middle.astype(int), last - 1)
    gauss = middle - cell + half * GAUSS
    weight = spline.values(grid.interpolation, gauss).sum(axis=1) * half * count / (high - low)
    column = cell * stride + np.arange(support)[:, None]
    length = coefficients.shape[-1]
    total = np.bincount((slab * length + column).ravel(), weight.ravel(), count * length).reshape(count, length)
    if coefficients.ndim == 2:
        return product_on_one_core(coefficients, total.T)
    # In a volume each slab is summed over its own coefficients only.
    used = total != 0.0
    first, last = used.argmax(axis=1), length - used[:, ::-1].argmax(axis=1)
    means = np.empty((*coefficients.shape[:-1], count))
    for number, (start, stop) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        np.matmul(coefficients[..., start:stop], total[number, start:stop], out=means[..., number])
    return means


class SlabsOfLayers(Slabs):
    """Slabs of any field along any line: sums of layers sampled at the window's own points."""

    most_pixels = 96

    def __init__(self, field: IndexField, look: LookingAlong, begin: float, end: float):
        """Store the arguments; sampling is deferred."""
        self._field, self._look = field, look
        self.first, self.last = begin, end
        self._sampled: dict[tuple[int, int, int], np.ndarray] = {}

    def paths(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        """See `Slabs.paths`."""
        layers = max(LAYERS, count) if count <= FEW else max(2 * LAYERS, 2 * count)
        key = (len(y), len(x), layers)
        if key not in self._sampled:
            self._sampled = {key: self._layers(x, y, layers)}
        sampled = self._sampled[key]
        return without_piston(sampled.reshape(count, -1, *sampled.shape[1:]).sum(axis=1))

    def _layers(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        look, thickness = self._look, (self.last - self.first) / count
        across, up = (axis.ravel() for axis in np.meshgrid(x, y))
        plane = look.center + across[:, None] * look.axes[0] + up[:, None] * look.axes[1]
        layers = np.empty((count, len(y), len(x)))
        for number in range(count):
            points = plane + (self.first + thickness * (number + 0.5)) * look.normal
            layers[number] = thickness * contrast_without_gradient(self._field, points).reshape(layers.shape[1:])
        return layers
