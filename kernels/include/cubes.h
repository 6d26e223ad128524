// A volume's potential from the polynomials of cubes of cells, for each ray of a packet (see
// aerokernels/tracing/tasks/cube_polynomials.py): CUBE_ROW contiguous numbers per cube.
#ifndef CUBES_H
#define CUBES_H

#include "cell.h"
#include "constants.h"
#include "warp_threads.h"

#if CUBES

// Number of the cube that contains a place along an axis, and the place in the cube, from -1 to 1.
static inline ints cube_of(reals place, int last_cell, reals *within)
{
    const real last = (real)(last_cell / CUBE_SIDE) + R(0.5);
    const reals cubes = place * R(1.0 / CUBE_SIDE);
    const ints cube = TO_INTS(CHOOSE((reals)R(0.0), CHOOSE((reals)last, cubes, cubes < last), cubes > R(0.0)));
    *within = R(2.0) * (cubes - TO_REALS(cube)) - R(1.0);
    return cube;
}

// A polynomial and its slopes per cell, from its coefficients up to the second degree, q, and of the third, t.
static inline Local of_polynomial(const reals *q, const reals *t, reals u, reals v, reals w)
{
    const reals a0 = ((t[0] * u + q[2]) * u + q[1]) * u + q[0];
    const reals a1 = (t[1] * u + q[4]) * u + q[3], a2 = t[2] * u + q[5];
    const reals a = ((t[3] * v + a2) * v + a1) * v + a0;
    const reals a_u = (t[2] * v + R(2.0) * t[1] * u + q[4]) * v + (R(3.0) * t[0] * u + R(2.0) * q[2]) * u + q[1];
    const reals a_v = (R(3.0) * t[3] * v + R(2.0) * a2) * v + a1;
    const reals b0 = (t[4] * u + q[7]) * u + q[6], b1 = t[5] * u + q[8];
    const reals b = (t[6] * v + b1) * v + b0;
    const reals b_u = t[5] * v + R(2.0) * t[4] * u + q[7], b_v = R(2.0) * t[6] * v + b1;
    const reals c = t[8] * v + t[7] * u + q[9];
    const real per_cell = R(2.0 / CUBE_SIDE);
    Local out;
    out.value = ((t[9] * w + c) * w + b) * w + a;
    out.first = per_cell * ((t[7] * w + b_u) * w + a_u);
    out.second = per_cell * ((t[8] * w + b_v) * w + a_v);
    out.third = per_cell * ((R(3.0) * t[9] * w + R(2.0) * c) * w + b);
    return out;
}

// Coefficients of the third degree are the upper halves of floats, two packed in one number.
static inline float lower_number(float both) { return as_float(as_uint(both) << 16); }
static inline float upper_number(float both) { return as_float(as_uint(both) & 0xffff0000u); }

// The CUBE_ROW numbers of a cube's polynomial, which begin at entry `start` of the table.
typedef struct {
    float4 r0, r1, r2, r3;
} CubeRow;

static inline CubeRow row_of(__global const real *coefficients, int start)
{
    __global const float4 *row = (__global const float4 *)(coefficients + start);
    const CubeRow found = {row[0], row[1], row[2], row[3]};
    return found;
}

static inline Local in_row(const CubeRow *row, reals u, reals v, reals w)
{
    const float4 r0 = row->r0, r1 = row->r1, r2 = row->r2, r3 = row->r3;
    const reals q[10] = {r0.x, r0.y, r0.z, r0.w, r1.x, r1.y, r1.z, r1.w, r2.x, r2.y};
    const reals t[10] = {
        lower_number(r2.z), upper_number(r2.z), lower_number(r2.w), upper_number(r2.w), lower_number(r3.x),
        upper_number(r3.x), lower_number(r3.y), upper_number(r3.y), lower_number(r3.z), upper_number(r3.z)};
    Local out = of_polynomial(q, t, u, v, w);
    out.off = (reals)lower_number(r3.w);
    out.off_slope = (reals)upper_number(r3.w);
    return out;
}

#if LANES == 1

#if DESKS

// A GPU of NVIDIA fetches every cache line that a load of a warp touches. If each of 32 threads loaded its own row, in
// four loads, that would be 128 lines. So four neighbouring threads load one row after the other together, sixteen
// bytes each, which touches 32; each thread then reads its own row from the desk of its warp in local memory.
static inline CubeRow row_together(__global const real *coefficients, int start, __local float4 *desk)
{
    const int thread = get_local_id(0) % WARP, quarter = thread & 3, first = thread & ~3;
    float4 got[4];
#pragma unroll
    for (int k = 0; k < 4; k++) {
        got[k] = ((__global const float4 *)(coefficients + from_thread(start, first + k)))[quarter];
    }
    meet_in_warp();  // every thread has read the rows of the previous call
#pragma unroll
    for (int k = 0; k < 4; k++) {
        desk[DESK_ROW * (first + k) + quarter] = got[k];
    }
    meet_in_warp();
    __local const float4 *own = desk + DESK_ROW * thread;
    const CubeRow row = {own[0], own[1], own[2], own[3]};
    return row;
}

