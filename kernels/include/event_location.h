// Functions that end a ray on a face of its box, on a plane, or at an arc length.
//
// The step is shortened to where its parabola first meets a surface, by the root of the quadratic. The rest, of third
// order in the step, is flown along the parabola at the step's end. A ray that grazes a surface may be close to it and
// still far from the place where it meets it: the rest must be short compared with the step, or as small as rounding
// errors.
#ifndef EVENT_LOCATION_H
#define EVENT_LOCATION_H

#include "box.h"
#include "constants.h"

#define NO_ROOT R(1e30)
#define SURFACE_COUNT (FACE_COUNT + (STOP == PLANE ? 1 : 0))

// As `surface`, with the plane's normal turned away from the ray's start.
static inline real4 oriented(const Control *control, int k, real side, int3 cell, real3 frac)
{
    const real4 s = surface(control, k, cell, frac);
    return k == FACE_COUNT ? side * s : s;
}

// Size of a cell in the unit of surface k: distances to faces are in cells, to the plane in metres.
static inline real surface_unit(const Control *control, int k)
{
    return k == FACE_COUNT ? R(1.0) / greatest(VECTOR(control->cell_rate)) : R(1.0);
}

// The first positive h at which v0 + v1 h + v2 h^2 rises through zero; 0 if it is positive and stays so.
static inline real rising_root(real v0, real v1, real v2)
{
    const real disc = v1 * v1 - R(4.0) * v2 * v0;
    if (v0 > R(0.0)) {
        if (v1 >= R(0.0) || disc < R(0.0)) {
            return R(0.0);
        }
    } else if (disc < R(0.0)) {
        return NO_ROOT;
    }
    const real root = sqrt(disc);
    if (v1 >= R(0.0)) {
        return v1 + root <= R(0.0) ? NO_ROOT : R(-2.0) * v0 / (v1 + root);
    }
    return v2 <= R(0.0) ? NO_ROOT : (root - v1) / (R(2.0) * v2);
}

// Half the second derivative, by the step, of a ray's distance outside surface k, whose normal is given.
static inline real half_curve(const Control *control, int k, real3 normal, real3 along, real3 bend)
{
    real curve = dot(normal, bend);
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        curve += (along.x * along.x + along.y * along.y) / control->radius;
    }
    return R(0.5) * curve;
}

// Whether a ray that rises with `rise` is in surface k or outside it and runs almost parallel to it.
static inline int grazes(const Control *control, int k, real outside, real rise, real3 along)
{
    const real grazing = R(1.0e-4) * size3(along) * surface_unit(control, k);
    return rise >= R(0.0) && rise <= grazing && outside >= -SURFACE_TOLERANCE * surface_unit(control, k);
}

// Whether rounding decides on which side of a face a step of length h begins and ends; never in float64. In float64,
// SURFACE_TOLERANCE decides.
static inline int stays_within_noise(real outside, real rise, real curved, real h)
{
    return sizeof(real) == 4 && greater(fabs(outside), fabs(outside + (rise + curved * h) * h)) <= EVENT_LOCATION_NOISE;
}

// Distance of a place outside the flat faces along each axis [cells].
static inline real3 outside_flat_faces(const Control *control, int3 cell, real3 frac)
{
    const real3 whole = (real3)((real)cell.x, (real)cell.y, (real)cell.z);
    real3 outside = max((VECTOR(control->face_low) - whole) - frac, (whole - VECTOR(control->face_high)) + frac);
    outside.x = FLAT_AXES > 2 ? outside.x : -NO_ROOT;
    outside.y = FLAT_AXES > 1 ? outside.y : -NO_ROOT;
    return outside;
}

// Whether a step of length h, whatever its direction, stays farther from every flat face than rounding errors. Then
// none of the checks of single faces below can be true, rounding errors included.
static inline int clears_flat_faces(const Control *control, int3 cell, real3 frac, real3 along, real3 bend, real h)
{
    const real3 rising = fabs(along) + R(0.5) * fabs(bend) * h;
    const real farthest = greatest(outside_flat_faces(control, cell, frac) + rising * h);
    return farthest < -greater(SURFACE_TOLERANCE, EVENT_LOCATION_NOISE);
}

// Whether surface k is a plane that no ray in the box can meet.
static inline int is_out_of_reach(const Control *control, int k)
{
    return k == FACE_COUNT && !control->plane_in_box;
}

