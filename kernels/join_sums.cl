// Sums of replicates from those of their groups: a work-item a number, the groups in their order.
//
// Of the sums first_sum up to sum_count, number k of replicate r is r * (MOMENT_COUNT + 2) + k: the moments, then real and
// imaginary part of the phasor. moments_in (group_count, MOMENT_COUNT) and phasor_in (group_count) are those of
// sum_moments and sum_phasors, with per_replicate rays to a replicate.

#include "groups.h"

__kernel void join_sums(
    const int per_replicate,
    const int first_sum,
    const int sum_count,
    __global const double *moments_in,
    __global const double2 *phasor_in,
    __global double *sums_out)
{
    const int sum = (int)get_global_id(0) + first_sum;
    if (sum >= sum_count) {
        return;
    }
    const int groups = (per_replicate + GROUP - 1) / GROUP;
    const int replicate = sum / (MOMENT_COUNT + 2);
    const int k = sum - replicate * (MOMENT_COUNT + 2);
    double whole = 0.0;
    for (int group = replicate * groups; group < (replicate + 1) * groups; group++) {
        if (k < MOMENT_COUNT) {
            const double part = moments_in[(size_t)group * MOMENT_COUNT + k];
            whole = k == WORST ? fmax(whole, part) : whole + part;
        } else {
            const double2 part = phasor_in[group];
            whole += k == MOMENT_COUNT ? part.x : part.y;
        }
    }
    sums_out[sum] = whole;
}
