r"""What collimated rays along z gather in a volume, as functions of where they start: two axes instead of three.

With z as the variable, p the transverse part of the momentum n dr/ds and s = (n^2 - a^2) / 2,

    x' = p / w,   p' = grad_xy s / w,   w = sqrt(n^2 - p^2),      optical path = int n^2 / w dz

so that in first order, along the straight line, optical path less a L is A = int s / a dz, p = grad A, and the ray's
shift is grad D with D = int A / a dz. Where s is a cubic spline, A and D are cubic splines of x and y with the same
knots: their coefficients are integrals of those of s, and are exact. What comes on top is small and smooth. It is
computed on the grid's own columns, with the field expanded about the straight line to second order and the path once
corrected (so that only terms of fourth order in the contrast are missing), and splined from there.

The size of the third order, which is taken into account, stands for the error of what is not.
"""

import weakref
from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..medium import spline as splines

# Points in a cell at which the small terms are summed (midpoint rule).
SUBCELLS = 2
# Steps that are worked on at a time.
CHUNK = 24
# Tables kept for a field.
KEPT = 8
# The greatest shift of a ray, in cells, for which the field is expanded about the straight line.
FURTHEST = 0.25
# What is splined from the columns, in this order.
EXTRAS = ("opd", "arc", "momentum_x", "momentum_y", "shift_x", "shift_y", "potential", "error")

_kept: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class ColumnTables:
    """Splines over x and y of what rays along z gather between two planes.

    Attributes:
        path: Coefficients of A [m], shape (nx + 2, ny + 2).
        shift: Coefficients of D [m2].
        extra: Coefficients of what is added to them, EXTRAS along the last axis: optical path [m], arc length less the
            distance [m], momentum, shift [m]; then the potential at the last plane and the estimated error [m].
        greatest_shift: Greatest shift of a ray, in cells.
        greatest_error: Greatest estimated error of the optical path [m].
    """

    path: np.ndarray
    shift: np.ndarray
    extra: np.ndarray
    greatest_shift: float
    greatest_error: float


def column_tables(field: IndexField, sign: float, first: float, last: float) -> ColumnTables:
    """The tables for rays along sign * z from plane z = first to plane z = last; the last few are kept with the field.

    Args:
        field: A volume with a cubic interpolant.
        sign: 1.0 or -1.0.
        first: Where the rays begin [m], in the box.
        last: Where they end [m], in the box, further along.
    """
    store = _kept.setdefault(field, {})
    key = (sign, first, last)
    if key not in store:
        while len(store) >= KEPT:
            del store[next(iter(store))]
        store[key] = _column_tables(field, sign, first, last)
    return store[key]


def _column_tables(field: IndexField, sign: float, first: float, last: float) -> ColumnTables:
    grid = field.samples
    ambient = field.ambient_index
    hx, hy, hz = grid.spacing
    planes = np.moveaxis(grid.coefficients, 2, 0)
    if sign < 0.0:
        planes, start = planes[::-1], (grid.high[2] - first) / hz
    else:
        start = (first - grid.origin[2]) / hz
    length = abs(last - first)
    cells = length / hz
    # The middles of the steps, in cells from the grid's first plane on.
    count = max(1, int(np.ceil(cells * SUBCELLS - 1e-9)))
    edges = np.clip(start + cells / count * np.arange(count + 1), 0.0, len(planes) - 3.0)
    step = hz * cells / count

    path = np.zeros(planes.shape[1:])
    shift = np.zeros(planes.shape[1:])
    state = _March.begin(grid.shape[:2])
    for begin in range(0, count, CHUNK):
        at = edges[begin : min(begin + CHUNK, count) + 1]
        middle = 0.5 * (at[:-1] + at[1:])
        # Exact in first order: A and D, coefficient by coefficient.
        s, half_1, half_2 = _integrals(planes, at[:-1], middle)
        _, whole_1, whole_2 = _integrals(planes, at[:-1], at[1:])
        grown = np.cumsum(hz / ambient * whole_1, axis=0)
        path_at = np.concatenate([path[None], path + grown])
        a_mid = path_at[:-1] + hz / ambient * half_1
        further = step / ambient * path_at[:-1] + (hz / ambient) ** 2 * whole_2
        shift_at = np.concatenate([shift[None], shift + np.cumsum(further, axis=0)])
        d_mid = shift_at[:-1] + 0.5 * step / ambient * path_at[:-1] + (hz / ambient) ** 2 * half_2
        path, shift = path_at[-1], shift_at[-1]
        state.advance(s, a_mid, d_mid, (hx, hy), step, ambient)

    end = _integrals(planes, edges[-1:], edges[-1:])[0][0]
    column = state.finish(path, shift, end, (hx, hy), ambient)
    extra = np.stack([splines.coefficients(column[name], "cubic", False) for name in EXTRAS], axis=-1)
    furthest = max(float(np.abs(state.qx).max()) / hx, float(np.abs(state.qy).max()) / hy)
    return ColumnTables(path, shift, extra, furthest, float(np.abs(column["error"]).max()))


