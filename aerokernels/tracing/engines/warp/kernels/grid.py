"""Device functions: the optical potential on a uniform grid. The interpolants are those of medium/spline.py."""

import warp as wp

from .....medium.grid import AXIS_CORE
from .....medium.spline import STRIDE, SUPPORT
from ..library import KernelLibrary, built_once
from .native_lookup import build_entry, build_volume_lookup, on_processor


@built_once
def build_weights(library: KernelLibrary, interpolation: str):
    """Build functions u -> weights of the coefficients at fraction u of a cell, and u -> slopes of these weights.

    Both return vectors of four numbers, of which linear interpolation uses two.
    """
    t = library.types
    real, vec4 = t.real, t.vec4
    one_sixth = 1.0 / 6.0  # a quotient written inside a kernel would be computed in float32

    if interpolation == "linear":

        @wp.func
        def value_weights(u: real):
            return vec4(real(1.0) - u, u, real(0.0), real(0.0))

        @wp.func
        def slope_weights(u: real):
            return vec4(real(-1.0), real(1.0), real(0.0), real(0.0))

    elif interpolation == "cubic":

        @wp.func
        def value_weights(u: real):
            v = real(1.0) - u
            sixth = real(one_sixth)
            return vec4(
                sixth * v * v * v,
                sixth * (real(4.0) + u * u * (real(3.0) * u - real(6.0))),
                sixth * (real(4.0) + v * v * (real(3.0) * v - real(6.0))),
                sixth * u * u * u,
            )

        @wp.func
        def slope_weights(u: real):
            v = real(1.0) - u
            return vec4(
                real(-0.5) * v * v,
                u * (real(1.5) * u - real(2.0)),
                -v * (real(1.5) * v - real(2.0)),
                real(0.5) * u * u,
            )

    else:

        @wp.func
        def value_weights(u: real):
            v = real(1.0) - u
            return vec4((real(1.0) + real(2.0) * u) * v * v, u * v * v, u * u * (real(3.0) - real(2.0) * u), -u * u * v)

        @wp.func
        def slope_weights(u: real):
            v = real(1.0) - u
            return vec4(
                real(-6.0) * u * v, v * (real(1.0) - real(3.0) * u), real(6.0) * u * v, u * (real(3.0) * u - real(2.0))
            )

    return value_weights, slope_weights