// The step, at most h, that ends where the parabola first meets a surface; that surface or -1; whether it runs. A ray
// runs in a face if it is so near the face that rounding decides on which side it is.
static inline real event_location(
    const Control *control, real3 rate, real side, int3 cell, real3 frac, real3 momentum, real3 force, real h,
    int *event, int *runs)
{
    real best = h;
    *event = -1;
    *runs = 0;
    const real3 along = momentum * rate;
    const real3 bend = force * rate;
    const int is_clear = clears_flat_faces(control, cell, frac, along, bend, h);
#pragma unroll
    for (int k = 0; k < SURFACE_COUNT; k++) {
        if (k < 2 * FLAT_AXES ? is_clear : is_out_of_reach(control, k)) {
            continue;
        }
        const real4 s = oriented(control, k, side, cell, frac);
        const real curved = half_curve(control, k, s.yzw, along, bend);
        const real rise = dot(s.yzw, along);
        // Rounding must not end a ray that runs in a face.
        const real tolerance = SURFACE_TOLERANCE * surface_unit(control, k);
        real outside = s.x;
        if (grazes(control, k, outside, rise, along)) {
            outside -= tolerance;
            *runs |= k < FACE_COUNT;
        }
        if (k < FACE_COUNT) {
            *runs |= stays_within_noise(outside, rise, curved, best);
        }
        // Most surfaces are out of reach: skip the root.
        const real rising = greater(rise, R(0.0)) + greater(curved, R(0.0)) * best;
        if (outside + rising * best >= R(0.0)) {
            const real root = rising_root(outside, rise, curved);
            if (root <= best) {
                best = root;
                *event = k;
            }
        }
    }
    return best;
}

// How much of a step of length h may be behind a face in which the ray runs. Few rays need this.
APART real time_beyond_face(
    const Control *control, real3 rate, real side, int3 cell, real3 frac, real3 momentum, real3 force, real h)
{
    real first = h;
    const real3 along = momentum * rate;
    const real3 bend = force * rate;
    for (int k = 0; k < FACE_COUNT; k++) {
        const real4 s = oriented(control, k, side, cell, frac);
        const real curved = half_curve(control, k, s.yzw, along, bend);
        const real rise = dot(s.yzw, along);
        real outside = s.x;
        if (grazes(control, k, outside, rise, along)) {
            first = lesser(first, rising_root(outside - TOLERANCE_COUNTED * SURFACE_TOLERANCE, rise, curved));
            outside -= SURFACE_TOLERANCE;
        }
        if (stays_within_noise(outside, rise, curved, h)) {
            first = R(0.0);
        }
    }
    return greater(h - first, R(0.0));
}

// Whether a ray that leaves by face `event` rises so little that rounding alone decides where, or whether.
APART int leaves_by_rounding(
    const Control *control, int event, real3 rate, real side, int3 cell, real3 frac, real3 momentum)
{
    if (event < 0 || event >= FACE_COUNT) {
        return 0;
    }
    const real4 s = oriented(control, event, side, cell, frac);
    const real3 velocity = momentum * rate;
    const real rise = dot(s.yzw, velocity);
    return s.x >= -EVENT_LOCATION_NOISE && fabs(rise) < LEAST_RISE * size3(velocity);
}

// Rounding error of a place's distance from surface k, in the unit of the surface.
static inline real rounding_of(const Control *control, int k)
{
    real allowance = EVENT_LOCATION_NOISE * surface_unit(control, k);
    if (k == FACE_COUNT) {
        allowance += EVENT_LOCATION_NOISE * fabs(control->plane_offset);
    }
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        allowance *= R(1.0) + control->radius;
    }
    return lesser(allowance, R(1.0e-5) * surface_unit(control, k));
}

// Whether a step of length h ends further behind surface k than `close` cells, or than a share of the step.
APART int overshoots(
    const Control *control, int k, real side, int3 cell, real3 frac, real3 velocity, real h, real close)
{
    const real4 ahead = oriented(control, k, side, cell, frac);
    const real speed = greater(dot(ahead.yzw, velocity), R(0.0));
    // A ray that runs in a face ends its step by the tolerance behind it.
    const real least = rounding_of(control, k) + SURFACE_TOLERANCE * surface_unit(control, k);
    const int is_far = ahead.x > greater(R(2.5) * EVENT_LOCATION_SHARE * speed * h, least);
    return is_far || ahead.x > close * surface_unit(control, k);
}

// Whether a place is behind a surface other than `event` by more than rounding; distance to the next face.
static inline int passed_surface(
    const Control *control, real side, int3 cell, real3 frac, int event, real *nearest)
{
    int is_behind = 0;
    const real farthest = greatest(outside_flat_faces(control, cell, frac));
    const int is_inside = farthest < R(0.0);
    *nearest = is_inside ? -farthest : NO_ROOT;
#pragma unroll
    for (int k = 0; k < SURFACE_COUNT; k++) {
        if (k < 2 * FLAT_AXES ? is_inside : is_out_of_reach(control, k)) {
            continue;
        }
        const real allowance = rounding_of(control, k) + R(2.0) * SURFACE_TOLERANCE * surface_unit(control, k);
        const real outside = oriented(control, k, side, cell, frac).x;
        is_behind |= outside > allowance && k != event;
        if (k < FACE_COUNT) {
            *nearest = lesser(*nearest, fabs(outside));
        }
    }
    return is_behind;
}

