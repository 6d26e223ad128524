// The sum over layers of blocks of the greatest error that a ray may meet in each, and the greatest of all:
// _greatest_on_lines in aerokernels/tracing/leapfrog/missed_on_lines.py.
//
// Places first_place up to place_count, each a row and a column of runs of blocks: in each of layer_count layers the
// greatest of row_width by column_width blocks counts, times weight_in of the layer. missed_in: errors of blocks, whose
// first one is at `begin` and the next ones some numbers (pitch) after it; sums_out (place_count, 2).

#include "arguments.h"
#include "real.h"

__kernel void missed_in_layers(MISSED_IN_LAYERS_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    const int row = place / column_count;
    const int column = place - row * column_count;
    const int corner = begin + row * row_pitch + column * column_pitch;
    double sum = 0.0;
    double greatest = 0.0;
    for (int layer = 0; layer < layer_count; ++layer) {
        double met = 0.0;
        for (int i = 0; i < row_width; ++i) {
            for (int j = 0; j < column_width; ++j) {
                const int at = corner + layer * layer_pitch + i * row_pitch + j * column_pitch;
                met = greater64(met, missed_in[at]);
            }
        }
        sum += met * weight_in[layer];
        greatest = greater64(greatest, met);
    }
    sums_out[2 * place] = sum;
    sums_out[2 * place + 1] = greatest;
}