#endif

static inline Local in_cubes(const Arrays *arrays, ints start, reals u, reals v, reals w)
{
    CubeRow row;
#if DESKS
    if (is_whole_warp()) {
        row = row_together(arrays->coefficients, start, arrays->desk);
        return in_row(&row, u, v, w);
    }
#endif
    row = row_of(arrays->coefficients, start);
    return in_row(&row, u, v, w);
}

#elif LANES == 16

// By clang's builtin, which every OpenCL for CPUs has: for vectors written entry by entry its optimiser emits hundreds
// of instructions.

// The numbers of lane k's cube, a cache line.
#define ROW_OF(k) (*(__global const float16 *)(coefficients + INT_AT(start, k)))
// Interleave the first two entries of each group of four of two vectors, or the last two; take the even or odd groups.
#define FIRST_IN_TURN(p, q) \
    __builtin_shufflevector(p, q, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29)
#define LAST_IN_TURN(p, q) \
    __builtin_shufflevector(p, q, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31)
#define EVEN_FOURS(p, q) \
    __builtin_shufflevector(p, q, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27)
#define ODD_FOURS(p, q) \
    __builtin_shufflevector(p, q, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31)

// If the lanes are in different cubes, each loads its numbers in fours, which are then transposed so that each number
// is a vector over the lanes.
static inline Local in_cubes(const Arrays *arrays, ints start, reals u, reals v, reals w)
{
    __global const real *coefficients = arrays->coefficients;
    if (start.s0 == start.sf && start.s0 == start.s8 && all(start == start.s0)) {
        const CubeRow row = row_of(coefficients, start.s0);
        return in_row(&row, u, v, w);
    }
    reals c[CUBE_ROW];
    // Transpose the rows of four lanes at a time, four numbers of four lanes per vector; then the groups of four lanes.
    float16 by_fours[4][4];
#pragma unroll
    for (int four = 0; four < 4; four++) {
        const float16 p = ROW_OF(4 * four), q = ROW_OF(4 * four + 1), r = ROW_OF(4 * four + 2), s = ROW_OF(4 * four + 3);
        const float16 pr = FIRST_IN_TURN(p, r), qs = FIRST_IN_TURN(q, s);
        const float16 pr_last = LAST_IN_TURN(p, r), qs_last = LAST_IN_TURN(q, s);
        by_fours[four][0] = FIRST_IN_TURN(pr, qs);
        by_fours[four][1] = LAST_IN_TURN(pr, qs);
        by_fours[four][2] = FIRST_IN_TURN(pr_last, qs_last);
        by_fours[four][3] = LAST_IN_TURN(pr_last, qs_last);
    }
#pragma unroll
    for (int k = 0; k < 4; k++) {
        const float16 low = EVEN_FOURS(by_fours[0][k], by_fours[1][k]), high = EVEN_FOURS(by_fours[2][k], by_fours[3][k]);
        const float16 low_odd = ODD_FOURS(by_fours[0][k], by_fours[1][k]), high_odd = ODD_FOURS(by_fours[2][k], by_fours[3][k]);
        c[k] = EVEN_FOURS(low, high);
        c[8 + k] = ODD_FOURS(low, high);
        c[4 + k] = EVEN_FOURS(low_odd, high_odd);
        c[12 + k] = ODD_FOURS(low_odd, high_odd);
    }
    reals t[12];
#pragma unroll
    for (int pair = 0; pair < 6; pair++) {
        const uint16 both = as_uint16(c[10 + pair]);
        t[2 * pair] = as_float16(both << 16);
        t[2 * pair + 1] = as_float16(both & 0xffff0000u);
    }
    Local out = of_polynomial(c, t, u, v, w);
    out.off = t[10];
    out.off_slope = t[11];
    return out;
}

// Prefetch the polynomials of the lanes' next cubes: nothing else hides the latency of a CPU's memory.
static inline void ask_for_cubes(__global const real *coefficients, ints start)
{
#pragma unroll
    for (int lane = 0; lane < LANES; lane++) {
        __builtin_prefetch((const void *)(size_t)(coefficients + INT_AT(start, lane)));
    }
}

#else
#error cubes are looked up in single precision
#endif

#endif

#endif
