// The kernels that prepare a grid: its spline, and the greatest values in blocks of cells. Built together.

#include "neighbors.h"

// Values of a node, or their potentials.
INLINED doubles values_at(__global const double *from, ints after, int in_row, double ambient)
{
    const doubles value = read_all(from, after, in_row);
    return ambient > 0.0 ? value * (ambient + 0.5 * value) : value;
}

// Nodes that are read ahead of the elimination: on a GPU each step would otherwise wait for memory. A processor reads
// ahead itself.
#if LANES == 1
#define AHEAD 32
#else
#define AHEAD 1
#endif

#define VALUE(node) values_at(values + (size_t)(node) * pitch, value_after, in_row, ambient)
#define MADE(row) read_all(made + (size_t)(row) * pitch, made_after, in_row)
#define MAKE(row, coefficients) write_all(coefficients, made + (size_t)(row) * pitch, made_after, in_row)

// Solves for the coefficients of the cubic splines through the values of lines by elimination: see _eliminated in
// aerokernels/medium/spline.py. A work-item solves LANES lines. The ends are not-a-knot, or the first end is mirrored
// (even).
//
// Lines first_line up to line_count: values_in (outer, count, pitch), coefficients_out (outer, count + 2, pitch);
// a line is (outer, all, inner). inverse_in: inverse pivots of the equations, shape (count - 1,).
// ambient: if it is above 0, the values are contrasts m, and the spline is that of the potential m (ambient + m / 2).
__kernel void spline_lines(
    __global const double *values_in, __global const double *inverse_in, const int count, const int pitch, const int even,
    const double ambient, const int first_line, const int line_count, __global double *coefficients_out)
{
    const int begin = (int)get_global_id(0) * LANES + first_line;
    if (begin >= line_count) {
        return;
    }
    const int outer = begin / pitch;
    const int inner = begin - outer * pitch;
    const int in_row = inner + LANES <= pitch && begin + LANES <= line_count;
    // Lanes beyond the last line solve that line too. A lane that is in the next row of lines is a row of nodes further.
    const ints line = min((ints)(LANE_NUMBERS), (ints)(line_count - 1 - begin));
    const ints rows_on = (inner + line) / pitch;
    const ints value_after = line + rows_on * ((count - 1) * pitch);
    const ints made_after = line + rows_on * ((count + 1) * pitch);
    __global const double *values = values_in + (size_t)outer * count * pitch + inner;
    __global double *made = coefficients_out + (size_t)outer * (count + 2) * pitch + inner;
    const int last = count - 1;
    const int first = even ? 2 : 3;
    doubles before = 6.0 * VALUE(0);
    if (even) {
        MAKE(1, before);
    } else {
        const doubles second = VALUE(1);
        before = second - (VALUE(0) - 2.0 * second + VALUE(2)) / 6.0;
        MAKE(2, before);
    }
    doubles ahead[AHEAD];
    double pivots[AHEAD];
    for (int begin_row = first; begin_row < last; begin_row += AHEAD) {
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            const int node = min(begin_row + k, last - 1) - 1;
            ahead[k] = VALUE(node);
            pivots[k] = inverse_in[node];
        }
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            if (begin_row + k < last) {
                before = 6.0 * ahead[k] - before * pivots[k];
                MAKE(begin_row + k, before);
            }
        }
    }
    const doubles inward = VALUE(count - 2);
    doubles after = inward - (VALUE(count - 3) - 2.0 * inward + VALUE(count - 1)) / 6.0;
    MAKE(last, after);
    for (int begin_row = last - 1; begin_row >= first; begin_row -= AHEAD) {
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            const int row = max(begin_row - k, first);
            ahead[k] = MADE(row);
            pivots[k] = inverse_in[row];
        }
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            if (begin_row - k >= first) {
                after = (ahead[k] - after) * pivots[k];
                MAKE(begin_row - k, after);
            }
        }
    }
    if (even) {
        MAKE(1, 0.25 * (MADE(1) - 2.0 * MADE(2)));
        MAKE(0, MADE(2));
    } else {
        MAKE(1, 6.0 * VALUE(1) - 4.0 * MADE(2) - MADE(3));
        MAKE(0, 6.0 * VALUE(0) - 4.0 * MADE(1) - MADE(2));
    }
    MAKE(last + 1, 6.0 * VALUE(last - 1) - 4.0 * MADE(last) - MADE(last - 1));
    MAKE(last + 2, 6.0 * VALUE(last) - 4.0 * MADE(last + 1) - MADE(last));
}

// PoCL splits vectors for its own fmax, select and fabs.
INLINED doubles greater_of(doubles a, doubles b) { return a > b ? a : b; }
INLINED doubles size_of(doubles a) { return greater_of(a, -a); }

