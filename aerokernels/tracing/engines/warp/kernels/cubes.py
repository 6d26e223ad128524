"""Device functions: a volume's potential from polynomials of cubes of cells (tracing/leapfrog/cube_polynomials.py)."""

import warp as wp

from ....scheme import CUBE_ROW, CUBE_SIDE
from ..library import Scene, built_once

# A GPU fetches every cache line that a load of a warp touches. If each of 32 threads loaded its own row, in four loads,
# that would be 128 lines. So four neighbouring threads load one row after the other together, sixteen bytes each, which
# touches 32; each thread then reads its own row from the desk of its warp in shared memory. Only whole warps do so, in
# blocks of Warp's default size. A row of the desk takes five float4, the last unused, to avoid bank conflicts.
ROW_OF_CUBE = """
    wp::vec_t<16, wp::float32> row;
#if defined(__CUDA_ARCH__)
    __shared__ float4 desks[256 * 5];
    float4 fours[4];
    if (__activemask() == 0xffffffffu && blockDim.x <= 256) {
        const int thread = threadIdx.x & 31, quarter = thread & 3, first = thread & ~3;
        float4 *desk = desks + (threadIdx.x & ~31) * 5;
#pragma unroll
        for (int k = 0; k < 4; k++) {
            const int start = __shfl_sync(0xffffffffu, at, first + k);
            fours[k] = __ldg(reinterpret_cast<const float4 *>(numbers.data + start) + quarter);
        }
        __syncwarp();  // every thread has read the rows of the previous call
#pragma unroll
        for (int k = 0; k < 4; k++) {
            desk[5 * (first + k) + quarter] = fours[k];
        }
        __syncwarp();
#pragma unroll
        for (int k = 0; k < 4; k++) {
            fours[k] = desk[5 * thread + k];
        }
    } else {
#pragma unroll
        for (int k = 0; k < 4; k++) {
            fours[k] = __ldg(reinterpret_cast<const float4 *>(numbers.data + at) + k);
        }
    }
#pragma unroll
    for (int k = 0; k < 4; k++) {
        row[4 * k] = fours[k].x;
        row[4 * k + 1] = fours[k].y;
        row[4 * k + 2] = fours[k].z;
        row[4 * k + 3] = fours[k].w;
    }
#else
    for (int k = 0; k < 16; k++) {
        row[k] = numbers.data[at + k];
    }
#endif
    return row;
"""


@wp.func_native(ROW_OF_CUBE)
def row_of_cube(numbers: wp.array(dtype=wp.float32), at: int) -> wp.types.vector(CUBE_ROW, wp.float32):
    """The CUBE_ROW numbers of a cube's polynomial, which begin at entry `at` of the table."""
    ...


@built_once()
def build_cube_sample(scene: Scene):
    """Build the function of a cube's potential."""
    t = scene.types
    vec3, vec4, Field = t.vec3, t.vec4, t.Field
    number, per_cell = wp.float32, 2.0 / CUBE_SIDE
    row, side = wp.constant(CUBE_ROW), wp.constant(CUBE_SIDE)

    @wp.func
    def cube_of(place: number, last_cell: int):
        """Number of the cube that contains a place along an axis, and the place in the cube, from -1 to 1."""
        last = last_cell // side
        cubes = place / number(side)
        cube = int(wp.clamp(cubes, number(0.0), number(last) + number(0.5)))
        return cube, number(2.0) * (cubes - number(cube)) - number(1.0)

    @wp.func
    def lower_number(both: number):
        """Coefficients of the third degree are the upper halves of floats, two packed in one number."""
        return wp.cast(wp.cast(both, wp.uint32) << wp.uint32(16), number)

    @wp.func
    def upper_number(both: number):
        return wp.cast((wp.cast(both, wp.uint32) >> wp.uint32(16)) << wp.uint32(16), number)

    @wp.func
    def cube_sample(field: Field, place: vec3):
        """Potential and its gradient [1/m], and bounds of their errors.

        The errors are relative to the spline. All in single precision; the field's coefficients are the polynomial
        table.
        """
        i, u = cube_of(place[0], field.row[0])
        j, v = cube_of(place[1], field.row[1])
        k, w = cube_of(place[2], field.row[2])
        at = row * ((i * (field.row[1] // side + 1) + j) * (field.row[2] // side + 1) + k)
        r = row_of_cube(field.coefficients, at)
        two, three = number(2.0), number(3.0)
        q1, q2, q4, q5, q7 = r[1], r[2], r[4], r[5], r[7]
        p0, p1, p2, p3, p4, p5 = r[10], r[11], r[12], r[13], r[14], r[15]
        t0, t1, t2, t3, t4 = lower_number(p0), upper_number(p0), lower_number(p1), upper_number(p1), lower_number(p2)
        t5, t6, t7, t8, t9 = upper_number(p2), lower_number(p3), upper_number(p3), lower_number(p4), upper_number(p4)
        a1 = (t1 * u + q4) * u + r[3]
        a2 = t2 * u + q5
        a = ((t3 * v + a2) * v + a1) * v + ((t0 * u + q2) * u + q1) * u + r[0]
        a_u = (t2 * v + two * t1 * u + q4) * v + (three * t0 * u + two * q2) * u + q1
        a_v = (three * t3 * v + two * a2) * v + a1
        b1 = t5 * u + r[8]
        b = (t6 * v + b1) * v + (t4 * u + q7) * u + r[6]
        b_u = t5 * v + two * t4 * u + q7
        b_v = two * t6 * v + b1
        d = t8 * v + t7 * u + r[9]
        rate = number(per_cell) * field.inverse_spacing
        potential = vec4(
            ((t9 * w + d) * w + b) * w + a,
            rate[0] * ((t7 * w + b_u) * w + a_u),
            rate[1] * ((t8 * w + b_v) * w + a_v),
            rate[2] * ((three * t9 * w + two * d) * w + b),
        )
        return potential, lower_number(p5), upper_number(p5)

    return cube_sample
