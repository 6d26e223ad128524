r"""Projection tables: what collimated rays along z gather in a volume, as splines over where they start.

With z as the variable, p the transverse part of the momentum n dr/ds and s = (n^2 - a^2) / 2,

    x' = p / p_z,   p' = grad_xy s / p_z,   p_z = sqrt(n^2 - p^2),      optical path = int n^2 / p_z dz

so that in first order, along the straight line, optical path less a L is A = int s / a dz, p = grad A, and the ray's
shift is grad D with D = int A / a dz. Where s is a cubic spline, A and D are cubic splines of x and y with the same
knots: their coefficients are integrals of those of s, and are exact. The higher orders are small and smooth. They are
computed on the grid's own lines along z, with the field expanded about the straight line to second order and the path
once corrected (so that only terms of fourth order in the contrast are missing), and splined from there.

The size of the third order, which is taken into account, is the estimate of the orders that are left out.

What bending adds is of second order in grad A, which is known everywhere and not on those lines alone. Between lines
its spline is right where grad A hardly changes from one line to the next: by differences of A's coefficients, with
p = grad A and d its differences from node to node,

    error <= int (|p| |d^3 p| + |d^2 p|^2) / (16 a) dz

(twelve times what it is on samples that alternate along one axis, far more on smooth ones). Where that counts
the same sums are made in the middles of cells and of their edges too, and compared with the spline there.
"""

from dataclasses import dataclass
from dataclasses import field as member
from types import SimpleNamespace

import numpy as np

from ..derived import Derived
from ..medium import IndexField
from ..medium import spline as splines
from .projection_splines import at_places, integrals

# Points in a cell at which the small terms are summed (midpoint rule).
SUBCELLS = 2
# Steps that are worked on at a time.
CHUNK = 24  # speed only
# Tables kept for a field.
KEPT = 8  # speed only
# One of this many steps is looked at for the bound between the grid's lines along z.
SEEN_STEPS = 6
# The greatest shift of a ray, in cells, for which the field is expanded about the straight line.
FURTHEST = 0.25
# What is splined from the columns, in this order.
EXTRAS = ("opd", "arc", "momentum_x", "momentum_y", "shift_x", "shift_y", "potential", "error")


@dataclass(frozen=True, eq=False)
class ProjectionTables(Derived):
    """Splines over x and y of what rays along z gather between two planes.

    Attributes:
        path: Coefficients of A [m], shape (nx + 2, ny + 2).
        shift: Coefficients of D [m2].
        extra: Coefficients of what is added to them, EXTRAS along the last axis: optical path [m], arc length less the
            distance [m], momentum, shift [m]; then the potential at the last plane and the estimated error [m].
        greatest_shift: Greatest shift of a ray, in cells.
        greatest_error: Greatest estimated error of the optical path on the columns [m].
        greatest_deflection: Greatest angle by which a ray is turned on the columns [rad].
        between_bound: A bound of the error of the optical path that comes to it between columns [m].
    """

    path: np.ndarray
    shift: np.ndarray
    extra: np.ndarray
    greatest_shift: float
    greatest_error: float
    greatest_deflection: float
    between_bound: float


@dataclass(frozen=True)
class BetweenErrors:
    """Errors of the splines in the middles of cells and of their edges.

    Attributes:
        path: Greatest error of the optical path [m], estimated as on the columns, and of its spline there.
        extra: Greatest size of what is added to the path in first order there [m].
        direction: Greatest error of a direction [rad].
    """

    path: float
    extra: float
    direction: float


def projection_tables(field: IndexField, sign: float, first: float, last: float) -> ProjectionTables:
    """The tables for rays along sign * z from plane z = first to plane z = last; the last few are kept with the field.

    Args:
        field: A volume with a cubic interpolant.
        sign: 1.0 or -1.0.
        first: Where the rays begin [m], in the box.
        last: Where they end [m], in the box, further along.
    """
    key = ("columns", sign, first, last)
    return field.derive(key, lambda: _projection_tables(field, sign, first, last), KEPT)


def between_projections(field: IndexField, sign: float, first: float, last: float) -> BetweenErrors:
    """What the tables of `projection_tables`, whose arguments these are, miss between columns; kept with the field."""
    key = ("between columns", sign, first, last)
    tables = projection_tables(field, sign, first, last)
    return field.derive(key, lambda: _between_projections(field, tables, sign, first, last), KEPT)


