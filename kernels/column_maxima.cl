// Greatest sizes over the nodes of each block of `block` by `block` cells along the first two axes of a grid, for each
// node of the third axis: of the fourth differences of the spline's coefficients along each axis (roughness_of_blocks in
// aerokernels/tracing/step_bound.py), and of the potential m (ambient + m / 2) / ambient of the contrasts m.
//
// Places up to place_count (first_place is 0); a work-item takes LANES neighbours along the third axis at a time, which
// has no fewer nodes: coefficients_in (first_count + 2, second_count + 2, third_count + 2) and values_in (first_count,
// second_count, third_count); maxima_out (4, first blocks, second blocks, third_count). A grid of two axes has a
// first_count of 1 and one layer of coefficients. At the ends of an axis the coefficients continue as a cubic, whose
// fourth difference is 0; where `even` is 1 they are mirrored at the second axis' first node.

#include "arguments.h"
#include "neighbors.h"

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

__kernel void column_maxima(COLUMN_MAXIMA_ARGUMENTS)
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
