// Greatest sizes over the nodes of each block of `block` by `block` cells along the first two axes of a grid, for each
// node of the third axis: of the fourth differences of the spline's coefficients along each axis (roughness_of_blocks in
// aerokernels/tracing/step_bound.py), and of the potential m (ambient + m / 2) / ambient of the contrasts m.
//
// Places first_place up to place_count: coefficients_in (first_count + 2, second_count + 2, third_count + 2) and
// values_in (first_count, second_count, third_count); maxima_out (4, first blocks, second blocks, third_count). A grid of
// two axes has a first_count of 1 and one layer of coefficients. At the ends of an axis the coefficients continue as a
// cubic, whose fourth difference is 0; where `even` is 1 they are mirrored at the second axis' first node.

#include "arguments.h"
#include "real.h"

// Size of the fourth difference about the entry of a node. Without a branch, so that a processor's lanes stay together.
static inline double fourth_difference(
    __global const double *coefficients_in, int place, int stride, int node, int count, int even)
{
    const int is_mirrored = even && node == 0;
    const int is_inside = node < count - 1 && (node > 0 || is_mirrored);
    const int step = is_inside ? stride : 0;
    __global const double *c = coefficients_in + place;
    const double before = c[is_mirrored ? 2 * step : -2 * step];
    const double change = before - 4.0 * c[-step] + 6.0 * c[0] - 4.0 * c[step] + c[2 * step];
    return is_inside ? fabs(change) : 0.0;
}

__kernel void column_maxima(COLUMN_MAXIMA_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    const int blocks = (second_count - 2) / block + 1;
    const int row = place / third_count;
    const int third = place - row * third_count;
    const int first = row / blocks * block;
    const int second = (row - row / blocks * blocks) * block;
    const int pitch = third_count + 2;
    const int plane = (second_count + 2) * pitch;
    const int before_first = min(first_count - 1, 1);
    double along_first = 0.0;
    double along_second = 0.0;
    double along_third = 0.0;
    double potential = 0.0;
    for (int i = first; i <= min(first + block, first_count - 1); ++i) {
        __global const double *layer = coefficients_in + (size_t)(i + before_first) * plane;
        for (int j = second; j <= min(second + block, second_count - 1); ++j) {
            const int c = (j + 1) * pitch + third + 1;
            const double value = values_in[((size_t)i * second_count + j) * third_count + third];
            along_first = greater64(along_first, fourth_difference(layer, c, plane, i, first_count, 0));
            along_second = greater64(along_second, fourth_difference(layer, c, pitch, j, second_count, even));
            along_third = greater64(along_third, fourth_difference(layer, c, 1, third, third_count, 0));
            potential = greater64(potential, fabs(value * (ambient + 0.5 * value) / ambient));
        }
    }
    const int table = (max(first_count - 2, 0) / block + 1) * blocks * third_count;
    maxima_out[place] = along_first;
    maxima_out[table + place] = along_second;
    maxima_out[2 * table + place] = along_third;
    maxima_out[3 * table + place] = potential;
}
