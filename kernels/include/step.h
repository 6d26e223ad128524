// A step of the tracer: its length, the field at its later stages, and whether it is accepted.
#ifndef STEP_H
#define STEP_H

#include "error.h"
#include "motion.h"
#include "step_bound.h"
#include "wall.h"
#if ON_MESH
#include "edges.h"
#else
#include "grid.h"
#endif

// The length of the next step.
static inline Stride stride(
    const Field *field,
    const Arrays *arrays,
    const Control *control,
    int current_cell,
    int cone,
    int3 cell,
    real3 frac,
    real3 total,
    real3 force,
    real index,
    real derating,
    real h_cell,
    real h_next,
    real h_cap,
    const StopGeometry *to_stop,
    real max_deflection,
    real used)
{
    Stride out;
    out.kinks = R(0.0);
    out.edge = -1;
    out.h = h_next;
    out.safe = R(0.0);
    out.stand_off = R(0.1) * FACE_TOLERANCE;
#if METHOD == FIXED
    out.h = control->step / index;
#elif METHOD == PAPER
    out.h = paper_step(field, arrays, cell, frac, current_cell) / index;
#else
    real limit = control->step_limit * h_cell;
    if (PIECEWISE_SMOOTH) {
        // The interpolant has kinks at the cells' faces, so no step crosses one. On a linear grid the ray flies the
        // rest along the tangent (rest_to_face); on a monotone grid a face nearer than the distance to keep from faces
        // counts as reached.
        const real3 rate = VECTOR(field->inverse_spacing), velocity = total * rate, acceleration = force * rate;
        if (INTERPOLATION == LINEAR) {
            // How far before a face to stop, in cells: a share of the bend over a cell, because the parabola leaves out
            // that the bend changes over the step.
            const real bend = R(0.15) * size3(acceleration) / dot(velocity, velocity);
            out.stand_off = R(0.1) * FACE_TOLERANCE + lesser(bend, GREATEST_STAND_OFF);
        }
        const real close = INTERPOLATION == LINEAR ? AT_FACE : R(10.0) * out.stand_off;
        const real face = to_face(frac, velocity, acceleration, close);
        limit = greater(face - out.stand_off / size3(velocity), R(0.5) * face);
    }
#if ON_MESH
    if (current_cell >= 0) {
        const real3 curve = IS_STRAIGHT ? (real3)R(0.0) : force;
        return step_to_edge(
            field, arrays, control, current_cell, frac, total, curve, index, lesser(h_next, h_cap), limit, to_stop,
            max_deflection, used);
    }
#endif
    // End before the face at which the first block that is not smooth may begin.
    out.safe = derating * step_bound_of(control, arrays, cone, cell, frac, total) - R(10.0) * FACE_TOLERANCE * h_cell;
    out.h = lesser(out.h, greater(limit, out.safe));
#endif
    out.h = lesser(out.h, h_cap);
    return out;
}

// Rest [sigma] to the face `stand_off` cells before which a step of length h stopped; 0 if it did not.
static inline real rest_to_face(real3 frac, real3 velocity, real3 acceleration, real stand_off, real h)
{
    const real rest = to_face(frac, velocity, acceleration, R(0.0));
    return rest <= h && rest * size3(velocity) <= R(4.0) * stand_off ? rest : R(0.0);
}

// The field at a stage; on a straight line it is linear in the deviation from the line.
static inline real4 sample_at_stage(
    const Field *field,
    const Arrays *arrays,
    int current_cell,
    int3 cell,
    real3 frac,
    real3 rate,
    real h,
    real3 total,
    real3 momentum,
    real3 q,
    real3 kick)
{
#if IS_STRAIGHT
    real4 s = sample(field, arrays, cell, frac + h * (total * rate), current_cell);
    s.x += dot(FORCE(s), q + h * momentum + kick);
    return s;
#else
    return sample(field, arrays, cell, frac + (h * total + kick) * rate, current_cell);
#endif
}

