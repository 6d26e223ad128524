// Moves nearly straight rays by leapfrog samples: one leapfrog step per sample.
#ifndef FLIGHT_H
#define FLIGHT_H

#include "packet.h"

// The undisturbed ray: its start in cells, its direction, and the distance between samples.
typedef struct {
    reals x0, y0, z0, dx, dy, dz, h;  // place in cells from the grid's first node (x, y from the axis)
#if CUBES
    reals off, off_slope, off_moment;  // sums of error bounds of the cubes; the last is that of the slope's moments
#endif
} Path;

// The potential `middle` parts of the path on, at momentum p and deviation q, after a half step of length `half_step`; f
// gets its slopes across the path in x, y, z, and `ahead` its slope along it.
static inline reals sample_path(
    const Field *field, const Arrays *arrays, Path *path, real middle, reals half_step, const reals *p, const reals *q,
    reals *f, reals *ahead)
{
    const real3 rate = VECTOR(field->inverse_spacing);
    const reals t = middle * path->h, dx = path->dx, dy = path->dy, dz = path->dz;
    const reals x = path->x0 + (t * dx + q[0] + half_step * p[0]) * rate.x;
    const reals y = path->y0 + (t * dy + q[1] + half_step * p[1]) * rate.y;
    const reals z = path->z0 + (t * dz + q[2] + half_step * p[2]) * rate.z;
#if CUBES && LANES > 1
    // Prefetch for the next sample, straight ahead: a ray turns very little between samples.
    reals u, v, w;
    const reals hop = path->h;
    ask_for_cubes(
        arrays->coefficients,
        cube_start(field, x + hop * dx * rate.x, y + hop * dy * rate.y, z + hop * dz * rate.z, &u, &v, &w));
#endif
    const Potential at = sample_packet(field, arrays, x, y, z);
#if CUBES
    path->off += at.off;
    path->off_slope += at.off_slope;
    path->off_moment += middle * at.off_slope;
#endif
    *ahead = at.x * dx + at.y * dy + at.z * dz;
    f[0] = at.x - *ahead * dx;
    f[1] = at.y - *ahead * dy;
    f[2] = at.z - *ahead * dz;
    return at.value;
}

// Weight of sample k of `count`: the end-corrected midpoint rule.
static inline real quadrature_weight(int k, int count)
{
    const int end = min(k, count - 1 - k);
    return end == 0 ? R(13.0 / 12.0) : end == 1 ? R(7.0 / 8.0) : end == 2 ? R(25.0 / 24.0) : R(1.0);
}

// The weights of three consecutive samples, for six samples or more.
static inline void triple_weights(int triple, int triples, real *weights)
{
    const int is_first = triple == 0, is_last = triple == triples - 1;
    weights[0] = is_first ? R(13.0 / 12.0) : is_last ? R(25.0 / 24.0) : R(1.0);
    weights[1] = is_first || is_last ? R(7.0 / 8.0) : R(1.0);
    weights[2] = is_last ? R(13.0 / 12.0) : is_first ? R(25.0 / 24.0) : R(1.0);
}

#if defined(__AVX512F__) && defined(__has_builtin)
#if __has_builtin(__builtin_ia32_rsqrt14ps512_mask)
#define SWIFT_ROOTS 1
#endif
#endif

// (w - a) / w and 1 / w for w = sqrt(a^2 + surplus), with one root and one quotient and without cancellation.
static inline reals longitudinal_deficit_of(real ambient, reals surplus, reals *slowness)
{
    const reals square = max(ambient * ambient + surplus, (reals)TINY);
#if LANES == 1 && !REAL_IS_DOUBLE
    *slowness = native_rsqrt(square);
    const reals w = square * *slowness;
    return surplus * native_recip((w + ambient) * w);
#elif LANES == 16 && SWIFT_ROOTS
    // The next sample waits for the slowness, not for the deficit: take a table's inverse root, accurate to 2^-14, and
    // one Newton step.
    const reals rough = __builtin_ia32_rsqrt14ps512_mask(square, square, (unsigned short)0xffff);
    *slowness = rough * (R(1.5) - R(0.5) * square * rough * rough);
    const reals w = square * *slowness;
    return surplus * *slowness / (w + ambient);
#else
    const reals w = sqrt(square);
    const reals quotient = R(1.0) / ((w + ambient) * w);
    *slowness = (w + ambient) * quotient;
    return surplus * quotient;
#endif
}