// Distance from a face within which a ray counts as in it [cells]; the ray may be shifted by `displacement`.
static inline real face_margin(const Control *control, real displacement)
{
    return EVENT_LOCATION_NOISE + R(2.0) * SURFACE_TOLERANCE + displacement * greatest(VECTOR(control->cell_rate));
}

// Whether a ray runs along a face within `allowance` cells, so that its error may put it on the other side. A ray that
// crosses the face does not count: its error only shifts the crossing a little. Neither does a ray that stays exactly
// in the face: it is on no side.
APART int in_face(const Control *control, real side, int3 cell, real3 frac, real3 velocity, real allowance)
{
    int is_in = 0;
    for (int k = 0; k < FACE_COUNT; k++) {
        const real4 s = oriented(control, k, side, cell, frac);
        const int runs = fabs(dot(s.yzw, velocity)) <= (real)LEAST_COSINE * size3(velocity);
        is_in |= runs && fabs(s.x) <= allowance && fabs(s.x) > TOLERANCE_COUNTED * SURFACE_TOLERANCE;
    }
    return is_in;
}

// After a step to surface k: sigma still to go along the parabola, negative to go back; whether the ray ends. The
// velocity and its derivative are in cells. A ray that is neither behind the surface nor close to it takes another step
// toward it.
APART real surface_intersection(
    const Control *control, int k, real side, int3 cell, real3 frac, real3 velocity, real3 acceleration, real h,
    real h_cell, int *done)
{
    const real4 now = oriented(control, k, side, cell, frac);
    const real speed = dot(now.yzw, velocity);
    const real unit = surface_unit(control, k);
    // Behind the surface, or close enough to fly the rest along the parabola.
    if (speed > R(0.0) && now.x >= -EVENT_LOCATION_SHARE * speed * h - rounding_of(control, k)) {
        const real root = sqrt(greater(speed * speed - R(2.0) * dot(now.yzw, acceleration) * now.x, R(0.0)));
        // A ray that only rounding moves goes back no further than its step.
        const real back = greater(R(-2.0) * now.x / (speed + root), -h);
        // The rest may cross another surface first.
        real nearest;
        const real3 there = frac + back * velocity + (R(0.5) * back * back) * acceleration;
        *done = back <= R(0.0) || !passed_surface(control, side, cell, there, k, &nearest);
        return *done ? back : R(0.0);
    }
    // Outside, and coming back or not moving relative to the surface.
    *done = h <= R(1.0e-9) * h_cell || now.x > R(1.0e-3) * unit;
    return R(0.0);
}

// The step over `rest` of arc, if it is no longer than h; the index changes along it.
static inline real arc_event_location(real rest, real index, real3 total, real3 force, real h, int *event)
{
    const real bend = dot(force, total) / index;
    if (h * (index + R(0.5) * bend * h) < rest) {
        return h;
    }
    *event = ARC_SURFACE;
    const real h_arc = lesser(rest / index, h);
    return bounded(rest / (index + R(0.5) * bend * h_arc), R(0.0), h);
}

// Whether a step of length h with `rest` of arc before it ends further behind the arc length than a share of the step.
// The potentials are those of the four stages.
static inline int passes_arc(real rest, real ambient, real pot, real4 s2, real4 s3, real4 s4, real h)
{
    const real4 m = contrasts(ambient, (real4)(pot, s2.x, s3.x, s4.x));
    const real arc = h * (ambient + dot((real4)(RKN_V1, RKN_V2, RKN_V3, RKN_V4), m));
    return arc - rest > R(2.5) * EVENT_LOCATION_SHARE * ambient * h;
}

// After a step to the arc length: sigma still to go, negative to go back; whether the ray ends. A ray behind the arc
// length goes back along the parabola; `total` is n times its direction.
static inline real arc_surface_intersection(
    real rest, real index, real3 total, real3 force, real arc_left, real h, int *done)
{
    *done = rest <= R(1.0e-4) * h * index + R(1.0e-6) * arc_left;
    const real root = sqrt(greater(index * index + R(2.0) * dot(force, total) / index * rest, R(0.0)));
    return *done ? greater(R(2.0) * rest / (index + root), -h) : R(0.0);
}

#endif
