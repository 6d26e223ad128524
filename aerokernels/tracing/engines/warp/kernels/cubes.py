"""Device functions: a volume's potential by the polynomials of cubes of cells, see tracing/cube_polynomials.py."""

import warp as wp

from ....scheme import CUBE_ROW, CUBE_SIDE
from ..library import KernelLibrary, built_once

# Sixteen bytes at once: a GPU that loads their numbers one by one is slower by them than by the spline.
FOUR_NUMBERS = """
#if defined(__CUDA_ARCH__)
    const float4 four = __ldg(reinterpret_cast<const float4 *>(numbers.data + at));
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    const wp::float32 *four = numbers.data + at;
    return wp::vec_t<4, wp::float32>(four[0], four[1], four[2], four[3]);
#endif
"""


@wp.func_native(FOUR_NUMBERS)
def four_numbers(numbers: wp.array(dtype=wp.float32), at: int) -> wp.types.vector(4, wp.float32):
    """Four neighbouring numbers of an array, from a multiple of four on."""
    ...


@built_once
def build_cube_sample(library: KernelLibrary):
    """A function (field, place in cells) -> potential and its gradient [1/m], bounds of what they are off the spline.

    In single precision. The field's coefficients are the table of the polynomials.
    """
    t = library.types
    vec3, vec4, Field = t.vec3, t.vec4, t.Field
    number, per_cell = wp.float32, 2.0 / CUBE_SIDE
    row, side = wp.constant(CUBE_ROW), wp.constant(CUBE_SIDE)

    @wp.func
    def cube_of(place: number, last_cell: int):
        """Which cube of an axis a place is in, and where in it: from -1 to 1."""
        last = last_cell // side
        cubes = place / number(side)
        cube = int(wp.clamp(cubes, number(0.0), number(last) + number(0.5)))
        return cube, number(2.0) * (cubes - number(cube)) - number(1.0)

    @wp.func
    def lower_number(both: number):
        """Numbers of the third degree are the upper halves of floats, two to a number."""
        return wp.cast(wp.cast(both, wp.uint32) << wp.uint32(16), number)

    @wp.func
    def upper_number(both: number):
        return wp.cast((wp.cast(both, wp.uint32) >> wp.uint32(16)) << wp.uint32(16), number)

    @wp.func
    def cube_sample(field: Field, place: vec3):
        i, u = cube_of(place[0], field.row[0])
        j, v = cube_of(place[1], field.row[1])
        k, w = cube_of(place[2], field.row[2])
        at = row * ((i * (field.row[1] // side + 1) + j) * (field.row[2] // side + 1) + k)
        r0 = four_numbers(field.coefficients, at)
        r1 = four_numbers(field.coefficients, at + 4)
        r2 = four_numbers(field.coefficients, at + 8)
        r3 = four_numbers(field.coefficients, at + 12)
        two, three = number(2.0), number(3.0)
        q1, q2, q4, q5, q7 = r0[1], r0[2], r1[0], r1[1], r1[3]
        p0, p1, p2, p3, p4, p5 = r2[2], r2[3], r3[0], r3[1], r3[2], r3[3]
        t0, t1, t2, t3, t4 = lower_number(p0), upper_number(p0), lower_number(p1), upper_number(p1), lower_number(p2)
        t5, t6, t7, t8, t9 = upper_number(p2), lower_number(p3), upper_number(p3), lower_number(p4), upper_number(p4)
        a1 = (t1 * u + q4) * u + r0[3]
        a2 = t2 * u + q5
        a = ((t3 * v + a2) * v + a1) * v + ((t0 * u + q2) * u + q1) * u + r0[0]
        a_u = (t2 * v + two * t1 * u + q4) * v + (three * t0 * u + two * q2) * u + q1
        a_v = (three * t3 * v + two * a2) * v + a1
        b1 = t5 * u + r2[0]
        b = (t6 * v + b1) * v + (t4 * u + q7) * u + r1[2]
        b_u = t5 * v + two * t4 * u + q7
        b_v = two * t6 * v + b1
        d = t8 * v + t7 * u + r2[1]
        rate = number(per_cell) * field.inverse_spacing
        potential = vec4(
            ((t9 * w + d) * w + b) * w + a,
            rate[0] * ((t7 * w + b_u) * w + a_u),
            rate[1] * ((t8 * w + b_v) * w + a_v),
            rate[2] * ((three * t9 * w + two * d) * w + b),
        )
        return potential, lower_number(p5), upper_number(p5)

    return cube_sample
