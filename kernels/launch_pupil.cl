// Rays of a pupil: scrambled Sobol points on a disc, one seed per replicate and axis; equal areas of the square map to
// equal areas of the disc. One work-item a ray, all in double.
//
// center [m], and the pupil's axes times its radius, first and second [m]; look is the unit vector of all directions.
// seeds (replicate_count, 2); ray r is point order_in[r % per_replicate] of replicate r / per_replicate: an order in which
// neighbours in the launch are neighbours on the disc.
// Rays from first_ray up to ray_count: position_out [m] and direction_out (ray_count, 3), packed;
// pupil_out (ray_count), coordinates on the disc in units of its radius.

#include "arguments.h"
#include "sobol.h"

__kernel void launch_pupil(LAUNCH_PUPIL_ARGUMENTS)
{
    const int ray = (int)get_global_id(0) + first_ray;
    if (ray >= ray_count) {
        return;
    }
    const int replicate = ray / per_replicate;
    const uint index = (uint)order_in[ray - replicate * per_replicate];
    const double unit = 0x1p-32;
    const double u = ((double)scramble(reverse_bits(index), seeds[2 * replicate]) + 0.5) * unit;
    const double v = ((double)scramble(second_axis(index), seeds[2 * replicate + 1]) + 0.5) * unit;
    const double radius = sqrt(u);
    const double angle = 6.283185307179586 * v;
    const double x = radius * cos(angle);
    const double y = radius * sin(angle);
    vstore3(center + x * first + y * second, ray, position_out);
    vstore3(look, ray, direction_out);
    vstore2((double2)(x, y), ray, pupil_out);
}