// Add a term to Kahan's compensated sum.
static inline void gather(reals *total, reals *carry, reals term)
{
    const reals y = term - *carry;
    const reals s = *total + y;
    *carry = (s - *total) - y;
    *total = s;
}

#define EACH(c) for (int c = 0; c < 3; c++)

// The state of a packet's rays between samples, and at the end.
typedef struct {
    Path path;
    reals p[3], q[3];             // momentum across the ray, and deviation
    reals impulse[3], moment[3];  // end-corrected sum of the momentum; sum of its moments about the start
    // The momentum minus the sum over every third sample; the same of its moments.
    reals momentum_diff[3], deviation_diff[3];
    reals f[3];                        // slope of the potential across the ray
    reals sigma;                            // int 1 / w dt
    reals bend;                             // sum of P^2 / w
    reals slowness;                         // 1 / w, w the momentum along the ray
    reals paths, paths_carry;               // sums of s / w, of (w - a) / w and of m / w
    reals deficits, deficits_carry;
    reals arcs, arcs_carry;
    reals coarse, coarse_carry;             // sum over every third sample
    reals optical, deficit, arc;            // those sums over three samples
    reals max_deflection;
    reals s, ahead;                         // the potential at the last sample, its slope along the ray
    reals error, steep, lead;               // at the end: error [m]; size of the slope; (w - a) / w
} Flying;

// The state of rays before their first sample, with the momentum `kick` across.
APART Flying take_off(real ambient, const Path *path, const reals *kick)
{
    const reals zero = (reals)R(0.0);
    Flying ray;
    ray.path = *path;
#pragma unroll
    EACH(c) {
        ray.p[c] = ray.impulse[c] = kick[c];
        ray.momentum_diff[c] = -ray.p[c];  // no error of the sums
        ray.q[c] = ray.moment[c] = ray.deviation_diff[c] = ray.f[c] = zero;
    }
    ray.sigma = ray.bend = ray.max_deflection = ray.s = ray.ahead = zero;
    ray.slowness = (reals)(R(1.0) / ambient);
    ray.paths = ray.paths_carry = ray.deficits = ray.deficits_carry = zero;
    ray.arcs = ray.arcs_carry = ray.coarse = ray.coarse_carry = zero;
    ray.optical = ray.deficit = ray.arc = zero;
    return ray;
}