@built_once
def build_sample(library: KernelLibrary, geometry: str, interpolation: str):
    """Build a function (field, cell, frac, current_cell) -> potential s = (n^2 - a^2) / 2 and its gradient [1/m]."""
    t = library.types
    real, vec3, vec4, Field = t.real, t.vec3, t.vec4, t.Field
    value_weights, slope_weights = build_weights(library, interpolation)
    support, stride = SUPPORT[interpolation], STRIDE[interpolation]
    entry, volume_lookup = build_entry(library), build_volume_lookup(library)

    @wp.func
    def split(place: real, base: int, last: int):
        """Clamped cell along one axis, and the fraction in it, which may leave [0, 1] at the box's edge."""
        shift = int(wp.floor(place))
        cell = wp.clamp(base + shift, 0, last)
        return cell, place - real(cell - base)

    @wp.func
    def plane_sample(field: Field, a: int, u: real, b: int, v: real):
        """Value and slopes per cell at fraction (u, v) of cell (a, b) of a two-axis grid."""
        wa = value_weights(u)
        sa = slope_weights(u)
        wb = value_weights(v)
        sb = slope_weights(v)
        start = (a * field.pitch[0] + b) * stride
        total = real(0.0)
        first = real(0.0)
        second = real(0.0)
        for i in range(support):
            row = real(0.0)
            bend = real(0.0)
            for j in range(support):
                c = entry(field.coefficients, start + i * field.pitch[0] + j)
                row += wb[j] * c
                bend += sb[j] * c
            total += wa[i] * row
            first += sa[i] * row
            second += wa[i] * bend
        return vec3(total, first, second)

    @wp.func
    def row_at(coefficients: wp.array(dtype=real), place: int):
        """The coefficients of a cell in a row along the last axis."""
        one, two = entry(coefficients, place), entry(coefficients, place + 1)
        if wp.static(support == 2):
            return vec4(one, two, real(0.0), real(0.0))
        return vec4(one, two, entry(coefficients, place + 2), entry(coefficients, place + 3))

    if geometry == "volume":

        @wp.func
        def volume_sample(field: Field, a: int, u: real, b: int, v: real, c: int, w: real):
            """Value and slopes per cell at fraction (u, v, w) of cell (a, b, c)."""
            wa = value_weights(u)
            sa = slope_weights(u)
            wb = value_weights(v)
            sb = slope_weights(v)
            wc = value_weights(w)
            sc = slope_weights(w)
            start = (a * field.pitch[0] + b * field.pitch[1] + c) * stride
            if wp.static(support == 4):
                if on_processor():
                    return volume_lookup(field.coefficients, start, field.pitch, wa, sa, wb, sb, wc, sc)
            # Rows along the last axis are vectors, to whose numbers the weights along it come last.
            total, first, second = vec4(), vec4(), vec4()
            for i in range(support):
                sheet, bend = vec4(), vec4()
                for j in range(support):
                    row = row_at(field.coefficients, start + i * field.pitch[0] + j * field.pitch[1])
                    sheet += wb[j] * row
                    bend += sb[j] * row
                total += wa[i] * sheet
                first += sa[i] * sheet
                second += wa[i] * bend
            return vec4(wp.dot(wc, total), wp.dot(wc, first), wp.dot(wc, second), wp.dot(sc, total))

        @wp.func
        def sample(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
            a, u = split(frac[0], cell[0], field.row[0])
            b, v = split(frac[1], cell[1], field.row[1])
            c, w = split(frac[2], cell[2], field.row[2])
            s = volume_sample(field, a, u, b, v, c, w)
            rate = field.inverse_spacing
            return vec4(s[0], s[1] * rate[0], s[2] * rate[1], s[3] * rate[2])

    elif geometry == "planar":

        @wp.func
        def sample(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
            a, u = split(frac[1], cell[1], field.row[0])
            b, v = split(frac[2], cell[2], field.row[1])
            s = plane_sample(field, a, u, b, v)
            return vec4(s[0], real(0.0), s[1] * field.inverse_spacing[1], s[2] * field.inverse_spacing[2])

    else:

        @wp.func
        def sample(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
            radius = wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1])
            a, u = split(radius, 0, field.row[0])
            b, v = split(frac[2], cell[2], field.row[1])
            s = plane_sample(field, a, u, b, v)
            outward = real(0.0)
            if wp.static(interpolation == "linear"):
                outward = s[1] * field.inverse_spacing[0] / wp.max(radius, real(AXIS_CORE))
            elif radius > real(0.0):
                outward = s[1] * field.inverse_spacing[0] / radius
            return vec4(s[0], outward * frac[0], outward * frac[1], s[2] * field.inverse_spacing[2])

    return sample


@built_once
def build_paper_step(library: KernelLibrary, geometry: str):
    """Build a function (field, cell, frac, current_cell) -> step length of eq 5 in the cell of the point [m]."""
    t = library.types
    vec3, Field = t.vec3, t.Field

    if geometry == "volume":

        @wp.func
        def paper_step(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
            a = wp.clamp(cell[0] + int(wp.floor(frac[0])), 0, field.row[0])
            b = wp.clamp(cell[1] + int(wp.floor(frac[1])), 0, field.row[1])
            c = wp.clamp(cell[2] + int(wp.floor(frac[2])), 0, field.row[2])
            return field.paper_step[(a * (field.row[1] + 1) + b) * (field.row[2] + 1) + c]

    elif geometry == "planar":

        @wp.func
        def paper_step(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
            a = wp.clamp(cell[1] + int(wp.floor(frac[1])), 0, field.row[0])
            b = wp.clamp(cell[2] + int(wp.floor(frac[2])), 0, field.row[1])
            return field.paper_step[a * (field.row[1] + 1) + b]

    else:

        @wp.func
        def paper_step(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
            radius = wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1])
            a = wp.clamp(int(wp.floor(radius)), 0, field.row[0])
            b = wp.clamp(cell[2] + int(wp.floor(frac[2])), 0, field.row[1])
            return field.paper_step[a * (field.row[1] + 1) + b]

    return paper_step


@built_once
def build_find_current_cell(library: KernelLibrary, geometry: str):
    """Build a function (field, frac, current_cell) -> current_cell: only a mesh needs the cell of the last lookup."""
    t = library.types
    vec3, Field = t.vec3, t.Field

    @wp.func
    def find_current_cell(field: Field, frac: vec3, current_cell: int):
        return current_cell

    return find_current_cell
