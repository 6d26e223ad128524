// Positions in cells, compensated sums, and the increments of a step. Warp's twin says why the deviation along d is
// summed as M - B.
#ifndef MOTION_H
#define MOTION_H

#include "constants.h"
#include "types.h"

// Add a term to Kahan's compensated sum.
static inline void advance3(real3 *total, real3 *carry, real3 term)
{
    const real3 y = term - *carry;
    const real3 s = *total + y;
    *carry = (s - *total) - y;
    *total = s;
}

static inline void advance4(real4 *total, real4 *carry, real4 term)
{
    const real4 y = term - *carry;
    const real4 s = *total + y;
    *carry = (s - *total) - y;
    *total = s;
}

// Change of the unit tangent from d when the momentum is ambient d + p, without cancellation.
static inline double3 deflection(double ambient, double3 d, double3 p)
{
    const double speed = size64(ambient * d + p);
    const double excess = (2.0 * ambient * dot(d, p) + dot(p, p)) / (speed + ambient);
    return (p - excess * d) / speed;
}

// Contrast from the potential, without cancellation.
static inline real contrast(real ambient, real potential)
{
    const real square = greater(ambient * ambient + R(2.0) * potential, R(0.0));
    return R(2.0) * potential / (sqrt(square) + ambient);
}

static inline real4 contrasts(real ambient, real4 potential)
{
    const real4 square = max(ambient * ambient + R(2.0) * potential, (real4)R(0.0));
    return R(2.0) * potential / (sqrt(square) + ambient);
}

// Index minus the momentum along d, |T|^2 - (T . d)^2 over the sum of both: second order if nearly straight.
static inline real longitudinal_deficit(real ambient, real3 d, real3 momentum, real potential)
{
    const real ahead = dot(momentum, d);
    const real3 across = momentum - ahead * d;
    return dot(across, across) / (R(2.0) * ambient + contrast(ambient, potential) + ahead);
}

// Increments of (sigma, S, M, B) over a step by the quadrature of the path; momentum, pot and force are those at its
// start. The four stages are the four lanes of a vector.
static inline real4 step_sums(
    real ambient, real3 d, real3 momentum, real h, real pot, real3 force, real4 s2, real4 s3, real4 s4)
{
    const real4 rule = (real4)(RKN_V1, RKN_V2, RKN_V3, RKN_V4);
    const real4 pots = (real4)(pot, s2.x, s3.x, s4.x);
    const real4 fx = (real4)(force.x, s2.y, s3.y, s4.y);
    const real4 fy = (real4)(force.y, s2.z, s3.z, s4.z);
    const real4 fz = (real4)(force.z, s2.w, s3.w, s4.w);
    const real4 second = (real4)(RKN_P1, RKN_P2, RKN_P3, RKN_P4);
    const real4 third = (real4)(RKN_Q1, RKN_Q2, RKN_Q3, RKN_Q4);
    const real4 px = momentum.x + h * (real4)(R(0.0), dot(second, fx), dot(third, fx), dot(rule, fx));
    const real4 py = momentum.y + h * (real4)(R(0.0), dot(second, fy), dot(third, fy), dot(rule, fy));
    const real4 pz = momentum.z + h * (real4)(R(0.0), dot(second, fz), dot(third, fz), dot(rule, fz));
    const real4 m = contrasts(ambient, pots);
    const real4 ahead = px * d.x + py * d.y + pz * d.z;
    const real4 qx = px - ahead * d.x, qy = py - ahead * d.y, qz = pz - ahead * d.z;
    const real4 deficits = (qx * qx + qy * qy + qz * qz) / (R(2.0) * ambient + m + ahead);
    return (real4)(h, h * dot(rule, pots), h * dot(rule, m), h * dot(rule, deficits));
}

// Increments over a flight along the tangent.
static inline real4 tangent_sums(real ambient, real3 d, real3 momentum, real back, real pot, real3 force)
{
    const real half_square = R(0.5) * back * back;
    const real climb = dot(force, ambient * d + momentum);
    const real m = contrast(ambient, pot);
    return (real4)(
        back,
        back * pot + half_square * climb,
        back * m + half_square * climb / (ambient + m),
        back * longitudinal_deficit(ambient, d, momentum, pot));
}

// Correction along T that brings the momentum back onto |T| = n.
static inline real3 project_momentum(real ambient, real3 d, real3 momentum, real pot)
{
    const real surplus = R(2.0) * pot - dot(momentum, R(2.0) * ambient * d + momentum);
    const real3 tangent = ambient * d + momentum;
    const real square = dot(tangent, tangent);
    const real root = sqrt(greater(square * (square + surplus), R(0.0)));
    return (surplus / (square + root)) * tangent;
}

// Whole cells of a position, zero along axes without cells of their own.
static inline int3 whole_cells(double3 place)
{
    const int3 floors = convert_int3(floor(place));
    return ON_MESH ? (int3)(0, 0, 0)
        : GEOMETRY == VOLUME ? floors
        : GEOMETRY == PLANAR ? (int3)(0, floors.y, floors.z)
        : (int3)(0, 0, floors.z);
}

// Split a point into whole cells and fractions of a cell, in float64.
static inline real3 in_cells(const Bounds *bounds, double3 p, int3 *cell)
{
    const double3 place = (p - VECTOR64(bounds->origin)) / VECTOR64(bounds->spacing);
    *cell = whole_cells(place);
    return convert_real3(place - convert_double3(*cell));
}

// Move whole cells from the fraction into the cell, exactly.
static inline void carry_over(int3 *cell, real3 *frac)
{
    const real3 floors = floor(*frac);
    const real3 moved = ON_MESH ? (real3)R(0.0)
        : GEOMETRY == VOLUME ? floors
        : GEOMETRY == PLANAR ? (real3)(R(0.0), floors.y, floors.z)
        : (real3)(R(0.0), R(0.0), floors.z);
    *cell += convert_int3(moved);
    *frac -= moved;
}

#endif