def _between_projections(field: IndexField, tables: ProjectionTables, sign, first: float, last: float) -> BetweenErrors:
    spacing = field.samples.spacing[:2]
    gathered = _gather(
        field, sign, first, last, (_March(half) for half in ((True, True), (True, False), (False, True)))
    )
    path = extra = direction = 0.0
    for march in gathered.marches:
        found = march.finish(gathered.path, gathered.shift, gathered.end, spacing, field.ambient_index)
        splined = {name: at_places(tables.extra[..., k], 0, 0, spacing, march.half) for k, name in enumerate(EXTRAS)}
        path = max(path, float((np.abs(found["opd"] - splined["opd"]) + found["error"]).max()))
        extra = max(extra, float(np.abs(found["opd"]).max()))
        turns = [np.abs(found[name] - splined[name]).max() for name in ("momentum_x", "momentum_y")]
        direction = max(direction, float(np.hypot(*turns)) / field.ambient_index)
    return BetweenErrors(path, extra, direction)


def _projection_tables(field: IndexField, sign: float, first: float, last: float) -> ProjectionTables:
    spacing = field.samples.spacing[:2]
    gathered = _gather(field, sign, first, last, (_March((False, False)),))
    state = gathered.marches[0]
    column = state.finish(gathered.path, gathered.shift, gathered.end, spacing, field.ambient_index)
    extra = np.stack([splines.coefficients(column[name], "cubic", False) for name in EXTRAS], axis=-1)
    turned = [at_places(gathered.path, *axis, spacing, (False, False)) for axis in ((1, 0), (0, 1))]
    furthest = max(float(np.abs(q).max()) / h for q, h in zip((state.qx, state.qy), spacing, strict=True))
    return ProjectionTables(
        gathered.path,
        gathered.shift,
        extra,
        max(furthest, gathered.greatest_shift),
        float(np.abs(column["error"]).max()),
        float(np.hypot(turned[0] + state.px, turned[1] + state.py).max()) / field.ambient_index,
        gathered.between_bound,
    )


def _gather(field: IndexField, sign: float, first: float, last: float, marches) -> SimpleNamespace:
    """Coefficients of A, D and the last plane's potential, the marches when they are through, and bounds from A and D.

    The bounds are the greatest shift by grad D, in cells, and the ProjectionTables' `between_bound`.
    """
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
    marches = list(marches)
    greatest_shift = between = 0.0
    for begin in range(0, count, CHUNK):
        at = edges[begin : min(begin + CHUNK, count) + 1]
        middle = 0.5 * (at[:-1] + at[1:])
        # Exact in first order: A and D, coefficient by coefficient.
        s, half_1, half_2 = integrals(planes, at[:-1], middle)
        _, whole_1, whole_2 = integrals(planes, at[:-1], at[1:])
        grown = np.cumsum(hz / ambient * whole_1, axis=0)
        path_at = np.concatenate([path[None], path + grown])
        a_mid = path_at[:-1] + hz / ambient * half_1
        further = step / ambient * path_at[:-1] + (hz / ambient) ** 2 * whole_2
        shift_at = np.concatenate([shift[None], shift + np.cumsum(further, axis=0)])
        d_mid = shift_at[:-1] + 0.5 * step / ambient * path_at[:-1] + (hz / ambient) ** 2 * half_2
        path, shift = path_at[-1], shift_at[-1]
        for march in marches:
            march.advance(s, a_mid, d_mid, (hx, hy), step, ambient)
        seen = path_at[1:][::SEEN_STEPS]
        share = step * len(a_mid) / len(seen)
        between += share * float(_between_bound(seen, (hx, hy)).sum()) / ambient
        greatest_shift = max(
            greatest_shift, *(float(np.abs(np.diff(shift, axis=k)).max()) / h**2 for k, h in enumerate((hx, hy)))
        )
    return SimpleNamespace(
        path=path,
        shift=shift,
        end=integrals(planes, edges[-1:], edges[-1:])[0][0],
        marches=marches,
        greatest_shift=greatest_shift,
        between_bound=between,
    )


