// The length of a step on a uniform grid: the table of step bounds, and the faces of cells. Warp's twin is
// aerokernels/tracing/engines/warp/kernels/step_bound.py.
#ifndef STEP_BOUND_H
#define STEP_BOUND_H

#include "constants.h"
#include "types.h"

// Longer than any step.
#define NO_STEP R(1e30)

// Number of the direction's cone in step_bound.CONES.
static inline int cone_of(double3 d)
{
    int axis = 0;
    if (fabs(d.y) > fabs(d.x)) {
        axis = 1;
    }
    if (fabs(d.z) > greater64(fabs(d.x), fabs(d.y))) {
        axis = 2;
    }
    if (GEOMETRY == AXISYMMETRIC ? axis < 2 : GEOMETRY == PLANAR ? axis < 1 : 0) {
        return 0;
    }
    const double ahead = pick64(d, axis);
    const double square = dot(d, d) - ahead * ahead;
    if (square > WIDE_SQUARE) {
        return 0;
    }
    return 1 + 4 * axis + (ahead < 0.0 ? 2 : 0) + (square > NARROW_SQUARE ? 1 : 0);
}

static inline int step_bound_block(const Control *control, int axis, int cell, real place)
{
    const int whole = cell + (int)floor(place);
    // Blocks before the first are clamped to it, so it does not matter that the quotient is rounded toward zero.
    return clamp(whole / control->block, 0, control->block_count[axis] - 1);
}

// Step bound at a point [sigma]. Zero where there is none: on a mesh, and for a ray that has turned out of the cone in
// which it started.
static inline real step_bound_of(
    const Control *control, const Arrays *arrays, int cone, int3 cell, real3 frac, real3 total)
{
#if ON_MESH
    return R(0.0);
#else
    const int start = arrays->step_bound_start[cone];
    if (start < 0) {
        return R(0.0);
    }
    const real speed = size3(total);
    if (cone > 0) {
        const real along = pick(total, (cone - 1) / 4);
        const real ahead = ((cone - 1) / 2) % 2 == 1 ? -along : along;
        const real cosine = (cone - 1) % 2 == 1 ? WIDE_COSINE : NARROW_COSINE;
        if (ahead < cosine * speed) {
            return R(0.0);
        }
    }
#if GEOMETRY == VOLUME
    int entry = step_bound_block(control, 0, cell.x, frac.x) * control->block_count[1];
    entry = (entry + step_bound_block(control, 1, cell.y, frac.y)) * control->block_count[2];
    entry += step_bound_block(control, 2, cell.z, frac.z);
#elif GEOMETRY == PLANAR
    int entry = step_bound_block(control, 0, cell.y, frac.y) * control->block_count[1];
    entry += step_bound_block(control, 1, cell.z, frac.z);
#else
    const real radius = sqrt(frac.x * frac.x + frac.y * frac.y);
    int entry = step_bound_block(control, 0, 0, radius) * control->block_count[1];
    entry += step_bound_block(control, 1, cell.z, frac.z);
#endif
    return arrays->step_bound[start + entry] / speed;
#endif
}

// First t > 0 with speed t + acceleration t^2 / 2 = gap, for gap > 0.
static inline real meet_face(real gap, real speed, real acceleration)
{
    const real disc = speed * speed + R(2.0) * acceleration * gap;
    const real toward = speed + sqrt(greater(disc, R(0.0)));
    return disc < R(0.0) || toward <= R(0.0) ? NO_STEP : R(2.0) * gap / toward;
}

// Step to the next face along an axis with faces at whole numbers.
static inline real flat_face(real place, real speed, real acceleration, real face_tolerance)
{
    real behind = place - floor(place);
    real ahead = R(1.0) - behind;
    if (ahead < face_tolerance) {
        ahead += R(1.0);
    }
    if (behind < face_tolerance) {
        behind += R(1.0);
    }
    return lesser(meet_face(ahead, speed, acceleration), meet_face(behind, -speed, -acceleration));
}

