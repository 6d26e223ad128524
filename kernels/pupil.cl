// The kernels of a pupil, built together: to load a program from a driver's cache takes longer than to trace a pupil.

#include "groups.h"
#include "pupil_shape.h"
#include "sobol.h"

// The substitution p(t) of aerokernels/tracing/tasks/quadrature.py.
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
// aerokernels/tracing/tasks/quadrature.py. Rays from first_ray up to ray_count: position_out [m] and
// direction_out (ray_count, 3), packed; pupil_out (ray_count), coordinates across the look direction in units of its reach.
__kernel void launch_pupil(
    const double3 center,
    const double3 first,
    const double3 second,
    const double3 look,
    const double3 to_x,
    const double3 to_y,
    const int shape,
    const int row_count,
    const int column_count,
    __global const double *table_in,
    __global const uint *seeds,
    __global const int *order_in,
    const int per_replicate,
    const int generator,
    const int smoothed,
    const int first_ray,
    const int ray_count,
    __global double *position_out,
    __global double *direction_out,
    __global double *pupil_out,
    __global double *weight_out)
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

// One level of a tree reduction, one work-item per number: reduces row_count rows of each replicate to reduced_count
// rows. Each new row is the sum of REDUCTION_WIDTH rows, in order. Number k of a row is one of the moments, then real
// and imaginary part of the phasor.
//
// Numbers first_sum up to sum_count: sums_in (replicates * row_count, SUM_COUNT) and sums_out (replicates *
// reduced_count, SUM_COUNT).
__kernel void reduce_sums(
    const int row_count, const int reduced_count, const int first_sum, const int sum_count,
    __global const double *sums_in, __global double *sums_out)
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
