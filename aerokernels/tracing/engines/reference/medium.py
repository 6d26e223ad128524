"""A uniform grid for the reference integrator: one smooth piece at a time, evaluated for a whole bundle in float64.

An interpolant is a polynomial in every cell, and only there. A frame has, for each ray of a bundle, the cell of the ray
and the place from which its step starts. It evaluates the polynomial of that cell, continued analytically if a stage of
the step leaves the cell, and returns the distances from the faces of the cell. The integrator ends its steps on the
faces, so that no step crosses a jump of any derivative.

Places within a step are differences from its start, so that a fraction of a cell keeps all its digits.

Arrays: `place` (n, 3) [m]; `tangent` T = n dr/ds and `force` dT/d sigma = grad s, both (n, 3); `cell` (n, axes), whole
numbers. Faces are numbered 2 k (low) and 2 k + 1 (high) along local axis k. At the axis of symmetry the low radial face
is replaced by the closest approach to the axis, where a function of the radius has its kink.
"""

import numpy as np

from ....medium import IndexField
from ....medium.grid import AXIS_CORE
from ....medium.spline import STRIDE, SUPPORT, weights

# A ray within this share of a cell from a face counts as on the face when its cell is searched: its direction decides.
ON_FACE = 1e-9


def dot(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Row by row scalar product of (n, k) arrays, shape (n,)."""
    return np.einsum("nk,nk->n", first, second)


def plane_motion(place, tangent, force, axisymmetric: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place, velocity and acceleration over sigma in the plane of the field, (y, z) or (r, z), each (n, 2)."""
    if not axisymmetric:
        return place[:, 1:], tangent[:, 1:], force[:, 1:]
    radius = np.hypot(place[:, 0], place[:, 1])
    square = dot(tangent[:, :2], tangent[:, :2])
    safe = np.where(radius > 0.0, radius, 1.0)
    rise = np.where(radius > 0.0, dot(place[:, :2], tangent[:, :2]) / safe, np.sqrt(square))
    bend = np.where(radius > 0.0, (square + dot(place[:, :2], force[:, :2]) - rise**2) / safe, 0.0)
    return (
        np.stack([radius, place[:, 2]], axis=1),
        np.stack([rise, tangent[:, 2]], axis=1),
        np.stack([bend, force[:, 2]], axis=1),
    )


def outward(place) -> np.ndarray:
    """Unit vectors away from the axis, shape (n, 3); zero on it."""
    radius = np.hypot(place[:, 0], place[:, 1])
    return place * [1.0, 1.0, 0.0] / np.where(radius > 0.0, radius, 1.0)[:, None]


def approach(place, tangent, force) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance of a ray behind its closest approach to the axis [m], with rate and curvature; -inf along the axis."""
    square = dot(tangent[:, :2], tangent[:, :2])
    speed = np.sqrt(np.where(square > 0.0, square, 1.0))
    value = np.where(square > 0.0, dot(place[:, :2], tangent[:, :2]) / speed, -np.inf)
    rate = np.where(square > 0.0, (square + dot(place[:, :2], force[:, :2])) / speed, 0.0)
    return value, rate, np.zeros_like(rate)


def radius_increment(place, delta) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radius [m] at place and at place + delta, and their difference without cancellation."""
    before = np.hypot(place[:, 0], place[:, 1])
    after = np.hypot(place[:, 0] + delta[:, 0], place[:, 1] + delta[:, 1])
    both = before + after
    change = dot(2.0 * place[:, :2] + delta[:, :2], delta[:, :2]) / np.where(both > 0.0, both, 1.0)
    return before, after, change


class GridAir:
    """A uniform grid."""

    def __init__(self, field: IndexField):
        """Lay out edges, rows of samples and coefficients."""
        samples = field.samples
        self.axisymmetric = field.geometry == "axisymmetric"
        self.first_axis = {"volume": 0, "planar": 1, "axisymmetric": 1}[field.geometry]
        self.interpolation = samples.interpolation
        self.low, self.spacing = samples.origin, samples.spacing
        self.axes = samples.samples.ndim
        # Edges of the cells along each axis, in spacings, and the row of samples to which each cell belongs.
        self.edges = [np.arange(n, dtype=np.float64) for n in samples.shape]
        self.core = AXIS_CORE * self.spacing[0] if self.axisymmetric and self.interpolation == "linear" else 0.0
        if self.core > 0.0:
            # The kink on the axis is rounded off within a core: its rim is one more face.
            self.edges[0] = np.insert(self.edges[0], 1, AXIS_CORE)
        self.row = [np.floor(edges[:-1]).astype(np.int64) for edges in self.edges]
        self.support, stride = SUPPORT[self.interpolation], STRIDE[self.interpolation]
        shape = samples.coefficients.shape
        self.coefficients = np.ascontiguousarray(samples.coefficients).ravel()
        pitch = np.array([int(np.prod(shape[k + 1 :])) for k in range(self.axes)], dtype=np.int64)
        self.cell_pitch = stride * pitch
        reach = np.meshgrid(*[np.arange(self.support) * p for p in pitch], indexing="ij")
        self.offset = np.sum(reach, axis=0).ravel()
        self.face_count = 2 * self.axes
        self.axis_is_kink = False  # even in r, or rounded off
        self.size = float(self.spacing.min())
        # Size of the terms of which forces are sums and differences [1/m]: the rounding of a force is a share of it.
        self.force_scale = float(np.abs(self.coefficients).max()) / self.size

    def local(self, place, tangent) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates along the samples' axes, in spacings, and their direction."""
        if self.axisymmetric:
            there, velocity, _ = plane_motion(place, tangent, np.zeros_like(place), True)
        else:
            there, velocity = place[:, self.first_axis :], tangent[:, self.first_axis :]
        return (there - self.low) / self.spacing, velocity

    def cell_at(self, place, tangent) -> np.ndarray:
        """The cell of a ray; for a ray on a face, the cell that it enters."""
        there, velocity = self.local(place, tangent)
        cell = np.empty(there.shape, dtype=np.int64)
        for k, edges in enumerate(self.edges):
            ahead = there[:, k] + ON_FACE * np.sign(velocity[:, k])
            cell[:, k] = np.clip(np.searchsorted(edges, ahead, side="right") - 1, 0, len(edges) - 2)
        return cell

    def in_gap(self, cell) -> np.ndarray:
        """Whether a ray is outside all cells: never on a grid."""
        return np.zeros(len(cell), dtype=bool)

    def cross(self, cell, face, place, tangent) -> tuple[np.ndarray, np.ndarray]:
        """The cells behind faces, and which rays have left the grid through them."""
        axis, step = face // 2, 2 * (face % 2) - 1
        rows = np.arange(len(cell))
        after = cell.copy()
        after[rows, axis] += step
        if self.axisymmetric:  # the closest approach to the axis is not the end of a cell
            after[(axis == 0) & (after[:, 0] < 0), 0] = 0
        count = np.array([len(edges) - 1 for edges in self.edges])
        left = (after[rows, axis] < 0) | (after[rows, axis] >= count[axis])
        return np.clip(after, 0, count - 1), left

    def normal(self, cell, face, place) -> np.ndarray:
        """Unit normals of faces, of either sense, at places on them, shape (n, 3)."""
        if not self.axisymmetric:
            return np.eye(3)[self.first_axis + face // 2]
        return np.where((face < 2)[:, None], outward(place), [0.0, 0.0, 1.0])

    def frame(self, cell, place) -> "GridFrame":
        """The pieces of the interpolant in these cells, relative to these places."""
        return GridFrame(self, cell, place)


class GridFrame:
    """The cells of a grid in which the rays of a bundle are."""

    def __init__(self, air: GridAir, cell, place):
        """Gather the coefficients of the cells."""
        self.air, self.cell, self.place = air, cell, place
        self.row = np.stack([air.row[k][cell[:, k]] for k in range(air.axes)], axis=1)
        index = self.row @ air.cell_pitch
        size = (air.support,) * air.axes
        self.coefficients = air.coefficients[air.offset[:, None] + index].astype(np.float64).reshape((*size, len(cell)))
        there, _ = air.local(place, np.zeros_like(place))
        self.start = there - self.row

    def fraction(self, delta) -> np.ndarray:
        """Fraction of the cell at place + delta along each local axis, shape (n, axes)."""
        air = self.air
        if not air.axisymmetric:
            return self.start + delta[:, air.first_axis :] / air.spacing
        _, _, change = radius_increment(self.place, delta)
        return self.start + np.stack([change, delta[:, 2]], axis=1) / air.spacing

    def sample(self, delta) -> tuple[np.ndarray, np.ndarray]:
        """Potential s, shape (n,), and its gradient [1/m], shape (n, 3), at place + delta."""
        air = self.air
        value, slope = weights(air.interpolation, self.fraction(delta).T)  # (support, axes, n)
        rest = self.coefficients
        if air.axes == 3:
            along = _under(rest, value[:, 2])
            climb = _under(rest, slope[:, 2])
            sheet, bend, tilt = _under(along, value[:, 1]), _under(along, slope[:, 1]), _under(climb, value[:, 1])
            parts = [_under(sheet, slope[:, 0]), _under(bend, value[:, 0]), _under(tilt, value[:, 0])]
            return _under(sheet, value[:, 0]), np.stack(parts, axis=1) / air.spacing
        along, climb = _under(rest, value[:, 1]), _under(rest, slope[:, 1])
        first = _under(along, slope[:, 0]) / air.spacing[0]
        second = _under(climb, value[:, 0]) / air.spacing[1]
        if not air.axisymmetric:
            return _under(along, value[:, 0]), np.stack([np.zeros_like(first), first, second], axis=1)
        there = self.place[:, :2] + delta[:, :2]
        size = np.maximum(np.hypot(there[:, 0], there[:, 1]), air.core)
        outward = there / np.where(size > 0.0, size, 1.0)[:, None]
        return _under(along, value[:, 0]), np.concatenate([outward * first[:, None], second[:, None]], axis=1)

    def faces(self, delta, tangent, force) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance outside each face [m], its rate and its curvature over sigma, each (n, face_count)."""
        air = self.air
        shape = (len(delta), air.face_count)
        value, rate, curve = np.empty(shape), np.empty(shape), np.empty(shape)
        fraction = self.fraction(delta)
        for k in range(air.axes):
            edges = air.edges[k]
            low = (edges[self.cell[:, k]] - self.row[:, k] - fraction[:, k]) * air.spacing[k]
            high = (fraction[:, k] - edges[self.cell[:, k] + 1] + self.row[:, k]) * air.spacing[k]
            if air.axisymmetric and k == 0:
                self._cylinders(low, high, delta, tangent, force, value, rate, curve)
                continue
            axis = air.first_axis + k if not air.axisymmetric else 2
            value[:, 2 * k], value[:, 2 * k + 1] = low, high
            rate[:, 2 * k], rate[:, 2 * k + 1] = -tangent[:, axis], tangent[:, axis]
            curve[:, 2 * k], curve[:, 2 * k + 1] = -force[:, axis], force[:, axis]
        return value, rate, curve

    def _cylinders(self, low, high, delta, tangent, force, value, rate, curve) -> None:
        """Fill in the radial faces, which are quadratic functions along a straight ray."""
        air = self.air
        there = self.place + delta
        radius = np.hypot(there[:, 0], there[:, 1])
        rise = dot(there[:, :2], tangent[:, :2])
        bend = dot(tangent[:, :2], tangent[:, :2]) + dot(there[:, :2], force[:, :2])
        for column, sense, miss in ((0, -1.0, low), (1, 1.0, high)):
            edge = air.edges[0][self.cell[:, 0] + column] * air.spacing[0]
            safe = np.where(edge > 0.0, edge, 1.0)
            value[:, column] = miss * (radius + edge) / (2.0 * safe)
            rate[:, column] = sense * rise / safe
            curve[:, column] = sense * bend / safe
        inner = self.cell[:, 0] == 0
        if inner.any():
            for array, part in zip(
                (value, rate, curve), approach(there[inner], tangent[inner], force[inner]), strict=True
            ):
                array[inner, 0] = part

    def turning(self) -> np.ndarray:
        """Which faces are the closest approach to the axis, shape (n, face_count)."""
        result = np.zeros((len(self.cell), self.air.face_count), dtype=bool)
        if self.air.axisymmetric:
            result[:, 0] = self.cell[:, 0] == 0
        return result


def _under(array: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the sum over the last axis but one with the weights (support, n); rays are the last axis."""
    total = array[..., 0, :] * weight[0]
    for k in range(1, len(weight)):
        total = total + array[..., k, :] * weight[k]
    return total
