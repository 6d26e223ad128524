// The part of the box in which the air is not uniform, the field's support, and ways out of it: outside it a ray flies a
// straight line, whose meeting with the faces of the box is solved for exactly.
#ifndef SUPPORT_H
#define SUPPORT_H

#include "ends.h"

// How far a ray that ends at p with this heading has run on outside the box, after a face other than `ends_on`;
// infinite where it is farther outside than FACE_TOLERANCE.
static inline double overrun(const Bounds *bounds, const Control *control, int ends_on, double3 p, double3 heading)
{
    const double face_tolerance = FACE_TOLERANCE / (double)greatest(VECTOR(control->cell_rate));
    double excess = 0.0;
    for (int k = 0; k < FACE_COUNT; k++) {
        if (GEOMETRY == AXISYMMETRIC && k == 2 && dot(p.xy, p.xy) <= bounds->radius * bounds->radius) {
            continue;
        }
        double3 normal;
        const double beyond = surface_distance(bounds, k, p, &normal);
        if (k != ends_on && beyond > 0.0) {
            excess = beyond > face_tolerance ? (double)INFINITY
                                             : fmax(excess, beyond / fmax(fabs(dot(normal, heading)), 1.0e-9));
        }
    }
    return excess;
}

// Whether a ray that runs along a face, and whose straight line of length `length` ends at p, may have left the box by that
// face and come back: `angle` is the greatest angle by which it is deflected.
static inline int may_have_left(const Bounds *bounds, double3 p, double3 d, double length, double angle)
{
    int may = 0;
    for (int k = 0; k < FACE_COUNT; k++) {
        if (GEOMETRY == AXISYMMETRIC && k == 2 && dot(p.xy, p.xy) <= 0.25 * bounds->radius * bounds->radius) {
            continue;
        }
        double3 normal;
        const double beyond = surface_distance(bounds, k, p, &normal);
        may |= fabs(dot(normal, d)) <= angle && beyond > -length * angle;
    }
    return may;
}

// Shortens a ray's interval in the box to the part in which the air is not uniform; whether the ray ends in uniform air.
static inline int keep_support(const Bounds *bounds, double3 p, double3 d, double *t_enter, double *t_exit)
{
    const double2 span =
        crossing(VECTOR64(bounds->support_low), VECTOR64(bounds->support_high), bounds->support_radius, p, d);
    const double first = lesser64(greater64(span.x, *t_enter), *t_exit);
    const double last = greater64(lesser64(span.y, *t_exit), first);
    const int meets = span.x <= span.y;
    const int ends_before = !meets || last < *t_exit;
    *t_exit = meets ? last : *t_enter;
    *t_enter = meets ? first : *t_enter;
    return ends_before;
}

// Whether the straight line from p along `heading` stays out of the field's support: beyond one of its faces, unless it
// comes back to that. A support that ends within the box has a cell to spare at each side (support.py).
static inline int leaves_support(const Bounds *bounds, double3 p, double3 heading)
{
    int leaves = 0;
    for (int axis = GEOMETRY == VOLUME ? 0 : GEOMETRY == PLANAR ? 1 : 2; axis < 3; axis++) {
        const double low = bounds->support_low[axis], high = bounds->support_high[axis], cell = bounds->spacing[axis];
        const double at = pick64(p, axis), ahead = pick64(heading, axis);
        leaves |= at <= low + lesser64(low - bounds->low[axis], cell) && ahead <= 0.0;
        leaves |= at >= high - lesser64(bounds->high[axis] - high, cell) && ahead >= 0.0;
    }
    if (GEOMETRY == AXISYMMETRIC) {
        const double radius = bounds->support_radius;
        const double inner = radius - lesser64(bounds->radius - radius, bounds->spacing[0]);
        leaves |= dot(p.xy, p.xy) >= inner * inner && dot(p.xy, heading.xy) >= 0.0;
    }
    return leaves;
}

// How far on, in `heading`, the line from p leaves the box, and by which face; not a number where it misses the box.
static inline double exit_of(const Bounds *bounds, double3 p, double3 heading, int *face)
{
    const double2 span = crossing(VECTOR64(bounds->low), VECTOR64(bounds->high), bounds->radius, p, heading);
    const double3 at = p + span.y * heading;
    double least = 1.0e300;
    *face = 0;
    for (int k = 0; k < FACE_COUNT; k++) {
        double3 normal;
        const double miss = fabs(surface_distance(bounds, k, at, &normal));
        if (miss < least) {
            least = miss;
            *face = k;
        }
    }
    return span.x > span.y ? (double)NAN : span.y;
}

// How far on, in `heading`, the line from p meets surface k on its way out; not a number where it never does.
static inline double line_to(const Bounds *bounds, int k, double3 p, double3 heading)
{
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        const double a = dot(heading.xy, heading.xy), b = dot(p.xy, heading.xy);
        const double c = dot(p.xy, p.xy) - bounds->radius * bounds->radius;
        const double root = sqrt(b * b - a * c);
        return b > 0.0 ? -c / (b + root) : (root - b) / a;
    }
    double3 normal;
    const double miss = surface_distance(bounds, k, p, &normal);
    return -miss / dot(normal, heading);
}

#endif