def _between_bound(path: np.ndarray, spacing: tuple[float, float]) -> np.ndarray:
    """The bound's integrand times the ambient index, of coefficients of A in planes (n, nx + 2, ny + 2)."""
    found = np.zeros(len(path))
    for across, h in enumerate(spacing, start=1):
        slope = np.diff(path, axis=across) / h
        steepest = np.abs(slope).max(axis=(1, 2))
        for axis in (1, 2):
            second = np.diff(slope, 2, axis=axis)
            third = np.diff(second, axis=axis)
            # One cell across has no fourth difference.
            of_third = np.abs(third).max(axis=(1, 2), initial=0.0)
            found += steepest * of_third + np.abs(second).max(axis=(1, 2)) ** 2
    return found / 16.0


def _nothing() -> np.ndarray:
    return np.zeros(())


@dataclass(eq=False)
class _March:
    """Sums over the planes so far, on the grid's columns or between them; q and p are the ray's shift and momentum.

    They are whole, and have the shape of the columns from the first plane on.
    """

    half: tuple[bool, bool]  # along which axes it runs in the middles of cells
    qx: np.ndarray = member(default_factory=_nothing)
    qy: np.ndarray = member(default_factory=_nothing)
    px: np.ndarray = member(default_factory=_nothing)  # what the momentum has beyond grad A
    py: np.ndarray = member(default_factory=_nothing)
    sx: np.ndarray = member(default_factory=_nothing)  # what the shift has beyond grad D
    sy: np.ndarray = member(default_factory=_nothing)
    opd: np.ndarray = member(default_factory=_nothing)
    first_opd: np.ndarray = member(default_factory=_nothing)
    arc: np.ndarray = member(default_factory=_nothing)

    def advance(self, s, a_mid, d_mid, spacing, h: float, ambient: float) -> None:
        """Add planes: coefficients of s, A and D at the middles of steps of length h [m]."""

        def at(c: np.ndarray, x: int, y: int) -> np.ndarray:
            return at_places(c, x, y, spacing, self.half)

        value, gx, gy = at(s, 0, 0), at(s, 1, 0), at(s, 0, 1)
        hxx, hxy, hyy = at(s, 2, 0), at(s, 1, 1), at(s, 0, 2)
        ax, ay, dx, dy = at(a_mid, 1, 0), at(a_mid, 0, 1), at(d_mid, 1, 0), at(d_mid, 0, 1)

        def turned(qx, qy, px, py):
            """Twice the potential plus a^2, p_z and the force on a shifted ray."""
            there = value + gx * qx + gy * qy + 0.5 * (hxx * qx**2 + 2.0 * hxy * qx * qy + hyy * qy**2)
            square = ambient**2 + 2.0 * there
            return square, np.sqrt(square - px**2 - py**2), gx + hxx * qx + hxy * qy, gy + hxy * qx + hyy * qy

        def middles(rate: np.ndarray, before) -> tuple[np.ndarray, np.ndarray]:
            """Sums of h * rate up to the middle of each step, and after the last one."""
            total = before + h * np.cumsum(rate, axis=0)
            return total - 0.5 * h * rate, total[-1]

        square, pz, fx, fy = turned(dx, dy, ax, ay)
        first = square / pz - ambient - value / ambient
        more_px, self.px = middles(fx / pz - gx / ambient, self.px)
        more_py, self.py = middles(fy / pz - gy / ambient, self.py)
        px, py = ax + more_px, ay + more_py
        more_qx, self.sx = middles(px / pz - ax / ambient, self.sx)
        more_qy, self.sy = middles(py / pz - ay / ambient, self.sy)
        square, pz, _, _ = turned(dx + more_qx, dy + more_qy, px, py)
        self.qx = np.maximum(self.qx, np.abs(dx + more_qx).max(axis=0))
        self.qy = np.maximum(self.qy, np.abs(dy + more_qy).max(axis=0))
        self.opd = self.opd + h * np.sum(square / pz - ambient - value / ambient, axis=0)
        self.first_opd = self.first_opd + h * np.sum(first, axis=0)
        self.arc = self.arc + h * np.sum(np.sqrt(square) / pz - 1.0, axis=0)

    def finish(self, path, shift, end, spacing, ambient: float) -> dict[str, np.ndarray]:
        """EXTRAS on the columns."""

        def at(c: np.ndarray, x: int, y: int) -> np.ndarray:
            return at_places(c, x, y, spacing, self.half)

        qx, qy = at(shift, 1, 0) + self.sx, at(shift, 0, 1) + self.sy
        potential = at(end, 0, 0) + at(end, 1, 0) * qx + at(end, 0, 1) * qy
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