// Take sample j of three, `middle` parts of the path on. `weight` is the sample's weight, `third` its weight in the sum
// over every third sample.
static inline void take_sample(
    const Field *field,
    const Arrays *arrays,
    const Control *control,
    real ambient,
    int j,
    real middle,
    real weight,
    real third,
    Flying *ray)
{
    const reals half_step = R(0.5) * ray->path.h * ray->slowness;
    ray->s = sample_path(field, arrays, &ray->path, middle, half_step, ray->p, ray->q, ray->f, &ray->ahead);
    reals m[3], across = (reals)R(0.0);
#pragma unroll
    EACH(c) {
        m[c] = ray->p[c] + half_step * ray->f[c];
        across += m[c] * m[c];
    }
    const reals deficit = longitudinal_deficit_of(ambient, R(2.0) * ray->s - across, &ray->slowness);
    const reals pace = ray->path.h * ray->slowness, kick = weight * pace;
    ray->optical += weight * ray->s * ray->slowness;
    ray->deficit += weight * deficit;
    if (control->outputs & OUTPUT_ARC_LENGTH) {
        const reals index = sqrt(max(ambient * ambient + R(2.0) * ray->s, (reals)R(0.0)));
        ray->arc += weight * ray->slowness * (R(2.0) * ray->s / (index + ambient));
    }
    const reals place = ray->sigma + R(0.5) * pace, moment_kick = kick * place;
    const reals coarse_kick = R(3.0) * third * pace, coarse_moment_kick = coarse_kick * place;
    if (j == 1) {
        gather(&ray->coarse, &ray->coarse_carry, third * (R(2.0) * ray->s * ray->slowness - ambient * deficit));
    }
#pragma unroll
    EACH(c) {
        ray->p[c] += pace * ray->f[c];
        ray->q[c] += pace * m[c];
        ray->impulse[c] += kick * ray->f[c];
        ray->moment[c] += moment_kick * ray->f[c];
        if (j == 1) {
            ray->momentum_diff[c] -= coarse_kick * ray->f[c];
            ray->deviation_diff[c] -= coarse_moment_kick * ray->f[c];
        }
    }
    ray->sigma += pace;
    ray->bend += across * ray->slowness;
    ray->max_deflection = max(ray->max_deflection, across);
    if (j == 2) {
        gather(&ray->paths, &ray->paths_carry, ray->optical);
        gather(&ray->deficits, &ray->deficits_carry, ray->deficit);
        ray->optical = ray->deficit = (reals)R(0.0);
        if (control->outputs & OUTPUT_ARC_LENGTH) {
            gather(&ray->arcs, &ray->arcs_carry, ray->arc);
            ray->arc = (reals)R(0.0);
        }
    }
}

// Take all samples of PACKETS packets, interleaved: each sample waits for the previous one of its packet, and meanwhile
// the processor works on another packet.
static inline void take_samples(
    const Field *field, const Arrays *arrays, const Control *control, real ambient, Flying *rays)
{
    const int triples = control->sample_count / 3;
    real middle = R(0.5);  // position of the sample along the ray, in h
    for (int triple = 0; triple < triples; triple++) {
        real weights[3];
        triple_weights(triple, triples, weights);
        const real third = quadrature_weight(triple, triples);
#pragma unroll
        for (int j = 0; j < 3; j++) {
#pragma unroll
            for (int packet = 0; packet < PACKETS; packet++) {
                take_sample(field, arrays, control, ambient, j, middle, weights[j], third, &rays[packet]);
            }
            middle += R(1.0);
        }
    }
}

// Compute the state at the end, half a step behind the last sample, in fourth order.
APART void land(const Control *control, real ambient, Flying *ray)
{
    const reals h = ray->path.h;
    reals square = (reals)R(0.0), slope = ray->ahead * ray->ahead;
#pragma unroll
    EACH(c) {
        ray->p[c] = ray->impulse[c];
        ray->q[c] = ray->sigma * ray->impulse[c] - ray->moment[c];
        ray->momentum_diff[c] += ray->impulse[c];
        ray->deviation_diff[c] = ray->sigma * ray->momentum_diff[c] - (ray->deviation_diff[c] + ray->moment[c]);
        square += ray->impulse[c] * ray->impulse[c];
        slope += ray->f[c] * ray->f[c];
    }
    const reals difference = fabs(h * ((R(2.0) * ray->paths - ambient * ray->deficits) - R(3.0) * ray->coarse));
    ray->error = max(difference * control->quadrature_error_scale, h * ray->bend * control->trajectory_error_scale);
    ray->s += R(0.5) * h * ray->ahead;
    ray->steep = sqrt(slope);
    ray->lead = (R(2.0) * ray->s - square) * ray->slowness / (R(1.0) / ray->slowness + ambient);
#if CUBES
    const reals each = h * ray->slowness;
    ray->path.off *= each;  // error of the path [m], of the direction, and its moment [m]
    ray->path.off_slope *= each;
    ray->path.off_moment *= h * each;
#endif
}

// A bound of the error from features between a ray's leapfrog samples: a table summed along its path, and one looked up
// at its ends (see aerokernels/tracing/tasks/unresolved.py).

