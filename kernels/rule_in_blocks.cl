// The rule's own bound of the error by structure between samples, for each block and per metre of path: _by_rule in
// aerokernels/tracing/leapfrog/unresolved.py.
//
// Places first_place up to place_count: fourth_in (3, table) holds the greatest fourth differences along three axes;
// scales: what they are multiplied by; missed_out (table).

#include "arguments.h"
#include "real.h"

__kernel void rule_in_blocks(RULE_IN_BLOCKS_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    const double root = sqrt(sqrt(scales.x * fourth_in[place])) + sqrt(sqrt(scales.y * fourth_in[table + place]))
        + sqrt(sqrt(scales.z * fourth_in[2 * table + place]));
    const double square = root * root;
    missed_out[place] = square * square;
}
