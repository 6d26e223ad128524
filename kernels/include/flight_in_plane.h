// Nearly straight rays along z in a plane that holds the field's axis, or along z in a planar field: what across them is a
// plane's second direction elsewhere has one component here, the distance from the axis (y in a planar field), and only
// the slope along it moves the ray.
#ifndef FLIGHT_IN_PLANE_H
#define FLIGHT_IN_PLANE_H

#include "flight_sums.h"

#if IN_PLANE

// As fly() of flight.h; dx and dy are 0.
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
    const real rate = field->inverse_spacing[1];
    const int count = control->sample_count;
    const reals h = length / (real)count;
    const reals zero = (reals)R(0.0);
#if GEOMETRY == AXISYMMETRIC
    const reals r0 = sqrt(x0 * x0 + y0 * y0);
    const reals ex = CHOOSE((reals)R(1.0), x0 / r0, r0 > R(0.0)), ey = CHOOSE(zero, y0 / r0, r0 > R(0.0));
#else
    const reals r0 = y0;
    const reals ex = zero, ey = (reals)R(1.0);
#endif
    const reals stride = h * dz * field->inverse_spacing[2];  // cells between samples
    reals p = zero, q = zero;                                 // momentum across the ray, and deviation
    reals turn = zero, arm = zero;                            // the momentum's sum with the ends mended; its moments
    reals off_turn = zero, off_place = zero;                  // how far those by every third sample are from them
    reals sigma = zero;                                       // int 1 / w dt
    reals bend = zero;                                        // of P^2 / w
    reals slow = (reals)(R(1.0) / ambient);                   // 1 / w, w the momentum along the ray
    reals paths = zero, paths_carry = zero;                   // sums of s / w, of (w - a) / w and of m / w
    reals lags = zero, lags_carry = zero;
    reals arcs = zero, arcs_carry = zero;
    reals coarse = zero, coarse_carry = zero;  // of every third sample
    reals bent = zero;
    reals place = r0, along = z0;  // of the last sample, in cells
    const int triples = count / 3;
    for (int triple = 0; triple < triples; triple++) {
        reals path = zero, lag = zero, arc = zero;
#pragma unroll
        for (int j = 0; j < 3; j++) {
            const int k = 3 * triple + j;
            const real weight = even_weight(k, count);
            const reals by_half = R(0.5) * h * slow;
            along = z0 + ((real)k + R(0.5)) * stride;
            place = r0 + (q + by_half * p) * rate;
            reals climb;
            const reals s = sample_along(field, arrays, place, along, &climb);
            const reals f = climb * rate;
            const reals here = p + by_half * f;
            const reals across = here * here;
            const reals off = lag_of(ambient, R(2.0) * s - across, &slow);
            path += weight * s * slow;
            lag += weight * off;
#if WANT_ARC_LENGTH
            arc += weight * slow * (R(2.0) * s / (sqrt(max(ambient * ambient + R(2.0) * s, zero)) + ambient));
#endif
            const reals pace = h * slow;
            p += pace * f;
            q += pace * here;
            const reals middle = sigma + R(0.5) * pace;
            const reals kick = weight * pace * f;
            turn += kick;
            arm += kick * middle;
            if (j == 1) {
                const real third = even_weight(triple, triples);
                gather(&coarse, &coarse_carry, third * (R(2.0) * s * slow - ambient * off));
                const reals lack = R(3.0) * third * pace * f;
                off_turn -= lack;
                off_place -= lack * middle;
            }
            sigma += pace;
            bend += across * slow;
            bent = max(bent, across);
        }
        gather(&paths, &paths_carry, path);
        gather(&lags, &lags_carry, lag);
        gather(&arcs, &arcs_carry, arc);
    }
    // At the end, half a step behind the last sample: what momentum and deviation are in fourth order.
    p = turn;
    q = sigma * turn - arm;
    off_turn += turn;
    off_place = sigma * off_turn - (off_place + arm);
    const Potential last = sample_packet(field, arrays, place * ex, place * ey, along);
    const reals ahead = last.z * dz;
    const reals s = last.value + R(0.5) * h * ahead;
    const reals off = (R(2.0) * s - p * p) * slow / (R(1.0) / slow + ambient);
    const reals difference = fabs(h * ((R(2.0) * paths - ambient * lags) - R(3.0) * coarse));
    const Flight flight = {
        h, p * ex, p * ey, zero, q * ex, q * ey, zero, off_turn * ex, off_turn * ey, zero, off_place * ex, off_place * ey,
        zero, slow, paths, paths_carry, lags, lags_carry, arcs, arcs_carry,
        max(difference * control->even_share, h * bend * control->bend_share), bent, s, ahead, last.x, last.y, zero,
        sqrt(ahead * ahead + last.x * last.x + last.y * last.y), off};
    return flight;
}

#endif

#endif
