r"""Slabs of a field across a line of sight: the integral of the contrast over each, not samples of it.

Along z of a uniform grid the interpolant is a product, so that the integral over a slab is a sum over coefficients,

    \int c(x, y, z) dz = sum_ijk a_ijk B_i(x) B_j(y) \int B_k(z) dz,

exact (two Gauss points to a piece of a cubic), and taken once for HELD slabs: fewer are sums of them. Elsewhere (a
slanted line of sight, a mesh) it is the mean of layers. Either way a thin shock between two samples is not missed.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..medium import IndexField, spline
from ..medium.grid import UniformGrid
from ..medium.tensor_points import contrast_without_gradient

# Slabs that the disturbed air is divided into at first; layers of the box where no sum over coefficients can be had: so
# many up to a few slabs, more for more. So many slabs are integrated together at least, and so many are held until
# more of them are asked for.
FINEST, LAYERS, FEW, TOGETHER, HELD = 64, 32, 8, 2, 16
# Phase [rad] that the air left out at either end may hold.
LEFT_OUT = 0.01


@dataclass(frozen=True, eq=False)
class LookingAlong:
    """A square window that looks along a line.

    Attributes:
        center: Its middle [m], shape (3,).
        normal: Where it looks, shape (3,).
        axes: Its unit vectors across.
        half: Half its width [m].
    """

    center: np.ndarray
    normal: np.ndarray
    axes: tuple[np.ndarray, np.ndarray]
    half: float


class Slabs(ABC):
    """Slabs of equal thickness of the air that disturbs what a window sees.

    Attributes:
        first: Where they begin along the line of sight [m].
        last: Where they end [m].
        most_pixels: Pixels along a side of a window that they are quickly had for.
    """

    first: float
    last: float
    most_pixels: int

    @abstractmethod
    def taken(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        """Optical path [m] of `count` slabs, a power of two up to FINEST, shape (count, y, x).

        Args:
            x: Places along the window's first axis [m], shape (m,).
            y: Places along its second, shape (n,).
            count: How many.
        """

    def spread(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """What lines about places of a window hold in each of some slabs, to a common factor, (slabs, y, x)."""
        return self.taken(x, y, FINEST)

    def opaque(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray | None:
        """Where light ends in `count` slabs, at places as for `taken`, shape (count, y, x); None: nowhere."""
        return None


def slabs_of(field: IndexField, look: LookingAlong, begin: float, end: float, wavelength: float) -> Slabs:
    """Slabs of a field between two distances along a line of sight [m]."""
    if is_summed(field, look.normal):
        return SlabsAlongZ(field, look, begin, end, wavelength)
    return SlabsOfLayers(field, look, begin, end)


def is_summed(field: IndexField, normal: np.ndarray) -> bool:
    """Whether slabs of a field across a line of sight are sums over coefficients."""
    return field.is_uniform and abs(abs(float(normal[2])) - 1.0) < 1e-15


def disturbed_until(field: IndexField, look: LookingAlong, begin: float, end: float, wavelength: float) -> float:
    """Where the air that disturbs a window ends, between two distances along its line of sight [m]."""
    if not is_summed(field, look.normal):
        return end
    return SlabsAlongZ(field, look, begin, end, wavelength, held=0).last


class SlabsAlongZ(Slabs):
    """Slabs of a uniform grid along its z axis, by its coefficients."""

    most_pixels = 192

    def __init__(
        self, field: IndexField, look: LookingAlong, begin: float, end: float, wavelength: float, held: int = HELD
    ):
        """Find what is disturbed, and integrate over so many slabs of it."""
        assert isinstance(field.samples, UniformGrid)
        self._field, self._grid, self._look = field, field.samples, look
        grid = self._grid
        self._across = tuple(self._window(axis) for axis in range(grid.samples.ndim - 1))
        self._held = grid.coefficients[tuple(slice(low, high) for low, high, _ in self._across)]
        self.first, self.last = self._disturbed(self._held, begin, end, wavelength)
        self._means = self._slab_means(held) if held else np.empty(0)
        self._latest: tuple[tuple[bytes, bytes, int], np.ndarray] | None = None
        self._matrices: dict[tuple[int, bytes], tuple[Any, np.ndarray]] = {}

    def _window(self, axis: int) -> tuple[int, int, int]:
        """Coefficients along an axis that the window's values depend on: from, to, and the first one's cell."""
        grid, look = self._grid, self._look
        if self._field.geometry == "axisymmetric":
            farthest = float(np.hypot(*look.center[:2])) + math.sqrt(2.0) * look.half
            low, high = max(farthest - 2.0 * math.sqrt(2.0) * look.half, 0.0), farthest
        else:
            middle = look.center[axis if self._field.geometry == "volume" else 1]
            low, high = middle - look.half, middle + look.half
        cells = (np.array([low, high]) - grid.origin[axis]) / grid.spacing[axis]
        first, last = np.clip(np.floor(cells).astype(int) + np.array([-1, 1]), 0, grid.shape[axis] - 2)
        stride = spline.STRIDE[grid.interpolation]
        return first * stride, last * stride + spline.SUPPORT[grid.interpolation], int(first)

    def _disturbed(self, held: np.ndarray, begin: float, end: float, wavelength: float) -> tuple[float, float]:
        """Where the air begins and ends to differ across the window by more than matters."""
        grid, look = self._grid, self._look
        stride, support = spline.STRIDE[grid.interpolation], spline.SUPPORT[grid.interpolation]
        lines = held.reshape(-1, held.shape[-1])
        differs = lines.max(axis=0) - lines.min(axis=0)
        if self._sees_past():
            differs = np.maximum(differs, np.abs(lines).max(axis=0))
        phase = 2.0 * np.pi / wavelength * grid.spacing[-1] / grid.ambient_index * differs
        cells = grid.shape[-1] - 1
        low = int(np.searchsorted(np.cumsum(phase), LEFT_OUT))
        high = len(phase) - 1 - int(np.searchsorted(np.cumsum(phase[::-1]), LEFT_OUT))
        if low > high:
            low, high = 0, len(phase) - 1
        # A coefficient acts on the `support` cells that end with its own.
        near = grid.origin[-1] + grid.spacing[-1] * np.clip([low // stride - support + 1, high // stride + 1], 0, cells)
        depths = np.sort((near - look.center[2]) * look.normal[2])
        first, last = max(float(depths[0]), begin), min(float(depths[1]), end)
        return (first, last) if last > first else (begin, end)

    def _slab_means(self, count: int) -> np.ndarray:
        """Means of the coefficients over so many slabs."""
        look = self._look
        edges = float(look.center[2]) + float(look.normal[2]) * np.linspace(self.first, self.last, count + 1)
        return _slab_means(self._held, self._grid, edges)

    def _sees_past(self) -> bool:
        """Whether the window is wider than the box."""
        low, high = self._field.box
        for axis, across in enumerate(self._look.axes):
            place = self._look.center[axis]
            reach = self._look.half if self._field.geometry != "axisymmetric" else 2.0 * self._look.half
            if abs(place + reach * abs(across[axis])) > high[axis] or place - reach * abs(across[axis]) < low[axis]:
                return True
        return False

    def taken(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        """See `Slabs.taken`; few slabs are sums of TOGETHER, the last of which are held."""
        key = (x.tobytes(), y.tobytes(), max(count, TOGETHER))
        if self._latest is None or self._latest[0] != key:
            self._latest = key, self._integrals(x, y, key[2])
        held = self._latest[1]
        return held.reshape(count, -1, *held.shape[1:]).sum(axis=1)

    def _integrals(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        look, geometry = self._look, self._field.geometry
        if count > self._means.shape[-1]:
            self._means = self._slab_means(FINEST)
        values = self._means.reshape(*self._means.shape[:-1], count, -1).mean(axis=-1)
        across = look.center[0] + np.asarray(x) * look.axes[0][0]
        up = look.center[1] + np.asarray(y) * look.axes[1][1]
        if geometry == "volume":
            part, inside_x = self._interpolated(across, values, 0)  # x, y coefficients, slab
            part, inside_y = self._interpolated(up, np.swapaxes(part, 0, 1), 1)  # y, x, slab
            potential, inside = np.moveaxis(part, -1, 0), inside_y[:, None] & inside_x
        elif geometry == "planar":
            part, inside = self._interpolated(up, values, 0)
            potential = np.broadcast_to(part.T[:, :, None], (count, len(up), len(across)))
            inside = inside[:, None]
        else:
            # A window about the axis has every distance from it in four places or more.
            (up, row), (across, column) = (np.unique(np.abs(place), return_inverse=True) for place in (up, across))
            radius = np.hypot(up[:, None], across)
            part, inside = self._interpolated(radius.ravel(), values, 0)
            there = row[:, None], column
            potential, inside = part.T.reshape(count, *radius.shape)[:, *there], inside.reshape(radius.shape)[there]
        ambient = self._grid.ambient_index
        index = np.sqrt(np.maximum(ambient**2 + 2.0 * potential, 0.0))
        thickness = (self.last - self.first) / count
        return np.where(inside, 2.0 * thickness * potential / (index + ambient), 0.0)

    def spread(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """See `Slabs.spread`: the coefficients at the nodes beside the lines."""
        look, geometry = self._look, self._field.geometry
        across = look.center[0] + np.asarray(x) * look.axes[0][0]
        up = look.center[1] + np.asarray(y) * look.axes[1][1]
        if geometry == "axisymmetric":
            return np.moveaxis(self._means[self._nearest(np.hypot(up[:, None], across), 0)], -1, 0)
        rows = self._nearest(up, 1 if geometry == "volume" else 0)
        if geometry == "planar":
            return np.repeat(self._means[rows].T[:, :, None], len(across), axis=2)
        return np.moveaxis(self._means[self._nearest(across, 0)][:, rows], (0, 1, 2), (2, 1, 0))

    def _nearest(self, points: np.ndarray, axis: int) -> np.ndarray:
        """The coefficient that is held of the node beside points [m] along an axis of the grid."""
        grid = self._grid
        node = np.rint((points - grid.origin[axis]) / grid.spacing[axis]).astype(int) - self._across[axis][2]
        first = 1 if grid.interpolation == "cubic" else 0
        return np.clip(node * spline.STRIDE[grid.interpolation] + first, 0, self._means.shape[axis] - 1)

    def _interpolated(self, points: np.ndarray, values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """Values along their first axis, an axis of the grid, at points [m], and which of those lie in the box."""
        key = (axis, points.tobytes())
        if key not in self._matrices:
            self._matrices[key] = self._matrix(points, len(values), axis)
        matrix, inside = self._matrices[key]
        if isinstance(matrix, tuple):
            column, weight = matrix
            return sum(each[:, None] * values[place] for place, each in zip(column, weight, strict=True)), inside
        product = matrix @ np.ascontiguousarray(values).reshape(len(values), -1)
        return product.reshape(len(points), *values.shape[1:]), inside

    def _matrix(self, points: np.ndarray, held: int, axis: int) -> tuple[Any, np.ndarray]:
        """What makes values at points [m] of so many coefficients along an axis, and which points lie in the box."""
        from scipy.sparse import csr_array

        grid = self._grid
        support, stride = spline.SUPPORT[grid.interpolation], spline.STRIDE[grid.interpolation]
        place = (points - grid.origin[axis]) / grid.spacing[axis]
        last = grid.shape[axis] - 1
        inside = (place >= -1e-12 * last) & (place <= last * (1.0 + 1e-12))
        cell = np.clip(np.floor(place).astype(np.int64), self._across[axis][2], last - 1)
        weight, _ = spline.weights(grid.interpolation, np.where(inside, place - cell, 0.0))
        column = np.minimum((cell - self._across[axis][2]) * stride + np.arange(support)[:, None], held - 1)
        if self._field.geometry != "volume":  # few numbers: a matrix of SciPy's takes longer to make than to use
            return (column, weight), inside
        start = np.arange(0, support * len(points) + 1, support)
        return csr_array((weight.T.ravel(), column.T.ravel(), start), shape=(len(points), held)), inside


def _slab_means(held: np.ndarray, grid: UniformGrid, edges: np.ndarray) -> np.ndarray:
    """Mean over slabs between edges along z [m], of coefficients (..., z): shape (..., slabs)."""
    stride, support = spline.STRIDE[grid.interpolation], spline.SUPPORT[grid.interpolation]
    last, count = grid.shape[-1] - 1, len(edges) - 1
    ends = np.clip((edges - grid.origin[-1]) / grid.spacing[-1], 0.0, float(last))
    low, high = float(ends.min()), float(ends.max())
    # Pieces of one cell and one slab, two Gauss points in each.
    knots = np.sort(np.concatenate([ends, np.arange(math.floor(low) + 1, math.ceil(high))]))
    middle, half = 0.5 * (knots[1:] + knots[:-1]), 0.5 * np.diff(knots)
    slab = np.clip(((middle - ends[0]) / (ends[-1] - ends[0]) * count).astype(int), 0, count - 1)
    cell = np.clip(np.floor(middle).astype(int), 0, last - 1)
    gauss = middle - cell + half * np.array([[-1.0], [1.0]]) / math.sqrt(3.0)
    weight = spline.weights(grid.interpolation, gauss)[0].sum(axis=1) * half * count / (high - low)
    column = cell * stride + np.arange(support)[:, None]
    length = held.shape[-1]
    total = np.bincount((slab * length + column).ravel(), weight.ravel(), count * length).reshape(count, length)
    used = total != 0.0
    first, last = used.argmax(axis=1), length - used[:, ::-1].argmax(axis=1)
    means = np.empty((*held.shape[:-1], count))
    for number, (start, stop) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        np.matmul(held[..., start:stop], total[number, start:stop], out=means[..., number])
    return means


class SlabsOfLayers(Slabs):
    """Slabs of any field along any line, of layers sampled at the window's own points."""

    most_pixels = 96

    def __init__(self, field: IndexField, look: LookingAlong, begin: float, end: float):
        """Nothing is sampled yet."""
        self._field, self._look = field, look
        self.first, self.last = begin, end
        self._sampled: dict[tuple[int, int, int], np.ndarray] = {}

    def taken(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        """See `Slabs.taken`."""
        layers = max(LAYERS, count) if count <= FEW else max(2 * LAYERS, 2 * count)
        key = (len(y), len(x), layers)
        if key not in self._sampled:
            self._sampled = {key: self._layers(x, y, layers)}
        held = self._sampled[key]
        return held.reshape(count, -1, *held.shape[1:]).sum(axis=1)

    def _layers(self, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
        look, thickness = self._look, (self.last - self.first) / count
        across, up = (axis.ravel() for axis in np.meshgrid(x, y))
        plane = look.center + across[:, None] * look.axes[0] + up[:, None] * look.axes[1]
        layers = np.empty((count, len(y), len(x)))
        for number in range(count):
            points = plane + (self.first + thickness * (number + 0.5)) * look.normal
            layers[number] = thickness * contrast_without_gradient(self._field, points).reshape(layers.shape[1:])
        return layers
