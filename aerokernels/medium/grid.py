"""The index contrast on a uniform grid: one interpolant of one scalar, differentiated analytically.

The scalar is the optical potential s = (n^2 - a^2) / 2 = m (a + m / 2), with contrast m and ambient index a: its
gradient is the force in the ray equation r'' = grad s, and the optical path is the integral of a^2 + 2 s.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from aerokernels.derived import Derived
from aerokernels.device_arrays import plain_array
from aerokernels.display.shown import shown
from aerokernels.inputs.checks import check_choice, warn_caller
from aerokernels.medium import spline
from aerokernels.process.opened import OPENED
from aerokernels.process.threads import copy_and_scan, extremes_of

# Radius in cells within which the gradient of a linear interpolant is smoothed about r = 0, where the interpolant may
# have a kink: rays that oscillate about the axis would otherwise reverse at every crossing.
AXIS_CORE = 1e-4
# Greatest and least side of a box in metres (about the Earth's radius, and a few atoms); others are in another unit.
LARGEST_BOX, SMALLEST_BOX = 1e7, 1e-9
# Types of samples that are kept as they are given.
KINDS = np.dtype(np.float32), np.dtype(np.float64)
# Key of a function that copies coefficients from a device.
FETCH = "fetch coefficients"


def check_finite(array: np.ndarray, what: str) -> None:
    """Raise ValueError for NaN and infinite samples; the message says how many there are and where the first is."""
    if array.size and np.isfinite(array.min()) and np.isfinite(array.max()):  # both are NaN if any sample is
        return
    bad = ~np.isfinite(array)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ValueError(
            f"{int(bad.sum())} of {array.size} samples of {what} are NaN or infinite, the first at index {first}: "
            "fill or cut them out before building a field"
        )


def as_points(points, dimension: int) -> np.ndarray:
    """Return points as a float64 array, shape (n, dimension)."""
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != dimension:
        raise ValueError(f"points must have shape (n, {dimension}), got {points.shape}")
    return points


def local_coordinates(points: np.ndarray, geometry: str) -> np.ndarray:
    """Return points, or sizes, (n, 3) along the axes of samples: (x, y, z), (y, z), or (r, z) if axisymmetric."""
    if geometry == "axisymmetric":
        return np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=1)
    return points[:, 1:] if geometry == "planar" else points


def check_box(low: np.ndarray, high: np.ndarray) -> None:
    """Reject a box [m] whose size no flow has, mostly because its lengths are in another unit."""
    extent = high - low
    if extent.max() > LARGEST_BOX or extent.min() < SMALLEST_BOX:
        sides = " by ".join(f"{side:.3g}" for side in extent)
        raise ValueError(
            f"the field's box is {sides} m, outside the range of flows (sides of {SMALLEST_BOX:g} to "
            f"{LARGEST_BOX:g} m): give lengths in metres"
        )


def checked_axes(shape: tuple[int, ...], origin, spacing) -> tuple[np.ndarray, np.ndarray]:
    """Return the first node and the spacing [m] of a grid of a shape, as read-only float64 arrays."""
    dimension, asked = len(shape), spacing
    origin, given = np.array(origin, dtype=np.float64).reshape(-1), origin
    spacing = np.array(spacing, dtype=np.float64).reshape(-1)
    if origin.shape != (dimension,) or spacing.shape != (dimension,):
        raise ValueError(
            f"origin and spacing need one entry per array axis ({dimension}), got {origin.size} and {spacing.size}"
        )
    if not np.isfinite(origin).all():
        raise ValueError(f"origin must be finite, got {given!r}")
    if not (np.isfinite(spacing).all() and (spacing > 0.0).all()):
        raise ValueError(f"spacing must be positive and finite along every axis, got {asked!r}")
    farthest = np.maximum(np.abs(origin), np.abs(origin + spacing * (np.array(shape) - 1)))
    # Float64 does not resolve node positions that are closer together than this fraction of their coordinates.
    if (spacing < 1e-11 * farthest).any():
        raise ValueError(
            f"a spacing of {spacing.tolist()} m is not resolved at coordinates of {farthest.tolist()} m: "
            "is one of them in another unit? Give metres, and put the origin near the flow"
        )
    if min(shape) < 2:
        raise ValueError(f"every axis needs at least two nodes, got shape {shape}")
    origin.setflags(write=False)
    spacing.setflags(write=False)
    return origin, spacing


def check_starts_on_axis(origin: np.ndarray, spacing: np.ndarray) -> None:
    """Reject the first node and spacing [m] of an axisymmetric grid that does not start at r = 0."""
    if abs(origin[0]) > 1e-9 * spacing[0]:
        raise ValueError(f"an axisymmetric grid starts at r = 0, got origin {origin[0]:g} m")


@dataclass(frozen=True, eq=False)
class GridPlaces(Derived):
    """The positions of a uniform grid's nodes, and the results that later stages have computed from them."""

    shape: tuple[int, ...]
    origin: np.ndarray
    spacing: np.ndarray
    even_first_axis: bool


