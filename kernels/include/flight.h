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
    reals turn[ACROSS], moment[ACROSS];     // the momentum's sum with the ends mended; its moments about the start
    reals off[ACROSS], twist[ACROSS];       // how far those by every third sample are from them
    reals f[ACROSS];                        // slope of the potential across the ray
#pragma unroll
    EACH(c) {
        p[c] = q[c] = turn[c] = moment[c] = off[c] = twist[c] = f[c] = zero;
    }
    reals sigma = zero;                     // int 1 / w dt
    reals bend = zero;                      // of P^2 / w
    reals slow = (reals)(R(1.0) / ambient); // 1 / w, w the momentum along the ray
    reals paths = zero, paths_carry = zero; // sums of s / w, of (w - a) / w and of m / w
    reals deficits = zero, deficits_carry = zero;
    reals arcs = zero, arcs_carry = zero;
    reals coarse = zero, coarse_carry = zero; // of every third sample
    reals max_deflection = zero;
    reals s = zero, ahead = zero;           // of the last sample: the potential, its slope along the ray
    real middle = R(0.5);                   // of the sample's part of the way, in h
    for (int triple = 0; triple < triples; triple++) {
        reals optical = zero, longitudinal_deficit = zero, arc = zero;
        real weights[3];
        triple_weights(triple, triples, weights);
        const real third = quadrature_weight(triple, triples);
#pragma unroll
        for (int j = 0; j < 3; j++) {
            const reals half_step = R(0.5) * UNIT(h) * slow;
            s = sample_path(field, arrays, &path, middle, half_step, p, q, f, &ahead);
            middle += R(1.0);
            reals m[ACROSS], across = zero;
#pragma unroll
            EACH(c) {
                m[c] = p[c] + half_step * f[c];
                across += m[c] * m[c];
            }
            const reals deficit = longitudinal_deficit_of(ambient, R(2.0) * s - across, &slow);
            const reals pace = UNIT(h) * slow, kick = weights[j] * pace;
            optical += weights[j] * s * slow;
            longitudinal_deficit += weights[j] * deficit;
            if (control->outputs & WANT_ARC_LENGTH) {
                arc += weights[j] * slow * (R(2.0) * s / (sqrt(max(ambient * ambient + R(2.0) * s, zero)) + ambient));
            }
            const reals place = sigma + R(0.5) * pace, lever = kick * place;
            const reals lack = R(3.0) * third * pace, leverage = lack * place;
            if (j == 1) {
                gather(&coarse, &coarse_carry, third * (R(2.0) * s * slow - ambient * deficit));
            }
#pragma unroll
            EACH(c) {
                p[c] += pace * f[c];
                q[c] += pace * m[c];
                turn[c] += kick * f[c];
                moment[c] += lever * f[c];
                if (j == 1) {
                    off[c] -= lack * f[c];
                    twist[c] -= leverage * f[c];
                }
            }
            sigma += pace;
            bend += across * slow;
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
        q[c] = IN_METRES(h) * (sigma * turn[c] - moment[c]);
        off[c] += turn[c];
        twist[c] = IN_METRES(h) * (sigma * off[c] - (twist[c] + moment[c]));
        square += turn[c] * turn[c];
    }
    Flight out;
    s = last_sample(field, arrays, &path, s, f, &ahead, out.f) + R(0.5) * h * ahead;
    spread(&path, turn, out.p);
    spread(&path, q, out.q);
    spread(&path, off, out.off_turn);
    spread(&path, twist, out.off_place);
    const reals difference = fabs(h * ((R(2.0) * paths - ambient * deficits) - R(3.0) * coarse));
    out.h = h;
    out.slow = slow;
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
    out.lead = (R(2.0) * s - square) * slow / (R(1.0) / slow + ambient);
    return out;
}

#endif
