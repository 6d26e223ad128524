// Steps through a mesh and the edges between its cells, where the slope of the potential jumps. Warp's twin is
// aerokernels/tracing/engines/warp/kernels/edges.py, which says what the functions compute.
#ifndef EDGES_H
#define EDGES_H

#include "error.h"
#include "mesh.h"

#define NO_EDGE R(1e30)

// The second corner of an edge; the first has the edge's number.
static inline real2 edge_end(const Arrays *arrays, int edge)
{
    return corner(arrays, edge % 4 < 3 ? edge + 1 : edge - 3);
}

// Time [sigma], not before `first`, at which a ray comes within `stand_off` [m] of leaving its cell through an edge.
static inline real edge_time(
    const Field *field, const Arrays *arrays, int edge, real3 frac, real3 velocity, real3 force, real first,
    real stand_off)
{
    const real2 a = corner(arrays, edge);
    const real2 side = edge_end(arrays, edge) - a;
    const real inside = stand_off * size2(side);
    real best = NO_EDGE;
#if GEOMETRY == PLANAR
    const real left = side.x * (frac.z - a.y) - side.y * (frac.y - a.x) - inside;
    const real rise = side.x * velocity.z - side.y * velocity.y;
    const real bend = R(0.5) * (side.x * force.z - side.y * force.y);
    const real square = rise * rise - R(4.0) * bend * left;
    if (left + first * (rise + first * bend) < R(0.0) && rise + R(2.0) * first * bend < R(0.0)) {
        best = first;  // it is just behind the edge
    } else if (square >= R(0.0)) {
        const real w = rise < R(0.0) ? R(0.5) * (sqrt(square) - rise) : R(-0.5) * (rise + sqrt(square));
        const real t = rise < R(0.0) ? left / w : (bend < R(0.0) ? w / bend : NO_EDGE);
        best = t >= first ? t : NO_EDGE;
    }
#else
    const real r = size2(frac.xy), e = side.y;
    const real c = side.x * (frac.z - a.y) + e * a.x - inside, b = side.x * velocity.z;
    const real s1 = frac.x * velocity.x + frac.y * velocity.y;
    const real s2 = velocity.x * velocity.x + velocity.y * velocity.y;
    const real q0 = (c - e * r) * (c + e * r), q1 = c * b - e * e * s1, q2 = b * b - e * e * s2;
    const real spin = e * (frac.x * velocity.y - frac.y * velocity.x);
    const real2 apart = (real2)(b * frac.x - c * velocity.x, b * frac.y - c * velocity.y);
    const real square = dot(apart, apart) - spin * spin;
    const real r_first = sqrt(greater(r * r + first * (R(2.0) * s1 + first * s2), R(0.0)));
    // The difference of the squares has the same rounding as their roots below.
    const real apart_first = (q0 + first * (R(2.0) * q1 + first * q2)) * (c + b * first + e * r_first);
    if (apart_first < R(0.0) && b * r_first < e * (s1 + s2 * first)) {
        best = first;  // it is just behind the edge
    } else if (square >= R(0.0)) {
        const real w = -(q1 + (q1 < R(0.0) ? R(-1.0) : R(1.0)) * fabs(e) * sqrt(square));
        for (int k = 0; k < 2; k++) {
            const real below = k == 0 ? q2 : w, above = k == 0 ? w : q0;
            if (below != R(0.0)) {
                const real t = above / below;
                const real there = sqrt(greater(r * r + t * (R(2.0) * s1 + t * s2), R(0.0)));
                const real outward = e * (s1 + s2 * t) / greater(there, TINY);
                if ((c + b * t) * e >= R(0.0) && b < outward && t >= first && t < best) {
                    best = t;
                }
            }
        }
    }
#endif
    return best;
}