def _integrals(planes: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, ...]:
    """Coefficients over x and y of s at `end`, and of its integral and twofold integral from `begin` to `end`.

    Places are in cells; shape (n, nx + 2, ny + 2). A step may cross the boundary of two cells.
    """
    low = int(np.clip(np.floor(begin[0]), 0, len(planes) - 4))
    high = int(np.clip(np.floor(end[-1]), 0, len(planes) - 4)) + 4
    value, single, double = (np.zeros((len(begin), high - low)) for _ in range(3))
    for row, (u, v) in enumerate(zip(begin, end, strict=True)):
        cell = int(np.clip(np.floor(v), low, high - 4))
        value[row, cell - low : cell - low + 4] = splines.weights("cubic", np.array(v - cell))[0]
        cell = int(np.clip(np.floor(u), low, high - 4))
        while u < v:
            upto = min(v, cell + 1.0) if cell < high - 4 else v
            columns = slice(cell - low, cell - low + 4)
            double[row] += (upto - u) * single[row]
            double[row, columns] += _twice(upto - cell) - _twice(u - cell) - (upto - u) * _once(u - cell)
            single[row, columns] += _once(upto - cell) - _once(u - cell)
            u, cell = upto, cell + 1
    flat = planes[low:high].reshape(high - low, -1)
    return tuple((weight @ flat).reshape(-1, *planes.shape[1:]) for weight in (value, single, double))


def _once(u: float) -> np.ndarray:
    """Integrals of the four weights of spline.py from 0 to u."""
    v = 1.0 - u
    return np.array(
        [
            (1.0 - v**4) / 24.0,
            (0.75 * u**4 - 2.0 * u**3 + 4.0 * u) / 6.0,
            (2.75 - (0.75 * v**4 - 2.0 * v**3 + 4.0 * v)) / 6.0,
            u**4 / 24.0,
        ]
    )


def _twice(u: float) -> np.ndarray:
    """Integrals of those."""
    v = 1.0 - u
    return np.array(
        [
            (u - (1.0 - v**5) / 5.0) / 24.0,
            (0.15 * u**5 - 0.5 * u**4 + 2.0 * u**2) / 6.0,
            (2.75 * u - (1.65 - (0.15 * v**5 - 0.5 * v**4 + 2.0 * v**2))) / 6.0,
            u**5 / 120.0,
        ]
    )


def _at_nodes(c: np.ndarray, x: int, y: int, spacing: tuple[float, float]) -> np.ndarray:
    """The derivative of order x, y at the nodes of splines with coefficients c, over the last two axes."""
    for axis, order, h in ((-2, x, spacing[0]), (-1, y, spacing[1])):
        if axis == -2:
            low, middle, high = c[..., :-2, :], c[..., 1:-1, :], c[..., 2:, :]
        else:
            low, middle, high = c[..., :-2], c[..., 1:-1], c[..., 2:]
        if order == 0:
            c = (low + 4.0 * middle + high) / 6.0
        elif order == 1:
            c = (high - low) / (2.0 * h)
        else:
            c = (low - 2.0 * middle + high) / h**2
    return c


