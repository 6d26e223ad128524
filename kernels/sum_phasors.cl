// Sums of exp(i k (OPD - surface)) over groups of GROUP rays, those that arrived: one work-group sums one group, in
// double.
//
// wave_number k [1/m]; plane: the surface's height [m] at the pupil's centre, and its rise [m] over the pupil's reach
// along both axes; focus: its rise [m] with the square of the distance from the centre, over that of the reach.
// weight_in: what each ray counts, weight_count numbers, one for each ray or the same for all.
// Per ray: pupil_in, opd_in [m], status_in; per_replicate of them to a replicate.
// Groups from first_group up to group_count: real and imaginary part, the last two of sums_out (group_count,
// SUM_COUNT).

#include "arguments.h"
#include "groups.h"

__kernel void sum_phasors(SUM_PHASORS_ARGUMENTS)
{
    __local double2 parts[WORK_GROUP];
    const int item = (int)get_local_id(0);
    const int group = (int)get_group_id(0) + first_group;
    const int2 span = group_span(group, group_count, per_replicate);
    double2 part = (double2)(0.0, 0.0);
    for (int ray = span.x + item; ray < span.y; ray += WORK_GROUP) {
        if (HAS_ARRIVED(status_in[ray])) {
            const double2 p = vload2(ray, pupil_in);
            const double surface = plane.x + plane.y * p.x + plane.z * p.y + focus * (p.x * p.x + p.y * p.y);
            const double phase = wave_number * (opd_in[ray] - surface);
            part += weight_in[weight_count > 1 ? ray : 0] * (double2)(cos(phase), sin(phase));
        }
    }
    parts[item] = part;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item == 0 && group < group_count) {
        double2 whole = (double2)(0.0, 0.0);
        for (int k = 0; k < WORK_GROUP; ++k) {
            whole += parts[k];
        }
        vstore2(whole, 0, sums_out + (size_t)group * SUM_COUNT + MOMENT_COUNT);
    }
}
