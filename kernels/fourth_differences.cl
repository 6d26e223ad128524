// Greatest size of the fourth differences of a volume's spline coefficients along an axis, over the nodes of each block
// of `block` cells along the first axis: see roughness_of_blocks in aerokernels/tracing/step_bound.py.
//
// Places first_place up to place_count: coefficients_in (first_count + 2, second_count + 2, third_count + 2) of a grid
// of (first_count, second_count, third_count) nodes; maxima_out (blocks, second_count, third_count). At the ends of an
// axis the coefficients continue as a cubic, whose fourth difference is 0.

#include "arguments.h"
#include "real.h"

__kernel void fourth_differences(FOURTH_DIFFERENCES_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    const int across = second_count * third_count;
    const int first = place / across * block;
    const int second = (place - place / across * across) / third_count;
    const int third = place - place / third_count * third_count;
    const int pitch = third_count + 2;
    const int plane = (second_count + 2) * pitch;
    const int stride = axis == 0 ? plane : axis == 1 ? pitch : 1;
    const int count = axis == 0 ? first_count : axis == 1 ? second_count : third_count;
    double greatest_size = 0.0;
    for (int node = first; node <= min(first + block, first_count - 1); ++node) {
        const int along = axis == 0 ? node : axis == 1 ? second : third;
        __global const double *c = coefficients_in + (size_t)(node + 1) * plane + (size_t)(second + 1) * pitch + third + 1;
        double change = 0.0;
        if (along > 0 && along < count - 1) {
            change = c[-2 * stride] - 4.0 * c[-stride] + 6.0 * c[0] - 4.0 * c[stride] + c[2 * stride];
        }
        greatest_size = greater64(greatest_size, fabs(change));
    }
    maxima_out[place] = greatest_size;
}