// Block of the table along one of its axes; places are in cells.
static inline ints block_of(const Control *control, int axis, reals place)
{
    const reals block = place * (R(1.0) / (real)control->block);
    return TO_INTS(min(max(block, (reals)R(0.0)), (reals)((real)control->block_count[axis] - R(0.5))));
}

// Entry of the table at a place in cells.
static inline ints entry_at(const Control *control, reals x, reals y, reals z)
{
#if GEOMETRY == VOLUME
    const ints column = block_of(control, 0, x) * control->block_count[1] + block_of(control, 1, y);
    return column * control->block_count[2] + block_of(control, 2, z);
#elif GEOMETRY == PLANAR
    return block_of(control, 0, y) * control->block_count[1] + block_of(control, 1, z);
#else
    return block_of(control, 0, sqrt(x * x + y * y)) * control->block_count[1] + block_of(control, 1, z);
#endif
}

// A bound of the error of a ray's path [m]. The ray runs along its path for `length` metres, and ends q [m] beside that
// line. 0 without a table, infinite if the samples are further apart than the table is valid for.
static inline reals unresolved_of(
    const Field *field, const Arrays *arrays, const Control *control, const Path *path, reals length, const reals *q)
{
    if (arrays->step_bound_start[0] < 0) {
        return (reals)R(0.0);
    }
    const real3 rate = VECTOR(field->inverse_spacing);
    const reals x0 = path->x0, y0 = path->y0, z0 = path->z0, dx = path->dx, dy = path->dy, dz = path->dz;
    const reals qx = q[0], qy = q[1], qz = q[2];
    reals ahead = length * max(fabs(dy) * rate.y, fabs(dz) * rate.z);
    if (GEOMETRY != PLANAR) {
        ahead = max(ahead, length * fabs(dx) * rate.x);
    }
    const reals strides = ahead * (R(1.0) / (LOOKUP_STRIDE * (real)control->block));
    int count = 1;
    for (int lane = 0; lane < LANES; lane++) {
        count = max(count, (int)ceil(REAL_AT(strides, lane)));
    }
    reals sum = (reals)R(0.0);
    for (int k = 0; k < count; k++) {
        const real share = ((real)k + R(0.5)) / (real)count;
        const reals t = share * length;
        const real deflected = share * share;
        const reals x = x0 + (t * dx + deflected * qx) * rate.x, y = y0 + (t * dy + deflected * qy) * rate.y;
        const reals z = z0 + (t * dz + deflected * qz) * rate.z;
        const ints entry = entry_at(control, x, y, z);
        for (int lane = 0; lane < LANES; lane++) {
            REAL_AT(sum, lane) += arrays->step_bound[INT_AT(entry, lane)];
        }
    }
    reals missed = sum * length * (R(1.0) / (real)count);
    const int at_ends = arrays->step_bound_start[1];
    if (at_ends >= 0) {
        const ints first = entry_at(control, x0, y0, z0);
        const ints last = entry_at(
            control, x0 + (length * dx + qx) * rate.x, y0 + (length * dy + qy) * rate.y,
            z0 + (length * dz + qz) * rate.z);
        for (int lane = 0; lane < LANES; lane++) {
            REAL_AT(missed, lane) +=
                arrays->step_bound[at_ends + INT_AT(first, lane)] + arrays->step_bound[at_ends + INT_AT(last, lane)];
        }
    }
    const reals spacing = length * (R(1.0) / (real)control->sample_count);
    return CHOOSE(missed, (reals)INFINITY, spacing > R(1.001) * control->step);
}

// Error of the path [m] including that from the error of direction, if the ray meets its stop `onward` metres further
// on at this cosine with the stop's normal.
static inline reals with_lever_arm(const Field *field, reals missed, reals onward, reals cosine)
{
    const reals tangent = sqrt(max(R(1.0) - cosine * cosine, R(0.0))) / max(cosine, (real)LEAST_COSINE);
    return missed * (R(1.0) + MISSED_SLOPE * greatest(VECTOR(field->inverse_spacing)) * onward * tangent);
}

#endif
