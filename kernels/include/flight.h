// Nearly straight rays by leapfrog samples: one leapfrog step a sample.
#ifndef FLIGHT_H
#define FLIGHT_H

#include "flight_path.h"
#include "flight_sums.h"

#define EACH(c) for (int c = 0; c < ACROSS; c++)

// From (x0, y0, z0), in cells from the grid's first node (x, y from the axis), along (dx, dy, dz) for `length` metres.
static inline Flight fly(
    const Field *field,
    const Arrays *arrays,
    const Control *control,
    real ambient,
    reals x0,
    reals y0,
    reals z0,
    reals dx,
    reals dy,
    reals dz,
    reals length)
{
    const int count = control->sample_count, triples = count / 3;
    const reals h = length / (real)count;
    const reals zero = (reals)R(0.0);
    Path path = path_of(field, arrays, x0, y0, z0, dx, dy, dz, h);
    reals p[ACROSS], q[ACROSS];             // momentum across the ray, and deviation
    reals impulse[ACROSS], moment[ACROSS];  // the end-corrected sum of the momentum; its moments about the start
    // Their differences from the sums over every third sample.
    reals momentum_diff[ACROSS], deviation_diff[ACROSS];
    reals f[ACROSS];                        // slope of the potential across the ray
#pragma unroll
    EACH(c) {
        p[c] = q[c] = impulse[c] = moment[c] = momentum_diff[c] = deviation_diff[c] = f[c] = zero;
    }
    reals sigma = zero;                     // int 1 / w dt
    reals bend = zero;                      // of P^2 / w
    reals slowness = (reals)(R(1.0) / ambient);  // 1 / w, w the momentum along the ray
    reals paths = zero, paths_carry = zero; // sums of s / w, of (w - a) / w and of m / w
    reals deficits = zero, deficits_carry = zero;
    reals arcs = zero, arcs_carry = zero;
    reals coarse = zero, coarse_carry = zero; // of every third sample
    reals max_deflection = zero;
    reals s = zero, ahead = zero;           // of the last sample: the potential, its slope along the ray
    real middle = R(0.5);                   // place of the sample along the ray, in h
    for (int triple = 0; triple < triples; triple++) {
        reals optical = zero, longitudinal_deficit = zero, arc = zero;
        real weights[3];
        triple_weights(triple, triples, weights);
        const real third = quadrature_weight(triple, triples);
#pragma unroll
        for (int j = 0; j < 3; j++) {
            const reals half_step = R(0.5) * UNIT(h) * slowness;
            s = sample_path(field, arrays, &path, middle, half_step, p, q, f, &ahead);
            middle += R(1.0);
            reals m[ACROSS], across = zero;
#pragma unroll
            EACH(c) {
                m[c] = p[c] + half_step * f[c];
                across += m[c] * m[c];
            }
            const reals deficit = longitudinal_deficit_of(ambient, R(2.0) * s - across, &slowness);
            const reals pace = UNIT(h) * slowness, kick = weights[j] * pace;
            optical += weights[j] * s * slowness;
            longitudinal_deficit += weights[j] * deficit;
            if (control->outputs & WANT_ARC_LENGTH) {
                const reals index = sqrt(max(ambient * ambient + R(2.0) * s, zero));
                arc += weights[j] * slowness * (R(2.0) * s / (index + ambient));
            }
            const reals place = sigma + R(0.5) * pace, moment_kick = kick * place;
            const reals lack = R(3.0) * third * pace, moment_lack = lack * place;
            if (j == 1) {
                gather(&coarse, &coarse_carry, third * (R(2.0) * s * slowness - ambient * deficit));
            }
#pragma unroll
            EACH(c) {
                p[c] += pace * f[c];
                q[c] += pace * m[c];
                impulse[c] += kick * f[c];
                moment[c] += moment_kick * f[c];
                if (j == 1) {
                    momentum_diff[c] -= lack * f[c];
                    deviation_diff[c] -= moment_lack * f[c];
                }
            }
            sigma += pace;
            bend += across * slowness;
            max_deflection = max(max_deflection, across);
        }
        gather(&paths, &paths_carry, optical);
        gather(&deficits, &deficits_carry, longitudinal_deficit);
        if (control->outputs & WANT_ARC_LENGTH) {
            gather(&arcs, &arcs_carry, arc);
        }
    }
    // At the end, half a step behind the last sample: what momentum and deviation are in fourth order.
    reals square = zero;
#pragma unroll
    EACH(c) {
        q[c] = IN_METRES(h) * (sigma * impulse[c] - moment[c]);
        momentum_diff[c] += impulse[c];
        deviation_diff[c] = IN_METRES(h) * (sigma * momentum_diff[c] - (deviation_diff[c] + moment[c]));
        square += impulse[c] * impulse[c];
    }
    Flight out;
    s = last_sample(field, arrays, &path, s, f, &ahead, out.f) + R(0.5) * h * ahead;
    spread(&path, impulse, out.p);
    spread(&path, q, out.q);
    spread(&path, momentum_diff, out.momentum_diff);
    spread(&path, deviation_diff, out.deviation_diff);
    const reals difference = fabs(h * ((R(2.0) * paths - ambient * deficits) - R(3.0) * coarse));
    out.h = h;
    out.slowness = slowness;
    out.paths = paths;
    out.paths_carry = paths_carry;
    out.deficits = deficits;
    out.deficits_carry = deficits_carry;
    out.arcs = arcs;
    out.arcs_carry = arcs_carry;
    out.error = max(difference * control->quadrature_error_scale, h * bend * control->trajectory_error_scale);
    out.max_deflection = max_deflection;
    out.s = s;
    out.ahead = ahead;
    out.steep = sqrt(ahead * ahead + out.f[0] * out.f[0] + out.f[1] * out.f[1] + out.f[2] * out.f[2]);
    out.lead = (R(2.0) * s - square) * slowness / (R(1.0) / slowness + ambient);
#if CUBES
    const reals each = h * slowness;
    out.off = each * path.off;
    out.off_slope = each * path.off_slope;
    out.off_moment = h * each * path.off_moment;
#endif
    return out;
}

#endif