def contrast_array(contrast: Any) -> np.ndarray:
    """Return a contrast as a NumPy array of real numbers."""
    array = plain_array(contrast)
    if not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
        raise TypeError(f"contrast must be an array of real numbers, got dtype {array.dtype}")
    if array.dtype == np.float16:
        raise ValueError("contrast is float16, whose least digit is 6e-8: compute n - ambient_index in float32 or more")
    return array


def warn_of_index(least: float, greatest: float) -> None:
    """Warn a caller of from_samples or from_mesh whose contrasts look like indices n, of any medium up to germanium."""
    if 0.99 < least <= greatest < 4.5:
        warn_caller(
            f"contrast is {least:g} to {greatest:g} everywhere: it is n - ambient_index, not n itself",
        )


@shown
@dataclass(frozen=True, eq=False)
class UniformGrid(Derived):
    """Samples on a uniform grid of two or three local axes."""

    samples: np.ndarray  # contrast at the nodes, float64, or float32 if it was given so
    origin: np.ndarray  # first node [m], shape (d,)
    spacing: np.ndarray  # [m], shape (d,)
    interpolation: str
    even_first_axis: bool  # mirror symmetry at the first node of axis 0
    ambient_index: float  # index where the contrast is zero
    keeps_averages: bool = False  # whether the samples were made so that the interpolant has averages of cells

    def __post_init__(self):
        """Check shapes and numbers."""
        samples = self.samples
        origin, spacing = checked_axes(np.shape(samples), self.origin, self.spacing)
        check_choice(self.interpolation, "interpolation", spline.INTERPOLATIONS)
        # Read-only arrays are not copied, since grids may have 100 million nodes.
        own = isinstance(samples, np.ndarray) and not samples.flags.writeable and samples.flags.owndata
        if not (own and samples.dtype in KINDS and samples.flags.c_contiguous):
            given = np.asarray(samples)
            samples = np.empty(given.shape, given.dtype if given.dtype in KINDS else np.dtype(np.float64))
            self.__dict__["extremes"] = copy_and_scan(samples, given)
        self.set_fields(samples=samples, origin=origin, spacing=spacing)
        if not np.isfinite(self.extremes).all():
            check_finite(samples, "the contrast")
        _ = self.places  # shared with grids that exist now

    @cached_property
    def extremes(self) -> tuple[float, float]:
        """Least and greatest contrast."""
        return extremes_of(self.samples)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of nodes along each axis."""
        return self.samples.shape

    @cached_property
    def low(self) -> np.ndarray:
        """Lowest corner [m], shape (d,)."""
        return self.origin

    @cached_property
    def high(self) -> np.ndarray:
        """Highest corner [m], shape (d,)."""
        high: np.ndarray = self.origin + self.spacing * (np.array(self.shape) - 1)
        high.setflags(write=False)
        return high

    @cached_property
    def places(self) -> GridPlaces:
        """Positions of the nodes: one object, with the results cached on it, for all grids that exist now."""
        in_use: WeakValueDictionary[tuple, GridPlaces] = OPENED.once("positions of nodes in use", WeakValueDictionary)
        key = self.shape, self.origin.tobytes(), self.spacing.tobytes(), self.even_first_axis
        return in_use.get(key) or in_use.setdefault(
            key, GridPlaces(self.shape, self.origin, self.spacing, self.even_first_axis)
        )

    @cached_property
    def coefficient_shape(self) -> tuple[int, ...]:
        """Shape of the coefficient array."""
        if self.interpolation == "cubic":
            return tuple(count + 2 for count in self.shape)
        return tuple(spline.STRIDE[self.interpolation] * count for count in self.shape)

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Coefficient array of the potential's interpolant; copied from the device where it was computed, if it was."""
        fetch = self.held(FETCH)
        if fetch is not None:
            return np.asarray(fetch())
        return spline.coefficients(self.samples, self.interpolation, self.even_first_axis, self.potential_of)

    @property
    def doubles(self) -> np.ndarray:
        """The samples as float64, flat."""
        return np.asarray(self.samples, np.float64).reshape(-1)

    def potential_of(self, contrast: np.ndarray) -> np.ndarray:
        """Return the potential of some samples, float64."""
        contrast = np.asarray(contrast, np.float64)
        return contrast * (self.ambient_index + 0.5 * contrast)

    @cached_property
    def paper_step(self) -> np.ndarray:
        """Step length [m] of the paper's eq 5 for every cell, shape of the cells."""
        dimension = self.samples.ndim
        corners = [
            self.samples[tuple(slice(o, n - 1 + o) for o, n in zip(offset, self.shape, strict=True))]
            for offset in product((0, 1), repeat=dimension)
        ]
        size = float(np.prod(self.spacing) ** (1.0 / dimension))
        span = np.subtract(np.maximum.reduce(corners), np.minimum.reduce(corners), dtype=np.float64)
        return eq5_step(span, size)

    def evaluate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return contrast, shape (n,), and gradient [1/m], shape (n, d), at local points (n, d) inside the box."""
        potential, force = self.evaluate_potential(points)
        index = np.sqrt(np.maximum(self.ambient_index**2 + 2.0 * potential, 0.0))
        return 2.0 * potential / (index + self.ambient_index), force / index[:, None]

    def evaluate_potential(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the optical potential, shape (n,), and its gradient [1/m], shape (n, d), at local points (n, d)."""
        dimension = self.samples.ndim
        support, stride = spline.SUPPORT[self.interpolation], spline.STRIDE[self.interpolation]
        pitches = [int(np.prod(self.coefficient_shape[axis + 1 :])) for axis in range(dimension)]
        first = np.zeros(len(points), dtype=np.int64)
        value_weight, slope_weight = [], []
        for axis in range(dimension):
            place = (points[:, axis] - self.origin[axis]) / self.spacing[axis]
            cell = np.clip(np.floor(place).astype(np.int64), 0, self.shape[axis] - 2)
            value, slope = spline.weights(self.interpolation, place - cell)
            first += cell * (stride * pitches[axis])
            value_weight.append(value)
            slope_weight.append(slope / self.spacing[axis])
        flat, spare = self.coefficients.reshape(-1), np.empty(len(points))
        result = np.zeros(len(points))
        gradient = np.zeros((dimension, len(points)))
        for offset in product(range(support), repeat=dimension):
            picked = flat[int(np.dot(offset, pitches)) :].take(first)
            chosen = [value_weight[a][o] for a, o in enumerate(offset)]
            result += np.multiply(picked, _product(chosen, spare), out=spare)
            for axis, slope in enumerate(gradient):
                factors = [slope_weight[a][o] if a == axis else chosen[a] for a, o in enumerate(offset)]
                slope += np.multiply(picked, _product(factors, spare), out=spare)
        return result, np.ascontiguousarray(gradient.T)