// Sizes of the fourth differences about some entries, whose neighbours are some numbers away; `second_before` is where
// the second neighbour before them is.
INLINED doubles fourth_difference(__global const double *c, int step, int second_before)
{
    return size_of(read_row(c + second_before) - 4.0 * read_row(c - step) + 6.0 * read_row(c)
        - 4.0 * read_row(c + step) + read_row(c + 2 * step));
}

// Greatest sizes over the nodes of each block of `block` by `block` cells along the first two axes of a grid, for each
// node of the third axis: of the fourth differences of the spline's coefficients along each axis (roughness_of_blocks in
// aerokernels/tracing/step_bound.py), and of the potential m (ambient + m / 2) / ambient of the contrasts m.
//
// Places up to place_count (first_place is 0); a work-item takes LANES neighbours along the third axis at a time, which
// has no fewer nodes: coefficients_in (first_count + 2, second_count + 2, third_count + 2) and values_in (first_count,
// second_count, third_count); maxima_out (4, first blocks, second blocks, third_count). A grid of two axes has a
// first_count of 1 and one layer of coefficients. At the ends of an axis the coefficients continue as a cubic, whose
// fourth difference is 0; where `even` is 1 they are mirrored at the second axis' first node.
__kernel void column_maxima(
    __global const double *coefficients_in, __global const double *values_in, const int first_count,
    const int second_count, const int third_count, const int block, const int even, const double ambient,
    const int first_place, const int place_count, __global double *maxima_out)
{
    const int blocks = (second_count - 2) / block + 1;
    const int pitch = third_count + 2;
    const int plane = (second_count + 2) * pitch;
    const int before_first = min(first_count - 1, 1);
    // Rows of lanes along the third axis, of which the last begins earlier where it would end too late.
    const int parts = (third_count + LANES - 1) / LANES;
    const int part_count = place_count / third_count * parts;
    for (int part = (int)get_global_id(0) + first_place; part < part_count; part += (int)get_global_size(0)) {
        const int row = part / parts;
        const int third = min((part - row * parts) * LANES, third_count - LANES);
        const int first = row / blocks * block;
        const int second = (row - row / blocks * blocks) * block;
        doubles along_first = 0.0;
        doubles along_second = 0.0;
        doubles along_third = 0.0;
        doubles potential = 0.0;
        for (int i = first; i <= min(first + block, first_count - 1); ++i) {
            for (int j = second; j <= min(second + block, second_count - 1); ++j) {
                __global const double *c =
                    coefficients_in + (size_t)(i + before_first) * plane + (j + 1) * pitch + third + 1;
                const doubles value = read_row(values_in + ((size_t)i * second_count + j) * third_count + third);
                potential = greater_of(potential, size_of(value * (ambient + 0.5 * value)));
                along_third = greater_of(along_third, fourth_difference(c, 1, -2));
                if (i > 0 && i < first_count - 1) {
                    along_first = greater_of(along_first, fourth_difference(c, plane, -2 * plane));
                }
                if (j < second_count - 1 && (j > 0 || even)) {
                    const int second_before = j > 0 ? -2 * pitch : 2 * pitch;
                    along_second = greater_of(along_second, fourth_difference(c, pitch, second_before));
                }
            }
        }
        const ints node = third + (ints)(LANE_NUMBERS);
        const truths is_inside = TO_TRUTHS((node > 0) & (node < third_count - 1));
        const size_t table = (max(first_count - 2, 0) / block + 1) * blocks * (size_t)third_count;
        __global double *made = maxima_out + (size_t)row * third_count + third;
        write_row(along_first, made);
        write_row(along_second, made + table);
        write_row(CHOOSE64((doubles)(0.0), along_third, is_inside), made + 2 * table);
        write_row(potential / ambient, made + 3 * table);
    }
}

// Greatest size of the values at the nodes of each block of `block` cells along an axis: block_maxima in
// aerokernels/tracing/blocks.py.
//
// Places first_place up to place_count: values_in (outer, count, pitch), maxima_out (outer, blocks, pitch).
__kernel void block_maxima(
    __global const double *values_in, const int count, const int pitch, const int block, const int first_place,
    const int place_count, __global double *maxima_out)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    const int blocks = max(count - 2, 0) / block + 1;
    const int row = place / pitch;
    const int inner = place - row * pitch;
    const int outer = row / blocks;
    const int first = (row - outer * blocks) * block;
    __global const double *values = values_in + (size_t)outer * count * pitch + inner;
    double greatest_size = 0.0;
    for (int node = first; node <= min(first + block, count - 1); ++node) {
        greatest_size = greater64(greatest_size, fabs(values[(size_t)node * pitch]));
    }
    maxima_out[place] = greatest_size;
}
