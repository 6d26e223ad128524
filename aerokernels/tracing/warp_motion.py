"""Device functions of the tracer: positions in cells, compensated sums, landing on a surface, looking at a stage."""

import functools
from typing import Any

import warp as wp

from .tableau import BT, STAGE_MOMENTUM
from .warp_box import FACE_COUNT, build_surface
from .warp_types import types

# Axes along which a position is kept as cell + fraction.
SHIFTED = {"volume": (0, 1, 2), "planar": (1, 2), "axisymmetric": (2,), "mesh": ()}


@wp.func
def advance(total: Any, carry: Any, term: Any):
    """Kahan's compensated sum: (sum, carry, term) -> (sum, carry)."""
    y = term - carry
    s = total + y
    return s, (s - total) - y


@wp.func
def deflection(ambient: wp.float64, d: wp.vec3d, p: wp.vec3d):
    """Change of the unit tangent from d when the momentum is ambient d + p, without cancellation."""
    speed = wp.length(ambient * d + p)
    excess = (wp.float64(2.0) * ambient * wp.dot(d, p) + wp.dot(p, p)) / (speed + ambient)
    return (p - excess * d) / speed


@functools.cache
def build_contrast(precision: str):
    """A function (ambient, potential) -> contrast."""
    real = types(precision).real

    @wp.func
    def contrast(ambient: real, potential: real):
        """M from s without cancellation."""
        square = wp.max(ambient * ambient + real(2.0) * potential, real(0.0))
        return real(2.0) * potential / (wp.sqrt(square) + ambient)

    return contrast


@functools.cache
def build_lag(precision: str):
    """A function of a step's stages -> its sum of the index less the momentum along d."""
    t = types(precision)
    real, vec3, vec4 = t.real, t.vec3, t.vec4
    contrast = build_contrast(precision)
    v1, v2, v3, v4 = (float(v) for v in BT)
    p1, p2, p3, p4 = (float(v) for v in STAGE_MOMENTUM[1])
    r1, r2, r3, r4 = (float(v) for v in STAGE_MOMENTUM[2])

    @wp.func
    def lag(ambient: real, d: vec3, momentum: vec3, potential: real):
        """|T|^2 - (T . d)^2 over the sum of both: of second order on a nearly straight ray."""
        ahead = wp.dot(momentum, d)
        across = momentum - ahead * d
        return wp.dot(across, across) / (real(2.0) * ambient + contrast(ambient, potential) + ahead)

    @wp.func
    def lag_sum(ambient: real, d: vec3, momentum: vec3, h: real, pot: real, force: vec3, s2: vec4, s3: vec4, s4: vec4):
        force2 = vec3(s2[1], s2[2], s2[3])
        force3 = vec3(s3[1], s3[2], s3[3])
        force4 = vec3(s4[1], s4[2], s4[3])
        swung2 = momentum + h * (real(p1) * force + real(p2) * force2 + real(p3) * force3 + real(p4) * force4)
        swung3 = momentum + h * (real(r1) * force + real(r2) * force2 + real(r3) * force3 + real(r4) * force4)
        swung4 = momentum + h * (real(v1) * force + real(v2) * force2 + real(v3) * force3 + real(v4) * force4)
        total = real(v1) * lag(ambient, d, momentum, pot) + real(v2) * lag(ambient, d, swung2, s2[0])
        return h * (total + real(v3) * lag(ambient, d, swung3, s3[0]) + real(v4) * lag(ambient, d, swung4, s4[0]))

    return lag, lag_sum


@functools.cache
def build_cells(precision: str, kind: str):
    """Functions (bounds, point) -> (cell, frac), and (cell, frac) -> the same with frac in [0, 1)."""
    t = types(precision)
    real, vec3, Bounds = t.real, t.vec3, t.Bounds
    shift = wp.vec3i(*(int(axis in SHIFTED[kind]) for axis in range(3)))

    @wp.func
    def whole(place: Any):
        """Whole cells in a place, zero along axes without cells of their own."""
        floors = wp.vec3i(int(wp.floor(place[0])), int(wp.floor(place[1])), int(wp.floor(place[2])))
        return wp.cw_mul(floors, shift)

    @wp.func
    def in_cells(bounds: Bounds, p: wp.vec3d):
        """Split a point into whole cells and fractions, in float64."""
        g = wp.cw_div(p - bounds.origin, bounds.spacing)
        cell = whole(g)
        rest = g - wp.vec3d(wp.float64(cell[0]), wp.float64(cell[1]), wp.float64(cell[2]))
        return cell, vec3(real(rest[0]), real(rest[1]), real(rest[2]))

    @wp.func
    def carry_over(cell: wp.vec3i, frac: vec3):
        """Move whole cells from the fraction into the cell, exactly."""
        moved = whole(frac)
        return cell + moved, frac - vec3(real(moved[0]), real(moved[1]), real(moved[2]))

    return in_cells, carry_over


