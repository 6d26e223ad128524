// Rounds coefficients to the precision of the tracing kernels: values_in in double, values_out in the kernel's
// precision, places first_place up to place_count.

#include "types.h"
#include "real.h"

__kernel void round_coefficients(
    __global const double *values_in, const int first_place, const int place_count, __global real *values_out)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place < place_count) {
        values_out[place] = (real)values_in[place];
    }
}