// Time between the line's and the ray's crossings of a face whose normal is along `jump`; at most h_cell.
static inline real time_apart(real3 jump, real3 total, real3 q, real h_cell)
{
    const real aside = fabs(dot(jump, q)), pace = fabs(dot(jump, total));
    return aside < h_cell * pace ? aside / pace : h_cell * (real)(aside > R(0.0));
}

// What the linear field along a straight line neglects at the end of a step: the optical path [m] and, by `turn`, the
// momentum that the field at the ray's own place would change. The ray is q beside the line, where `pot` is continued.
// Where slopes jump at faces, the ray crosses a face before the line or behind it, so that both sides of the line
// count. On a linear grid every step ends at a face: a jump, which is normal to its face, counts only for the time
// between the two crossings.
APART real sample_neglected(
    const Field *field, const Arrays *arrays, int current_cell, int3 cell, real3 frac, real3 rate, real3 total, real3 q,
    real pot, real3 force, real h, real h_cell, real *turn)
{
    const real4 there = sample(field, arrays, cell, frac + q * rate, current_cell);
    const real3 change = FORCE(there) - force;
    real path = h * fabs(there.x - pot);
    *turn = h * size3(change);
    if (INTERPOLATION != CUBIC) {
        const real4 opposite = sample(field, arrays, cell, frac - q * rate, current_cell);
        const real3 other = FORCE(opposite) - force;
        if (INTERPOLATION == LINEAR) {
            const real other_path = h * fabs(opposite.x - (pot - R(2.0) * dot(force, q)));
            const real3 jump = size3(other) > size3(change) ? other : change;
            const real3 along = (real3)(R(0.0), R(0.0), jump.z);
            const real3 first = (real3)(jump.x, GEOMETRY == VOLUME ? R(0.0) : jump.y, R(0.0));
            const real3 second = jump - along - first;
            const real time1 = time_apart(first, total, q, h_cell), time2 = time_apart(second, total, q, h_cell);
            const real time3 = time_apart(along, total, q, h_cell);
            const real share = greater(greater(time1, time2), time3) / h_cell;
            path = lesser(path, other_path) + share * greater(path, other_path);
            *turn = lesser(*turn, h * size3(other)) + time1 * size3(first) + time2 * size3(second) + time3 * size3(along);
        } else {
            *turn = greater(*turn, h * size3(other));
        }
    }
    return R(2.0) * path;
}

// h^2 times the mean force.
static inline real3 kick_of(real h, real3 force, real4 s2, real4 s3)
{
    return (h * h) * (RKN_B1 * force + RKN_B2 * FORCE(s2) + RKN_B3 * FORCE(s3));
}

// Increment of the momentum over a step.
static inline real3 impulse_of(real h, real3 force, real4 s2, real4 s3, real4 s4)
{
    return h * (RKN_V1 * force + RKN_V2 * FORCE(s2) + RKN_V3 * FORCE(s3) + RKN_V4 * FORCE(s4));
}

// Rate of change of the force at the end of a step.
static inline real3 force_rate_of(real h, real3 force, real4 s3, real4 s4)
{
    return (RKN_R1 * force + RKN_R3 * FORCE(s3) + RKN_R4 * FORCE(s4)) / greater(h, TINY);
}

// Whether a step with this error, and that by kinks on a mesh, is accepted; `ratio` is the ratio of the next step's length to this.
static inline int step_acceptance(
    real limit,
    real error,
    real bend,
    real rounding,
    real used,
    real h,
    real h_cell,
    real h_least,
    real index,
    real reach,
    real *ratio)
{
    const real left = greater(limit - used, R(0.0));
    real allowed = greater(STEP_SHARE * left, limit * h * index / reach);
    if (h <= NOISE_STEP * h_cell) {
        allowed = greater(allowed, rounding);
    }
    if (ON_MESH) {
        error += bend * lesser(allowed / (limit * bend_share(allowed / limit)), R(1.0));
    }
    *ratio = R(4.0);
    if (error > R(0.0)) {
        *ratio = bounded(R(0.9) * sqrt(sqrt(allowed / error)), R(0.2), R(4.0));
    }
    return (error <= allowed && isfinite(error)) || h <= h_least;
}

#endif
