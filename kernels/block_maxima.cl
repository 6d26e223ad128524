// Greatest size of the values at the nodes of each block of `block` cells along an axis: block_maxima in
// aerokernels/tracing/blocks.py.
//
// Places first_place up to place_count: values_in (outer, count, pitch), maxima_out (outer, blocks, pitch).

#include "arguments.h"
#include "real.h"

__kernel void block_maxima(BLOCK_MAXIMA_ARGUMENTS)
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
