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
    const reals reach = h * rate;                             // the same across the ray, at a slope of 1
    // Lengths along the ray and deviations are in h here, forces times h.
    reals p = zero, q = zero;                   // momentum across the ray, and deviation
    reals turn = zero, moment = zero;           // the momentum's sum with the ends mended; its moments about the start
    reals off_turn = zero, off_place = zero;    // how far those by every third sample are from them
    reals sigma = zero;                         // int 1 / w dt
    reals bend = zero;                          // of P^2 / w
    reals slow = (reals)(R(1.0) / ambient);     // 1 / w, w the momentum along the ray
    reals paths = zero, paths_carry = zero;     // sums of s / w, of (w - a) / w and of m / w
    reals deficits = zero, deficits_carry = zero;
    reals arcs = zero, arcs_carry = zero;
    reals coarse = zero, coarse_carry = zero;   // of every third sample
    reals greatest_deflection = zero;
    reals place = r0, along = z0;               // of the last sample, in cells
    const int triples = count / 3;
    real middle_of = R(0.5);                    // of the sample's part of the way, in h
#if AHEAD
    CellAhead now = cell_ahead(field, arrays, r0, z0 + R(0.5) * stride);
#endif
    for (int triple = 0; triple < triples; triple++) {
        reals path = zero, longitudinal_deficit = zero, arc = zero;
        real weights[3];
        triple_weights(triple, triples, weights);
        const real third = quadrature_weight(triple, triples);
#pragma unroll
        for (int j = 0; j < 3; j++) {
            const real weight = weights[j];
            const reals half_slow = R(0.5) * slow;
            along = z0 + middle_of * stride;
            middle_of += R(1.0);
            place = r0 + (q + half_slow * p) * reach;
            reals climb;
#if AHEAD
            // The next sample's cell is asked for now, where the ray will be but for this sample's push: no cell's polynomial
            // ends so abruptly that a hair beyond its face counts.
            const CellAhead after =
                cell_ahead(field, arrays, place + slow * p * reach, z0 + middle_of * stride);
            const reals s = sample_cell(&now, place, along, &climb);
            now = after;
#else
            const reals s = sample_along(field, arrays, place, along, &climb);
#endif
            const reals f = climb * reach;
            const reals here = p + half_slow * f;
            const reals across = here * here;
            const reals off = longitudinal_deficit_of(ambient, R(2.0) * s - across, &slow);
            const reals share = weight * slow;
            path += share * s;
            longitudinal_deficit += weight * off;
            if (control->outputs & WANT_ARC_LENGTH) {
                arc += share * (R(2.0) * s / (sqrt(max(ambient * ambient + R(2.0) * s, zero)) + ambient));
            }
            const reals middle = sigma + R(0.5) * slow;
            const reals kick = share * f;
            turn += kick;
            moment += kick * middle;
            if (j == 1) {
                gather(&coarse, &coarse_carry, third * (R(2.0) * s * slow - ambient * off));
                const reals lack = (R(3.0) * third) * slow * f;
                off_turn -= lack;
                off_place -= lack * middle;
            }
            p += slow * f;
            q += slow * here;
            sigma += slow;
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
    p = turn;
    q = h * (sigma * turn - moment);
    off_turn += turn;
    off_place = h * (sigma * off_turn - (off_place + moment));
    const Potential last = sample_packet(field, arrays, place * ex, place * ey, along);
    const reals ahead = last.z * dz;
    const reals s = last.value + R(0.5) * h * ahead;
    const reals off = (R(2.0) * s - p * p) * slow / (R(1.0) / slow + ambient);
    const reals difference = fabs(h * ((R(2.0) * paths - ambient * deficits) - R(3.0) * coarse));
    const Flight flight = {
        h, p * ex, p * ey, zero, q * ex, q * ey, zero, off_turn * ex, off_turn * ey, zero, off_place * ex, off_place * ey,
        zero, slow, paths, paths_carry, deficits, deficits_carry, arcs, arcs_carry,
        max(difference * control->quadrature_error_scale, h * bend * control->trajectory_error_scale),
        greatest_deflection, s, ahead, last.x, last.y, zero,
        sqrt(ahead * ahead + last.x * last.x + last.y * last.y), off};
    return flight;
}

#endif

#endif