// Step to the next cylinder of whole radius R: (r^2 - R^2) / 2 along the parabola without the quartic term.
static inline real round_face(real3 frac, real3 velocity, real3 acceleration, real face_tolerance)
{
    const real square = frac.x * frac.x + frac.y * frac.y;
    const real b = frac.x * velocity.x + frac.y * velocity.y;
    const real a = velocity.x * velocity.x + velocity.y * velocity.y;
    const real c = a + frac.x * acceleration.x + frac.y * acceleration.y;
    const real radius = sqrt(square);
    const real close = face_tolerance + RADIUS_NOISE * radius;
    real inner = floor(radius);
    if (radius - inner < close) {
        inner -= R(1.0);
    }
    const real outer = floor(radius + close) + R(1.0);
    real step = meet_face(R(0.5) * (outer - radius) * (outer + radius), b, c);
    if (inner > R(0.0)) {
        step = lesser(step, meet_face(R(0.5) * (radius - inner) * (radius + inner), -b, -c));
    } else if (radius > AXIS_CORE && b < -AXIS_CORE * sqrt(a)) {
        step = lesser(step, -b / a);  // to where the ray is nearest to the axis: a kink if it meets the axis
    }
    return step;
}

// Along one axis, the push [cells] that brings a ray in a face to the side to which it flies.
static inline real push_off_flat_face(real place, real speed)
{
    const real push = speed < R(0.0) ? -R(2.0) * AT_FACE : R(2.0) * AT_FACE;
    return fabs(place - floor(place + R(0.5))) < AT_FACE ? push : R(0.0);
}

// The push off a cylindrical face of an axisymmetric grid.
static inline real3 push_off_round_face(real3 frac, real3 velocity)
{
    const real radius = sqrt(frac.x * frac.x + frac.y * frac.y);
    const real close = AT_FACE + RADIUS_NOISE * radius;
    if (fabs(radius - floor(radius + R(0.5))) >= close || radius <= AXIS_CORE) {
        return (real3)R(0.0);
    }
    const real sense = frac.x * velocity.x + frac.y * velocity.y < R(0.0) ? R(-1.0) : R(1.0);
    return (sense * R(2.0) * close / radius) * (real3)(frac.x, frac.y, R(0.0));
}

// The push to the other side of all faces in which a ray is. A small step along a ray that grazes a face would not
// bring it there.
static inline real3 push_off_faces(real3 frac, real3 velocity)
{
    real3 push = (real3)R(0.0);
    if (GEOMETRY == AXISYMMETRIC) {
        push = push_off_round_face(frac, velocity);
    } else {
        push.y = push_off_flat_face(frac.y, velocity.y);
    }
    if (GEOMETRY == VOLUME) {
        push.x = push_off_flat_face(frac.x, velocity.x);
    }
    push.z = push_off_flat_face(frac.z, velocity.z);
    return push;
}

// The potential at a ray, from the potential and the slope that are looked up a push beside it.
static inline real before_push(real pot, real3 force, real3 push, real3 rate)
{
    pot -= push.y * force.y / rate.y + push.z * force.z / rate.z;
    if (GEOMETRY != PLANAR) {
        pot -= push.x * force.x / rate.x;
    }
    return pot;
}

// Step to the next face of a cell farther than face_tolerance; velocity and its derivative are in cells.
static inline real to_face(real3 frac, real3 velocity, real3 acceleration, real face_tolerance)
{
    real step = flat_face(frac.z, velocity.z, acceleration.z, face_tolerance);
    if (GEOMETRY == VOLUME) {
        step = lesser(step, flat_face(frac.x, velocity.x, acceleration.x, face_tolerance));
    }
    if (GEOMETRY != AXISYMMETRIC) {
        step = lesser(step, flat_face(frac.y, velocity.y, acceleration.y, face_tolerance));
    } else {
        step = lesser(step, round_face(frac, velocity, acceleration, face_tolerance));
    }
    return step;
}

#endif
