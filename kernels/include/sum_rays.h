// Sums over groups of GROUP rays: a work-group sums one group, and each work-item every WORK_GROUP-th ray of the group.
// A replicate begins with a new group, so that no group has rays of two replicates.
#ifndef SUM_RAYS_H
#define SUM_RAYS_H

#include "constants.h"
#include "ray_status.h"

// Work-items of a work-group, which the host sets; no fewer than SUM_COUNT.
#ifndef WORK_GROUP
#define WORK_GROUP 64
#endif

#define WORST 10  // the moment that is a maximum, not a sum

// Whether a ray of this status reached the stop, see aerokernels/tracing/stop.py.
#define HAS_ARRIVED(status) \
    ((status) == RAY_OK || (status) == RAY_LEFT_DISTURBED_AIR || (status) == RAY_TOLERANCE_NOT_MET)

// First ray of a group, and one past its last; they are the same where there is no such group.
int2 group_span(int group, int group_count, int per_replicate)
{
    const int groups = (per_replicate + GROUP - 1) / GROUP;
    const int replicate = group / groups;
    const int begin = (group - replicate * groups) * GROUP;
    const int count = group < group_count ? min(GROUP, per_replicate - begin) : 0;
    return (int2)(replicate * per_replicate + begin, replicate * per_replicate + begin + count);
}

// Sums the moments of a wavefront, and its phasor, over groups of GROUP rays: one work-group sums one group, in double.
//
// wave_number: k [1/m]; plane: the surface's height [m] at the pupil's centre, and its rise [m] over the pupil's reach
// along both axes; focus: the surface's rise [m] with the square of the distance from the centre, in units of the
// reach. weight_in: the weights of the rays, one for each ray (weight_count = ray count) or one for all (weight_count =
// 1). Per ray: pupil_in, opd_in [m], step_error_in [m], evaluation_count_in, status_in; per_replicate rays to a
// replicate. Groups from first_group up to group_count: sums_out (group_count, SUM_COUNT) gets the weighted sums of 1,
// x, y, W, xx, xy, yy, xW, yW, WW over the rays that arrived, their greatest step error, the number of field
// evaluations of all rays, and, over the rays that arrived, the sums of xq, yq, qq, qW with q = xx + yy, and of
// exp(i k (OPD - surface)).
__kernel void sum_rays(
    const double wave_number,
    const double3 plane,
    const double focus,
    const int per_replicate,
    const int first_group,
    const int group_count,
    const int weight_count,
    __global const double *weight_in,
    __global const double *pupil_in,
    __global const double *opd_in,
    __global const double *step_error_in,
    __global const int *evaluation_count_in,
    __global const int *status_in,
    __global double *sums_out)
{
    __local double parts[WORK_GROUP][SUM_COUNT];
    const int item = (int)get_local_id(0);
    const int group = (int)get_group_id(0) + first_group;
    const int2 span = group_span(group, group_count, per_replicate);
    double part[SUM_COUNT];
    for (int k = 0; k < SUM_COUNT; ++k) {
        part[k] = 0.0;
    }
    for (int ray = span.x + item; ray < span.y; ray += WORK_GROUP) {
        part[11] += (double)evaluation_count_in[ray];
        if (HAS_ARRIVED(status_in[ray])) {
            const double share = weight_in[weight_count > 1 ? ray : 0];
            const double2 p = vload2(ray, pupil_in);
            const double w = opd_in[ray], q = p.x * p.x + p.y * p.y;
            part[0] += share;
            part[1] += share * p.x;
            part[2] += share * p.y;
            part[3] += share * w;
            part[4] += share * p.x * p.x;
            part[5] += share * p.x * p.y;
            part[6] += share * p.y * p.y;
            part[7] += share * p.x * w;
            part[8] += share * p.y * w;
            part[9] += share * w * w;
            part[12] += share * p.x * q;
            part[13] += share * p.y * q;
            part[14] += share * q * q;
            part[15] += share * q * w;
            part[WORST] = fmax(part[WORST], step_error_in[ray]);
            const double phase = wave_number * (w - (plane.x + plane.y * p.x + plane.z * p.y + focus * q));
            part[MOMENT_COUNT] += share * cos(phase);
            part[MOMENT_COUNT + 1] += share * sin(phase);
        }
    }
    for (int k = 0; k < SUM_COUNT; ++k) {
        parts[item][k] = part[k];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    // One work-item per sum.
    if (item < SUM_COUNT && group < group_count) {
        double whole = 0.0;
        for (int k = 0; k < WORK_GROUP; ++k) {
            whole = item == WORST ? fmax(whole, parts[k][item]) : whole + parts[k][item];
        }
        sums_out[(size_t)group * SUM_COUNT + item] = whole;
    }
}

#endif
