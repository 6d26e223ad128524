// Coefficients in the precision in which rays look them up: values_in in double, values_out as the kernel is built for,
// of the places first_place up to place_count.

#include "arguments.h"
#include "real.h"

__kernel void round_coefficients(ROUND_COEFFICIENTS_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place < place_count) {
        values_out[place] = (real)values_in[place];
    }
}
