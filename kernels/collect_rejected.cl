// Lists the rays of a chunk whose error is finite and above a limit, and copies their starts to the listed places.
//
// Rays first_ray up to ray_count. rows_out, start_out and heading_out have room for `room` rays; rays that are
// found when they are full are counted only. count_out: number of rays found, 0 before the launch.

#include "arguments.h"

__kernel void collect_rejected(COLLECT_REJECTED_ARGUMENTS)
{
    const int ray = (int)get_global_id(0) + first_ray;
    if (ray >= ray_count || !(step_error_in[ray] > limit && step_error_in[ray] < (double)INFINITY)) {
        return;
    }
    const int place = atomic_inc(count_out);
    if (place < room) {
        rows_out[place] = ray;
        vstore3(vload3(ray, position_in), place, start_out);
        vstore3(vload3(ray, direction_in), place, heading_out);
    }
}