@functools.cache
def build_landing(precision: str, geometry: str, stop: str):
    """Functions about the surfaces a ray can end on: one turned toward the ray, its unit, landing on the first."""
    t = types(precision)
    real, vec3, Control = t.real, t.vec3, t.Control
    surface = build_surface(precision, geometry)
    face_count = wp.constant(FACE_COUNT[geometry])
    surface_count = wp.constant(FACE_COUNT[geometry] + (1 if stop == "plane" else 0))
    # A ray that runs in a face is not thrown out by rounding: it is behind a surface when it is so by this many cells.
    slack_cells = 1e-9 if precision == "float32" else 1e-10
    none = 1e30

    @wp.func
    def oriented(control: Control, k: int, side: real, cell: wp.vec3i, frac: vec3):
        s = surface(control, k, cell, frac)
        if k == face_count:
            s = side * s
        return s

    @wp.func
    def surface_unit(control: Control, k: int):
        """Size of a cell in the unit of surface k: faces are measured in cells, the plane in metres."""
        if k == face_count:
            return real(1.0) / wp.max(control.cell_rate)
        return real(1.0)

    @wp.func
    def rising_root(v0: real, v1: real, v2: real):
        """The first positive h at which v0 + v1 h + v2 h^2 rises through zero; 0 if it is above and stays there."""
        disc = v1 * v1 - real(4.0) * v2 * v0
        if v0 > real(0.0):
            if v1 >= real(0.0) or disc < real(0.0):
                return real(0.0)
        elif disc < real(0.0):
            return real(none)
        root = wp.sqrt(disc)
        if v1 >= real(0.0):
            if v1 + root <= real(0.0):
                return real(none)
            return real(-2.0) * v0 / (v1 + root)
        if v2 <= real(0.0):
            return real(none)
        return (root - v1) / (real(2.0) * v2)

    @wp.func
    def landing(
        control: Control, rate: vec3, side: real, cell: wp.vec3i, frac: vec3, momentum: vec3, force: vec3, h: real
    ):
        """The step that ends where the parabola first meets a surface, no longer than h, and that surface or -1."""
        best = h
        which = int(-1)
        along = wp.cw_mul(momentum, rate)
        bend = wp.cw_mul(force, rate)
        for k in range(surface_count):
            s = oriented(control, k, side, cell, frac)
            normal = vec3(s[1], s[2], s[3])
            curve = wp.dot(normal, bend)
            if wp.static(geometry == "axisymmetric"):
                if k == 2:
                    curve += (along[0] * along[0] + along[1] * along[1]) / control.radius
            rise = wp.dot(normal, along)
            slack = real(slack_cells) * surface_unit(control, k)
            outside = s[0]
            grazing = real(1.0e-4) * wp.length(along) * surface_unit(control, k)
            if rise >= real(0.0) and rise <= grazing and outside >= -slack:
                outside -= slack
            root = rising_root(outside, rise, real(0.5) * curve)
            if root <= best:
                best = root
                which = k
        return best, which

    return oriented, surface_unit, landing


def build_look(precision: str, sample, straight: bool):
    """A function that looks the field up at a stage of a step."""
    t = types(precision)
    real, vec3, Field = t.real, t.vec3, t.Field

    @wp.func
    def look(
        field: Field, cell: wp.vec3i, frac: vec3, rate: vec3, h: real, total: vec3, momentum: vec3, q: vec3, kick: vec3
    ):
        """The field at a stage; on a straight line the contrast beside it is first order in the deviation."""
        if wp.static(straight):
            s = sample(field, cell, frac + h * wp.cw_mul(total, rate))
            s[0] += wp.dot(vec3(s[1], s[2], s[3]), q + h * momentum + kick)
            return s
        else:
            return sample(field, cell, frac + wp.cw_mul(h * total + kick, rate))

    return look
