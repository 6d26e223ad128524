// Moves nearly straight rays by leapfrog samples: one leapfrog step per sample.
#ifndef FLIGHT_H
#define FLIGHT_H

#include "flight_path.h"
#include "flight_sums.h"

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

#endif
