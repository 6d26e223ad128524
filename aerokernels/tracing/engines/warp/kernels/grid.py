"""Device functions: the optical potential on a uniform grid. The interpolants are those of medium/spline.py."""

from types import SimpleNamespace

import warp as wp

from .....medium.grid import AXIS_CORE
from .....medium.spline import STRIDE, SUPPORT
from ..library import Scene, built_once

# On a CPU a row of coefficients is a vector. All sums are in the order of `volume_sample`: to the bit the same results.
VOLUME_LOOKUP = """
#if defined(__CUDA_ARCH__)
    return wp::vec_t<4, REAL>();
#else
    typedef REAL four __attribute__((vector_size(4 * sizeof(REAL))));
    typedef REAL row_in_memory __attribute__((vector_size(4 * sizeof(REAL)), aligned(sizeof(REAL))));
    four total = {}, first = {}, second = {};
    for (int i = 0; i < 4; i++) {
        four sheet = {}, bend = {};
        for (int j = 0; j < 4; j++) {
            const four row = *(const row_in_memory *)(coefficients.data + start + i * pitch[0] + j * pitch[1]);
            sheet = sheet + wb[j] * row;
            bend = bend + sb[j] * row;
        }
        total = total + wa[i] * sheet;
        first = first + sa[i] * sheet;
        second = second + wa[i] * bend;
    }
    auto sum = [](wp::vec_t<4, REAL> w, four v) { return w[0] * v[0] + w[1] * v[1] + w[2] * v[2] + w[3] * v[3]; };
    return wp::vec_t<4, REAL>(sum(wc, total), sum(wc, first), sum(wc, second), sum(sc, total));
#endif
"""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return false;
#else
    return true;
#endif
""")
def on_processor() -> bool:
    """Whether the kernel is compiled for a CPU; the compiler drops the branch not taken."""
    ...


@built_once("geometry", "interpolation")
def build_grid(scene: Scene):
    """Build the functions of a grid's interpolant."""
    geometry, interpolation = scene.geometry, scene.interpolation
    t = scene.types
    real, vec4, vec3, Field = t.real, t.vec4, t.vec3, t.Field
    one_sixth = 1.0 / 6.0  # a quotient written inside a kernel would be computed in float32
    support, stride = SUPPORT[interpolation], STRIDE[interpolation]
    last_axis = 2 if geometry == "volume" else 1

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

    @wp.func_native("return numbers.data[place];")
    def entry(numbers: wp.array(dtype=real), place: int) -> real:
        """The number at that place of a contiguous array."""
        ...

    @wp.func_native(VOLUME_LOOKUP.replace("REAL", f"wp::{scene.precision}"))
    def volume_lookup(
        coefficients: wp.array(dtype=real),
        start: int,
        pitch: wp.vec3i,
        wa: vec4,
        sa: vec4,
        wb: vec4,
        sb: vec4,
        wc: vec4,
        sc: vec4,
    ) -> vec4:
        """Value and slopes per cell of a volume, for CPUs only; see VOLUME_LOOKUP.

        Its arguments: the coefficients, the entry at which the cell's coefficients begin, the distance of its rows
        along the first two axes, and the four weights and their slopes along each axis.
        """
        ...

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
            """Potential s = (n^2 - a^2) / 2 and its gradient [1/m]."""
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

    @wp.func
    def paper_step(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
        """Step length of eq 5 in the cell of the point [m]."""
        c = wp.clamp(cell[2] + int(wp.floor(frac[2])), 0, field.row[last_axis])
        if wp.static(geometry == "volume"):
            a = wp.clamp(cell[0] + int(wp.floor(frac[0])), 0, field.row[0])
            b = wp.clamp(cell[1] + int(wp.floor(frac[1])), 0, field.row[1])
            return field.paper_step[(a * (field.row[1] + 1) + b) * (field.row[2] + 1) + c]
        elif wp.static(geometry == "planar"):
            b = wp.clamp(cell[1] + int(wp.floor(frac[1])), 0, field.row[0])
            return field.paper_step[b * (field.row[1] + 1) + c]
        else:
            radius = wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1])
            b = wp.clamp(int(wp.floor(radius)), 0, field.row[0])
            return field.paper_step[b * (field.row[1] + 1) + c]

    @wp.func
    def find_current_cell(field: Field, frac: vec3, current_cell: int):
        """The cell itself: only a mesh needs the cell of the last lookup."""
        return current_cell

    return SimpleNamespace(**locals())
