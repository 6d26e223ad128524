"""Device functions: a volume's potential by the polynomials of cubes of cells, see tracing/cube_polynomials.py."""

import warp as wp

from ....scheme import CUBE_ROW, CUBE_SIDE
from ..library import KernelLibrary, built_once


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
        c = field.coefficients
        two, three = number(2.0), number(3.0)
        q1, q2, q4, q5, q7 = c[at + 1], c[at + 2], c[at + 4], c[at + 5], c[at + 7]
        p0, p1, p2, p3, p4, p5 = c[at + 10], c[at + 11], c[at + 12], c[at + 13], c[at + 14], c[at + 15]
        t0, t1, t2, t3, t4 = lower_number(p0), upper_number(p0), lower_number(p1), upper_number(p1), lower_number(p2)
        t5, t6, t7, t8, t9 = upper_number(p2), lower_number(p3), upper_number(p3), lower_number(p4), upper_number(p4)
        a1 = (t1 * u + q4) * u + c[at + 3]
        a2 = t2 * u + q5
        a = ((t3 * v + a2) * v + a1) * v + ((t0 * u + q2) * u + q1) * u + c[at]
        a_u = (t2 * v + two * t1 * u + q4) * v + (three * t0 * u + two * q2) * u + q1
        a_v = (three * t3 * v + two * a2) * v + a1
        b1 = t5 * u + c[at + 8]
        b = (t6 * v + b1) * v + (t4 * u + q7) * u + c[at + 6]
        b_u = t5 * v + two * t4 * u + q7
        b_v = two * t6 * v + b1
        d = t8 * v + t7 * u + c[at + 9]
        rate = number(per_cell) * field.inverse_spacing
        potential = vec4(
            ((t9 * w + d) * w + b) * w + a,
            rate[0] * ((t7 * w + b_u) * w + a_u),
            rate[1] * ((t8 * w + b_v) * w + a_v),
            rate[2] * ((three * t9 * w + two * d) * w + b),
        )
        return potential, lower_number(p5), upper_number(p5)

    return cube_sample
