// Nearly straight rays of any direction, by leapfrog samples: one leapfrog step a sample.
#ifndef FLIGHT_H
#define FLIGHT_H

#include "flight_sums.h"

#if !IN_PLANE

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
    const real3 rate = VECTOR(field->inverse_spacing);
    const int count = control->sample_count;
    const reals h = length / (real)count;
    const reals zero = (reals)R(0.0);
    reals px = zero, py = zero, pz = zero;  // momentum across the ray
    reals qx = zero, qy = zero, qz = zero;  // deviation across it
    reals turnx = zero, turny = zero, turnz = zero;  // the momentum's sum with the ends mended
    reals momentx = zero, momenty = zero, momentz = zero;  // that of its moments about the start
    reals sigma = zero;  // int 1 / w dt
    reals bend = zero;  // of P^2 / w
    reals slow = (reals)(R(1.0) / ambient);  // 1 / w, w the momentum along the ray
    reals paths = zero, paths_carry = zero;  // sums of s / w, of (w - a) / w and of m / w
    reals deficits = zero, deficits_carry = zero;
    reals arcs = zero, arcs_carry = zero;
    reals coarse = zero, coarse_carry = zero;  // of every third sample
    reals offx = zero, offy = zero, offz = zero;  // how far its momentum is off, and that one's moments
    reals twistx = zero, twisty = zero, twistz = zero;
    reals greatest_deflection = zero;
    reals s = zero, ahead = zero;  // of the last sample: the potential, its slope along the ray, and that across it
    reals fx = zero, fy = zero, fz = zero;
    const int triples = count / 3;
    real middle_of = R(0.5);  // of the sample's part of the way, in h
    for (int triple = 0; triple < triples; triple++) {
        reals path = zero, longitudinal_deficit = zero, arc = zero;
        real weights[3];
        triple_weights(triple, triples, weights);
#pragma unroll
        for (int j = 0; j < 3; j++) {
            const real weight = weights[j];
            const reals t = middle_of * h;
            middle_of += R(1.0);
            const reals by_half = R(0.5) * h * slow;
            const Potential at = sample_packet(
                field, arrays, x0 + (t * dx + qx + by_half * px) * rate.x, y0 + (t * dy + qy + by_half * py) * rate.y,
                z0 + (t * dz + qz + by_half * pz) * rate.z);
            s = at.value;
            ahead = at.x * dx + at.y * dy + at.z * dz;
            fx = at.x - ahead * dx;
            fy = at.y - ahead * dy;
            fz = at.z - ahead * dz;
            const reals mx = px + by_half * fx, my = py + by_half * fy, mz = pz + by_half * fz;
            const reals across = mx * mx + my * my + mz * mz;
            const reals surplus = R(2.0) * s - across;
            const reals off = longitudinal_deficit_of(ambient, surplus, &slow);
            path += weight * s * slow;
            longitudinal_deficit += weight * off;
            if (control->outputs & WANT_ARC_LENGTH) {
                arc += weight * slow * (R(2.0) * s / (sqrt(max(ambient * ambient + R(2.0) * s, (reals)R(0.0))) + ambient));
            }
            const reals pace = h * slow;
            px += pace * fx;
            py += pace * fy;
            pz += pace * fz;
            qx += pace * mx;
            qy += pace * my;
            qz += pace * mz;
            const reals kick = weight * pace;
            const reals place = sigma + R(0.5) * pace;
            const reals moment = kick * place;
            if (j == 1) {
                const real third = quadrature_weight(triple, triples);
                gather(&coarse, &coarse_carry, third * (R(2.0) * s * slow - ambient * off));
                const reals lack = R(3.0) * third * pace;
                offx -= lack * fx;
                offy -= lack * fy;
                offz -= lack * fz;
                const reals leverage = lack * place;
                twistx -= leverage * fx;
                twisty -= leverage * fy;
                twistz -= leverage * fz;
            }
            turnx += kick * fx;
            turny += kick * fy;
            turnz += kick * fz;
            momentx += moment * fx;
            momenty += moment * fy;
            momentz += moment * fz;
            sigma += pace;
            bend += across * slow;
            greatest_deflection = max(greatest_deflection, across);
        }
        gather(&paths, &paths_carry, path);
        gather(&deficits, &deficits_carry, longitudinal_deficit);
        if (control->outputs & WANT_ARC_LENGTH) {
            gather(&arcs, &arcs_carry, arc);
        }
    }
    // At the end, half a step behind the last sample: what momentum and deviation are in fourth order.
    px = turnx;
    py = turny;
    pz = turnz;
    qx = sigma * turnx - momentx;
    qy = sigma * turny - momenty;
    qz = sigma * turnz - momentz;
    offx += turnx;
    offy += turny;
    offz += turnz;
    twistx = sigma * offx - (twistx + momentx);
    twisty = sigma * offy - (twisty + momenty);
    twistz = sigma * offz - (twistz + momentz);
    s += R(0.5) * h * ahead;
    const reals off = (R(2.0) * s - (px * px + py * py + pz * pz)) * slow / (R(1.0) / slow + ambient);
    const reals difference = fabs(h * ((R(2.0) * paths - ambient * deficits) - R(3.0) * coarse));
    const Flight flight = {
        h, px, py, pz, qx, qy, qz, offx, offy, offz, twistx, twisty, twistz, slow, paths, paths_carry, deficits,
        deficits_carry, arcs, arcs_carry,
        max(difference * control->quadrature_error_scale, h * bend * control->trajectory_error_scale),
        greatest_deflection, s, ahead, fx, fy, fz, sqrt(ahead * ahead + fx * fx + fy * fy + fz * fz), off};
    return flight;
}

#endif

#endif
