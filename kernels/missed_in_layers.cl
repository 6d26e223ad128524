// The greatest error that a ray may meet in each layer of blocks: _greatest_on_lines in
// aerokernels/tracing/leapfrog/missed_on_lines.py.
//
// Places first_place up to place_count (layers, row_count, column_count): the greatest of each run of row_width by
// column_width blocks of a layer. missed_in: errors of blocks, whose first one is at `begin` and the next ones some
// numbers (pitch) after it; greatest_out: one for each place.

#include "arguments.h"
#include "real.h"

__kernel void missed_in_layers(MISSED_IN_LAYERS_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    const int line = place / column_count;
    const int column = place - line * column_count;
    const int layer = line / row_count;
    const int row = line - layer * row_count;
    const int corner = begin + layer * layer_pitch + row * row_pitch + column * column_pitch;
    double greatest = 0.0;
    for (int i = 0; i < row_width; ++i) {
        for (int j = 0; j < column_width; ++j) {
            greatest = greater64(greatest, missed_in[corner + i * row_pitch + j * column_pitch]);
        }
    }
    greatest_out[place] = greatest;
}