@dataclass(eq=False)
class _March:
    """Sums over the planes so far, on the grid's columns; q and p are the ray's whole shift and momentum."""

    qx: np.ndarray
    qy: np.ndarray
    px: np.ndarray  # what the momentum has beyond grad A
    py: np.ndarray
    sx: np.ndarray  # what the shift has beyond grad D
    sy: np.ndarray
    opd: np.ndarray
    first_opd: np.ndarray
    arc: np.ndarray

    @classmethod
    def begin(cls, shape: tuple[int, ...]) -> "_March":
        return cls(*(np.zeros(shape) for _ in range(9)))

    def advance(self, s, a_mid, d_mid, spacing, h: float, ambient: float) -> None:
        """Add planes: coefficients of s, A and D at the middles of steps of length h [m]."""

        def at(c: np.ndarray, x: int, y: int) -> np.ndarray:
            return _at_nodes(c, x, y, spacing)

        value, gx, gy = at(s, 0, 0), at(s, 1, 0), at(s, 0, 1)
        hxx, hxy, hyy = at(s, 2, 0), at(s, 1, 1), at(s, 0, 2)
        ax, ay, dx, dy = at(a_mid, 1, 0), at(a_mid, 0, 1), at(d_mid, 1, 0), at(d_mid, 0, 1)

        def turned(qx, qy, px, py):
            """Potential, force and the share w of the index along z on a shifted ray."""
            there = value + gx * qx + gy * qy + 0.5 * (hxx * qx**2 + 2.0 * hxy * qx * qy + hyy * qy**2)
            square = ambient**2 + 2.0 * there
            return square, np.sqrt(square - px**2 - py**2), gx + hxx * qx + hxy * qy, gy + hxy * qx + hyy * qy

        def middles(rate: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Sums of h * rate up to the middle of each step, and after the last one."""
            total = before + h * np.cumsum(rate, axis=0)
            return total - 0.5 * h * rate, total[-1]

        square, w, fx, fy = turned(dx, dy, ax, ay)
        first = square / w - ambient - value / ambient
        more_px, self.px = middles(fx / w - gx / ambient, self.px)
        more_py, self.py = middles(fy / w - gy / ambient, self.py)
        px, py = ax + more_px, ay + more_py
        more_qx, self.sx = middles(px / w - ax / ambient, self.sx)
        more_qy, self.sy = middles(py / w - ay / ambient, self.sy)
        square, w, _, _ = turned(dx + more_qx, dy + more_qy, px, py)
        self.qx = np.maximum(self.qx, np.abs(dx + more_qx).max(axis=0))
        self.qy = np.maximum(self.qy, np.abs(dy + more_qy).max(axis=0))
        self.opd = self.opd + h * np.sum(square / w - ambient - value / ambient, axis=0)
        self.first_opd = self.first_opd + h * np.sum(first, axis=0)
        self.arc = self.arc + h * np.sum(np.sqrt(square) / w - 1.0, axis=0)

    def finish(self, path, shift, end, spacing, ambient: float) -> dict[str, np.ndarray]:
        """EXTRAS on the columns."""
        qx = _at_nodes(shift, 1, 0, spacing) + self.sx
        qy = _at_nodes(shift, 0, 1, spacing) + self.sy
        potential = _at_nodes(end, 0, 0, spacing)
        potential = potential + _at_nodes(end, 1, 0, spacing) * qx + _at_nodes(end, 0, 1, spacing) * qy
        return {
            "opd": self.opd,
            "arc": self.arc,
            "momentum_x": self.px,
            "momentum_y": self.py,
            "shift_x": self.sx,
            "shift_y": self.sy,
            "potential": potential,
            "error": np.abs(self.opd - self.first_opd),
        }
