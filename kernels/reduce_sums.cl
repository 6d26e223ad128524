// One level of a tree reduction, one work-item per number: reduces row_count rows of each replicate to reduced_count
// rows. Each new row is the sum of REDUCTION_WIDTH rows, in order. Number k of a row is one of the moments, then real
// and imaginary part of the phasor.
//
// Numbers first_sum up to sum_count: sums_in (replicates * row_count, SUM_COUNT) and sums_out (replicates *
// reduced_count, SUM_COUNT).

#include "arguments.h"
#include "groups.h"

__kernel void reduce_sums(REDUCE_SUMS_ARGUMENTS)
{
    const int sum = (int)get_global_id(0) + first_sum;
    if (sum >= sum_count) {
        return;
    }
    const int joined = sum / SUM_COUNT;
    const int k = sum - joined * SUM_COUNT;
    const int replicate = joined / reduced_count;
    const int first = (joined - replicate * reduced_count) * REDUCTION_WIDTH;
    const int stop = min(first + REDUCTION_WIDTH, row_count);
    double whole = 0.0;
    for (int row = replicate * row_count + first; row < replicate * row_count + stop; row++) {
        const double part = sums_in[(size_t)row * SUM_COUNT + k];
        whole = k == WORST ? fmax(whole, part) : whole + part;
    }
    sums_out[sum] = whole;
}
