// Sums exp(i k (OPD - surface)) over the rays that arrived, in groups of GROUP rays: one work-group sums one group, in
// double.
//
// wave_number: k [1/m]; plane: the surface's height [m] at the pupil's centre, and its rise [m] over the pupil's reach
// along both axes; focus: the surface's rise [m] with the square of the distance from the centre, in units of the
// reach. weight_in: the weights of the rays, one for each ray (weight_count = ray count) or one for all (weight_count =
// 1). Per ray: pupil_in, opd_in [m], status_in; per_replicate rays to a replicate. Groups from first_group up to
// group_count: sums_out (group_count, SUM_COUNT) gets real and imaginary part as its last two columns.

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
