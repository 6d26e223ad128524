"""Device functions: the optical potential on a uniform grid. The interpolants are those of medium/spline.py."""

import functools

import warp as wp

from ..medium.spline import STRIDE, SUPPORT
from .warp_types import types


# Cell faces that a ray has passed but for rounding, or is about to pass in so little, in cells: not worth a step.
HAIR = 1e-4


@functools.cache
def build_weights(precision: str, interpolation: str):
    """Functions u -> weights and u -> slopes of the weights, as vectors of four (two used if linear)."""
    t = types(precision)
    real, vec4 = t.real, t.vec4
    one_sixth = 1.0 / 6.0  # a quotient written inside a kernel would be taken in float32

    if interpolation == "linear":

        @wp.func
        def value(u: real):
            return vec4(real(1.0) - u, u, real(0.0), real(0.0))

        @wp.func
        def slope(u: real):
            return vec4(real(-1.0), real(1.0), real(0.0), real(0.0))

    elif interpolation == "cubic":

        @wp.func
        def value(u: real):
            v = real(1.0) - u
            sixth = real(one_sixth)
            return vec4(
                sixth * v * v * v,
                sixth * (real(4.0) + u * u * (real(3.0) * u - real(6.0))),
                sixth * (real(4.0) + v * v * (real(3.0) * v - real(6.0))),
                sixth * u * u * u,
            )

        @wp.func
        def slope(u: real):
            v = real(1.0) - u
            return vec4(
                real(-0.5) * v * v,
                u * (real(1.5) * u - real(2.0)),
                -v * (real(1.5) * v - real(2.0)),
                real(0.5) * u * u,
            )

    else:

        @wp.func
        def value(u: real):
            v = real(1.0) - u
            return vec4((real(1.0) + real(2.0) * u) * v * v, u * v * v, u * u * (real(3.0) - real(2.0) * u), -u * u * v)

        @wp.func
        def slope(u: real):
            v = real(1.0) - u
            return vec4(
                real(-6.0) * u * v, v * (real(1.0) - real(3.0) * u), real(6.0) * u * v, u * (real(3.0) * u - real(2.0))
            )

    return value, slope


@functools.cache
def build_sample(precision: str, geometry: str, interpolation: str):
    """A function (field, cell, frac) -> (potential s = (n^2 - a^2) / 2, its gradient in x, y, z [1/m])."""
    t = types(precision)
    real, vec3, vec4, Field = t.real, t.vec3, t.vec4, t.Field
    value, slope = build_weights(precision, interpolation)
    support, stride = SUPPORT[interpolation], STRIDE[interpolation]

    @wp.func
    def split(place: real, base: int, last: int):
        """Clamped cell along one axis and the fraction in it, which may leave [0, 1] at the box's edge."""
        shift = int(wp.floor(place))
        cell = wp.clamp(base + shift, 0, last)
        return cell, place - real(cell - base)

    @wp.func
    def plane_sample(field: Field, a: int, u: real, b: int, v: real):
        """Value and slopes per cell at fraction (u, v) of cell (a, b) of a two-axis grid."""
        wa = value(u)
        sa = slope(u)
        wb = value(v)
        sb = slope(v)
        start = (a * field.pitch[0] + b) * stride
        total = real(0.0)
        first = real(0.0)
        second = real(0.0)
        for i in range(support):
            row = real(0.0)
            bend = real(0.0)
            for j in range(support):
                c = field.coefficients[start + i * field.pitch[0] + j]
                row += wb[j] * c
                bend += sb[j] * c
            total += wa[i] * row
            first += sa[i] * row
            second += wa[i] * bend
        return vec3(total, first, second)

    if geometry == "volume":

        @wp.func
        def sample(field: Field, cell: wp.vec3i, frac: vec3):
            a, u = split(frac[0], cell[0], field.row[0])
            b, v = split(frac[1], cell[1], field.row[1])
            c, w = split(frac[2], cell[2], field.row[2])
            wa = value(u)
            sa = slope(u)
            wb = value(v)
            sb = slope(v)
            wc = value(w)
            sc = slope(w)
            start = (a * field.pitch[0] + b * field.pitch[1] + c) * stride
            total = real(0.0)
            first = real(0.0)
            second = real(0.0)
            third = real(0.0)
            for i in range(support):
                sheet = real(0.0)
                sheet_second = real(0.0)
                sheet_third = real(0.0)
                for j in range(support):
                    at = start + i * field.pitch[0] + j * field.pitch[1]
                    row = real(0.0)
                    bend = real(0.0)
                    for k in range(support):
                        picked = field.coefficients[at + k]
                        row += wc[k] * picked
                        bend += sc[k] * picked
                    sheet += wb[j] * row
                    sheet_second += sb[j] * row
                    sheet_third += wb[j] * bend
                total += wa[i] * sheet
                first += sa[i] * sheet
                second += wa[i] * sheet_second
                third += wa[i] * sheet_third
            rate = field.inverse_spacing
            return vec4(total, first * rate[0], second * rate[1], third * rate[2])

    elif geometry == "planar":

        @wp.func
        def sample(field: Field, cell: wp.vec3i, frac: vec3):
            a, u = split(frac[1], cell[1], field.row[0])
            b, v = split(frac[2], cell[2], field.row[1])
            s = plane_sample(field, a, u, b, v)
            return vec4(s[0], real(0.0), s[1] * field.inverse_spacing[1], s[2] * field.inverse_spacing[2])

    else:

        @wp.func
        def sample(field: Field, cell: wp.vec3i, frac: vec3):
            radius = wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1])
            a, u = split(radius, 0, field.row[0])
            b, v = split(frac[2], cell[2], field.row[1])
            s = plane_sample(field, a, u, b, v)
            outward = real(0.0)
            if radius > real(0.0):
                outward = s[1] * field.inverse_spacing[0] / radius
            return vec4(s[0], outward * frac[0], outward * frac[1], s[2] * field.inverse_spacing[2])

    return sample