def _product(factors: list[np.ndarray], out: np.ndarray) -> np.ndarray:
    """Return the product of arrays, written into `out`: allocating memory would take as long as the product."""
    np.multiply(factors[0], factors[1], out=out)
    for factor in factors[2:]:
        np.multiply(out, factor, out=out)
    return out


def eq5_step(difference: np.ndarray, size) -> np.ndarray:
    """Return the step length of the paper's eq 5: a fraction of the cell size that falls with the index difference."""
    share = np.select(
        [difference <= 1e-5, difference <= 1e-4, difference <= 1e-3, difference <= 1e-2], [1.0, 0.5, 0.2, 0.1], 0.05
    )
    return share * size


def contrast_on_axes(grid: UniformGrid, axes: list[np.ndarray]) -> np.ndarray:
    """Return the contrast at every combination of coordinates along the grid's axes [m]; zero outside its box.

    One sparse matrix product for each axis takes a small fraction of the time of `UniformGrid.evaluate`.
    """
    from scipy.sparse import csr_array

    support, stride = spline.SUPPORT[grid.interpolation], spline.STRIDE[grid.interpolation]
    values = grid.coefficients
    inside = np.ones((1,) * len(axes), dtype=bool)
    for number, points in enumerate(axes):
        points = np.asarray(points, dtype=np.float64)
        place = (points - grid.origin[number]) / grid.spacing[number]
        last = grid.shape[number] - 1
        within = (place >= -1e-12 * last) & (place <= last * (1.0 + 1e-12))
        cell = np.clip(np.floor(place).astype(np.int64), 0, last - 1)
        weight, _ = spline.weights(grid.interpolation, np.where(within, place - cell, 0.0))
        column = cell * stride + np.arange(support)[:, None]
        row = np.broadcast_to(np.arange(len(points)), column.shape)
        matrix = csr_array((weight.ravel(), (row.ravel(), column.ravel())), shape=(len(points), values.shape[number]))
        moved = np.moveaxis(values, number, 0)
        product = matrix @ moved.reshape(len(moved), -1)
        values = np.moveaxis(product.reshape((len(points), *moved.shape[1:])), 0, number)
        inside = inside & np.reshape(within, [-1 if axis == number else 1 for axis in range(len(axes))])
    ambient = grid.ambient_index
    index = np.sqrt(np.maximum(ambient**2 + 2.0 * values, 0.0))
    return np.where(inside, 2.0 * values / (index + ambient), 0.0)


def contrast_without_gradient(field, points: np.ndarray) -> np.ndarray:
    """Return the contrast of an index field at points (n, 3), shape (n,), for cubic grids in a sixth of the time."""
    if not field.is_uniform or field.interpolation != "cubic":
        return np.asarray(field.contrast_at(points))
    from scipy.ndimage import map_coordinates

    grid = field.samples
    local = field.local_coordinates(points)
    tolerance = 1e-12 * (grid.high - grid.low)
    inside = np.all((local >= grid.low - tolerance) & (local <= grid.high + tolerance), axis=1)
    last = np.array(grid.shape, dtype=np.float64) - 1.0
    place = np.clip((local[inside] - grid.origin) / grid.spacing, 0.0, last) + 1.0  # one coefficient before the first
    potential = map_coordinates(grid.coefficients, place.T, order=3, prefilter=False, mode="nearest", output=np.float64)
    ambient = grid.ambient_index
    contrast = np.zeros(len(local))
    contrast[inside] = 2.0 * potential / (np.sqrt(np.maximum(ambient**2 + 2.0 * potential, 0.0)) + ambient)
    return contrast
