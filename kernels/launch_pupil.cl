// Places scrambled Sobol points or lattice points of the unit square on a pupil and launches their rays, one work-item
// per ray, all in double. There is one seed per replicate and axis; equal areas of the square map to equal shares of
// the pupil.
//
// center [m]; first and second [m]: the pupil's axes times its reach; look: the unit vector of all directions; to_x
// and to_y: rows of the matrix that makes coordinates across it of those on the pupil (pupils.across_look). shape,
// row_count, column_count and table_in: the numbers of the map, see pupil_shape.h. seeds (replicate_count, 2); ray r is
// point order_in[r % per_replicate] of replicate r / per_replicate, an order in which neighbours in the launch are
// neighbours on the pupil. generator: 0 for Sobol points; else the generator of a lattice of per_replicate points,
// which is made periodic along the axes whose bits are set in `smoothed`, with the weights weight_out (ray_count): see
// aerokernels/tracing/pupil/quadrature.py. Rays from first_ray up to ray_count: position_out [m] and
// direction_out (ray_count, 3), packed; pupil_out (ray_count), coordinates across the look direction in units of its reach.

#include "arguments.h"
#include "pupil_shape.h"
#include "sobol.h"

// The substitution p(t) of aerokernels/tracing/pupil/quadrature.py.
static inline double periodic_place(double t)
{
    return t * t * t * (10.0 + t * (6.0 * t - 15.0));
}

// The slope of `periodic_place`.
static inline double periodic_weight(double t)
{
    const double half_way = t * (1.0 - t);
    return 30.0 * half_way * half_way;
}

__kernel void launch_pupil(LAUNCH_PUPIL_ARGUMENTS)
{
    const int ray = (int)get_global_id(0) + first_ray;
    if (ray >= ray_count) {
        return;
    }
    const int replicate = ray / per_replicate;
    const uint index = (uint)order_in[ray - replicate * per_replicate];
    const double unit = 0x1p-32;
    double u, v;
    if (generator > 0) {
        const double count = (double)per_replicate;
        u = ((double)index + ((double)seeds[2 * replicate] + 0.5) * unit) / count;
        v = (double)((long)index * generator % per_replicate) / count + ((double)seeds[2 * replicate + 1] + 0.5) * unit;
        v = v >= 1.0 ? v - 1.0 : v;
        double weight = 1.0;
        if (smoothed & 1) {
            weight *= periodic_weight(u);
            u = periodic_place(u);
        }
        if (smoothed & 2) {
            weight *= periodic_weight(v);
            v = periodic_place(v);
        }
        weight_out[ray] = weight;
    } else {
        u = ((double)scramble(reverse_bits(index), seeds[2 * replicate]) + 0.5) * unit;
        v = ((double)scramble(second_axis(index), seeds[2 * replicate + 1]) + 0.5) * unit;
    }
    const double2 place = place_on_pupil(shape, row_count, column_count, table_in, u, v);
    vstore3(center + place.x * first + place.y * second, ray, position_out);
    vstore3(look, ray, direction_out);
    const double2 across = (double2)(to_x.x * place.x + to_x.y * place.y, to_y.x * place.x + to_y.y * place.y);
    vstore2(across, ray, pupil_out);
}