@functools.cache
def build_reach(precision: str, geometry: str):
    """A function (control, cell, frac, total) -> safe step where the point lies [sigma]; none is known on a mesh."""
    t = types(precision)
    real, vec3, Control = t.real, t.vec3, t.Control

    @wp.func
    def block(control: Control, axis: int, cell: int, place: real):
        return wp.clamp((cell + int(wp.floor(place))) // control.block, 0, control.block_count[axis] - 1)

    if geometry == "volume":

        @wp.func
        def entry(control: Control, cell: wp.vec3i, frac: vec3):
            row = block(control, 0, cell[0], frac[0]) * control.block_count[1] + block(control, 1, cell[1], frac[1])
            return control.reach[row * control.block_count[2] + block(control, 2, cell[2], frac[2])]

    elif geometry == "planar":

        @wp.func
        def entry(control: Control, cell: wp.vec3i, frac: vec3):
            row = block(control, 0, cell[1], frac[1])
            return control.reach[row * control.block_count[1] + block(control, 1, cell[2], frac[2])]

    else:

        @wp.func
        def entry(control: Control, cell: wp.vec3i, frac: vec3):
            row = block(control, 0, 0, wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1]))
            return control.reach[row * control.block_count[1] + block(control, 1, cell[2], frac[2])]

    @wp.func
    def reach(control: Control, cell: wp.vec3i, frac: vec3, total: vec3):
        if wp.static(geometry == "mesh"):
            return real(0.0)
        else:
            speed = wp.length(total)
            if wp.dot(total, control.aim) < control.aim_cosine * speed:
                return real(0.0)  # turned out of the cone
            return entry(control, cell, frac) / speed

    return reach


@functools.cache
def build_to_face(precision: str, geometry: str):
    """A function (cell, frac, velocity in cells) -> step to the next face of a cell; faces closer than HAIR are behind."""
    t = types(precision)
    real, vec3 = t.real, t.vec3
    axes = {"volume": (0, 1, 2), "planar": (1, 2), "axisymmetric": (2,)}[geometry]
    none = 1e30

    @wp.func
    def flat(place: real, speed: real):
        """Along an axis with faces at whole numbers."""
        inside = place - wp.floor(place)
        if speed > real(0.0):
            gap = real(1.0) - inside
            if gap < real(HAIR):
                gap += real(1.0)
            return gap / speed
        if speed < real(0.0):
            if inside < real(HAIR):
                inside += real(1.0)
            return -inside / speed
        return real(none)

    @wp.func
    def round_face(frac: vec3, velocity: vec3):
        """To the next cylinder of whole radius."""
        a = velocity[0] * velocity[0] + velocity[1] * velocity[1]
        if a == real(0.0):
            return real(none)
        b = frac[0] * velocity[0] + frac[1] * velocity[1]
        square = frac[0] * frac[0] + frac[1] * frac[1]
        radius = wp.sqrt(square)
        inner = wp.floor(radius)
        if radius - inner < real(HAIR):
            inner -= real(1.0)
        if b < real(0.0) and inner > real(0.0):
            disc = b * b - a * (square - inner * inner)
            if disc > real(0.0):
                return (square - inner * inner) / (wp.sqrt(disc) - b)
        outer = wp.floor(radius + real(HAIR)) + real(1.0)
        return (wp.sqrt(wp.max(b * b - a * (square - outer * outer), real(0.0))) - b) / a

    @wp.func
    def to_face(cell: wp.vec3i, frac: vec3, velocity: vec3):
        step = real(none)
        if wp.static(0 in axes):
            step = wp.min(step, flat(frac[0], velocity[0]))
        if wp.static(1 in axes):
            step = wp.min(step, flat(frac[1], velocity[1]))
        if wp.static(2 in axes):
            step = wp.min(step, flat(frac[2], velocity[2]))
        if wp.static(geometry == "axisymmetric"):
            step = wp.min(step, round_face(frac, velocity))
        return step

    return to_face


@functools.cache
def build_paper_step(precision: str, geometry: str):
    """A function (field, cell, frac) -> step length of eq 5 in the cell that holds the point [m]."""
    t = types(precision)
    vec3, Field = t.vec3, t.Field

    if geometry == "volume":

        @wp.func
        def paper_step(field: Field, cell: wp.vec3i, frac: vec3):
            a = wp.clamp(cell[0] + int(wp.floor(frac[0])), 0, field.row[0])
            b = wp.clamp(cell[1] + int(wp.floor(frac[1])), 0, field.row[1])
            c = wp.clamp(cell[2] + int(wp.floor(frac[2])), 0, field.row[2])
            return field.paper_step[(a * (field.row[1] + 1) + b) * (field.row[2] + 1) + c]

    elif geometry == "planar":

        @wp.func
        def paper_step(field: Field, cell: wp.vec3i, frac: vec3):
            a = wp.clamp(cell[1] + int(wp.floor(frac[1])), 0, field.row[0])
            b = wp.clamp(cell[2] + int(wp.floor(frac[2])), 0, field.row[1])
            return field.paper_step[a * (field.row[1] + 1) + b]

    else:

        @wp.func
        def paper_step(field: Field, cell: wp.vec3i, frac: vec3):
            radius = wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1])
            a = wp.clamp(int(wp.floor(radius)), 0, field.row[0])
            b = wp.clamp(cell[2] + int(wp.floor(frac[2])), 0, field.row[1])
            return field.paper_step[a * (field.row[1] + 1) + b]

    return paper_step
