// The greatest size of a grid's values outside a part of it, for each node of the last two axes.
//
// Places first_place up to place_count (second_count, third_count): values_in (first_count, second_count, third_count);
// the part is from `low` to `high` along each axis, both included; greatest_out: one for each place.

#include "arguments.h"
#include "real.h"

__kernel void greatest_outside(GREATEST_OUTSIDE_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    const int second = place / third_count;
    const int third = place - second * third_count;
    const int is_beside = second < second_low || second > second_high || third < third_low || third > third_high;
    double greatest = 0.0;
    for (int first = 0; first < first_count; ++first) {
        if (is_beside || first < first_low || first > first_high) {
            greatest = greater64(greatest, fabs(values_in[(size_t)first * second_count * third_count + place]));
        }
    }
    greatest_out[place] = greatest;
}
