// The greatest error and the greatest potential in blocks and in those adjacent to them: missed_at_ends in
// aerokernels/tracing/leapfrog/unresolved.py, and disturbed_ends in missed_on_lines.py.
//
// Places first_place up to place_count: blocks_in holds the number of each one's block in tables (first_count,
// second_count, third_count). missed_in is such a table, and tables_in has that of the potential from potential_begin
// on; greatest_out (place_count, 2).

#include "arguments.h"
#include "real.h"

__kernel void missed_around(MISSED_AROUND_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    const int row = blocks_in[place] / third_count;
    const int third = blocks_in[place] - row * third_count;
    const int first = row / second_count;
    const int second = row - first * second_count;
    double missed = 0.0;
    double potential = 0.0;
    for (int i = max(first - 1, 0); i <= min(first + 1, first_count - 1); ++i) {
        for (int j = max(second - 1, 0); j <= min(second + 1, second_count - 1); ++j) {
            for (int k = max(third - 1, 0); k <= min(third + 1, third_count - 1); ++k) {
                const int block = (i * second_count + j) * third_count + k;
                missed = greater64(missed, missed_in[block]);
                potential = greater64(potential, tables_in[potential_begin + block]);
            }
        }
    }
    greatest_out[2 * place] = missed;
    greatest_out[2 * place + 1] = potential;
}