// The next step: up to the last edge that it may end at, at most `longest` [sigma].
static Stride step_to_edge(
    const Field *field,
    const Arrays *arrays,
    const Control *control,
    int current_cell,
    real3 frac,
    real3 total,
    real3 force,
    real index,
    real longest,
    real gap,
    const StopGeometry *to_stop,
    real max_deflection,
    real used)
{
    Stride out;
    out.h = R(0.0);
    out.safe = R(0.0);
    out.stand_off = R(0.0);
    out.kinks = R(0.0);
    out.edge = -1;
    const real arm = bend_arm(to_stop, max_deflection);
    const real share = STEP_SHARE * greater(R(1.0) - used / control->tolerance, R(0.0));
    const real near = field->edge_tolerance / size3(total);
    int cell = current_cell;
    real t = R(0.0), kinks = R(0.0);
    for (int count = 0; count < EDGES_PASSED && cell >= 0; count++) {
        real leaves = NO_EDGE;
        int edge = -1;
        for (int k = 0; k < 4; k++) {
            const real found = edge_time(field, arrays, 4 * cell + k, frac, total, force, t - near, R(0.0));
            if (found < leaves) {
                leaves = found;
                edge = 4 * cell + k;
            }
        }
        const int beyond = edge >= 0 ? arrays->neighbors[edge] : -1;
        leaves = edge >= 0 ? greater(leaves, t) : t;
        // Just beyond the mesh, so that the next step begins in the gap: a longer one might fly over a hole of a cell.
        const real h = lesser(beyond >= 0 ? leaves : leaves + R(0.05) * gap, longest);
        if (count > 0) {
            const real part = greater(share, h * index / to_stop->reach);
            const real bend = R(2.0) * KINK_SHARE * h * kinks * arm + KINK_PATH * h * h * kinks * field->ambient;
            if (!KINKS_PASSED || bend > control->tolerance * bend_share(part)) {
                break;
            }
        }
        out.h = h;
        out.kinks = kinks;
        out.edge = beyond >= 0 && leaves <= longest ? edge : -1;
        cell = out.edge >= 0 ? beyond : -1;
        t = leaves;
        kinks = edge >= 0 ? size2((real2)(kinks, arrays->kinks[edge])) : kinks;
    }
    if (out.edge >= 0) {
        // On the parabola, as far before the edge as it leaves out that the force changes over the step.
        const real stand_off = EDGE_STAND_OFF * size3(force) * out.h * out.h;
        const real3 bent = GEOMETRY == PLANAR ? total : total + (R(0.5) * out.h) * force;
        const real h = edge_time(field, arrays, out.edge, frac, bent, force, R(0.5) * out.h, stand_off);
        out.h = h < R(1.5) * out.h ? lesser(h, longest) : out.h;
    }
    return out;
}

// Rest [sigma] to the edge before which a step of length h stopped; -1 if it is too long to fly it at this force.
static inline real rest_to_edge(
    const Field *field, const Arrays *arrays, int edge, real3 frac, real3 velocity, real3 force, real h)
{
    const real near = field->edge_tolerance / size3(velocity);
    real rest = edge_time(field, arrays, edge, frac, velocity, force, -near, R(0.0));
    if (GEOMETRY == AXISYMMETRIC && rest <= h) {
        rest = edge_time(field, arrays, edge, frac, velocity + (R(0.5) * rest) * force, force, -near, R(0.0));
    }
    return rest <= R(0.1) * h + near ? greater(rest, R(0.0)) : R(-1.0);
}

// Momentum that a ray may gain because the place where it crosses an edge is rounded; at most over a length h.
static inline real edge_rounding(
    const Field *field, const Arrays *arrays, int edge, real3 frac, real3 velocity, real h)
{
    const real2 side = edge_end(arrays, edge) - corner(arrays, edge);
#if GEOMETRY == PLANAR
    const real2 along = velocity.yz;
#else
    const real outward = (frac.x * velocity.x + frac.y * velocity.y) / greater(size2(frac.xy), TINY);
    const real2 along = (real2)(outward, velocity.z);
#endif
    const real pace = fabs(side.x * along.y - side.y * along.x) / size2(side);
    const real late = EDGE_ROUNDING * field->edge_tolerance;
    return arrays->kinks[edge] * (late < h * pace ? late / pace : h);
}

#endif
