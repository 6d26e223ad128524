// The field's support, the part of the box in which the air is not uniform, and paths out of it, for a packet of rays.
//
// Outside the support a ray is a straight line, whose intersection with the faces of the box is computed exactly.
#ifndef SUPPORT_H
#define SUPPORT_H

#include "packet_box.h"

// Distance that a ray ending at p has run outside the box, beyond a face other than `ends_on`. Infinite if it is
// farther outside than FACE_TOLERANCE.
static inline doubles overrun(const Bounds *bounds, const Control *control, truths ends_on, Triples p, Triples heading)
{
    const double face_tolerance = FACE_TOLERANCE / (double)greatest(VECTOR(control->cell_rate));
    doubles excess = (doubles)0.0;
#pragma unroll
    for (int k = 0; k < FACE_COUNT; k++) {
        Triples normal;
        const doubles beyond = surface_each(bounds, k, p, &normal);
        truths out = (ends_on != (truths)k) & (beyond > 0.0);
        if (GEOMETRY == AXISYMMETRIC && k == 2) {
            out &= p.x * p.x + p.y * p.y > bounds->radius * bounds->radius;
        }
        if (SOME(out)) {
            const doubles slope = greater_each(fabs(along_normal(k, normal, heading)), (doubles)1.0e-9);
            const doubles more = CHOOSE64(
                greater_each(excess, beyond / slope), (doubles)INFINITY, beyond > face_tolerance);
            excess = CHOOSE64(excess, more, out);
        }
    }
    return excess;
}

// Whether a ray along a face, deflected by at most `angle`, may have left the box and come back. The undisturbed ray is
// of length `length` and ends at p.
static inline truths may_have_left(const Bounds *bounds, Triples p, Triples d, doubles length, doubles angle)
{
    truths may = (truths)0;
#pragma unroll
    for (int k = 0; k < FACE_COUNT; k++) {
        Triples normal;
        const doubles beyond = surface_each(bounds, k, p, &normal);
        truths left = (fabs(along_normal(k, normal, d)) <= angle) & (beyond > -length * angle);
        if (GEOMETRY == AXISYMMETRIC && k == 2) {
            left &= p.x * p.x + p.y * p.y > 0.25 * bounds->radius * bounds->radius;
        }
        may |= left;
    }
    return may;
}

// Shorten the interval in the box to the part in which the air is not uniform. Returns whether a ray ends in uniform
// air.
static inline truths keep_support(const Bounds *bounds, Triples p, Triples d, doubles *t_enter, doubles *t_exit)
{
    const Spans span =
        crossing_each(VECTOR64(bounds->support_low), VECTOR64(bounds->support_high), bounds->support_radius, p, d);
    const doubles first = lesser_each(greater_each(span.enter, *t_enter), *t_exit);
    const doubles last = greater_each(lesser_each(span.leave, *t_exit), first);
    const truths meets = span.enter <= span.leave;
    const truths ends_before = !meets | (last < *t_exit);
    *t_exit = CHOOSE64(*t_enter, last, meets);
    *t_enter = CHOOSE64(*t_enter, first, meets);
    return ends_before;
}

// Whether the straight line from p along `heading` stays out of the field's support. It does if p is beyond a face of
// the support and the line does not approach that face. A support that ends within the box has a spare cell at each
// side (support.py).
static inline truths leaves_support(const Bounds *bounds, Triples p, Triples heading)
{
    truths leaves = (truths)0;
#pragma unroll
    for (int axis = GEOMETRY == VOLUME ? 0 : GEOMETRY == PLANAR ? 1 : 2; axis < 3; axis++) {
        const double low = bounds->support_low[axis], high = bounds->support_high[axis], cell = bounds->spacing[axis];
        const doubles at = pick_each(p, axis), ahead = pick_each(heading, axis);
        leaves |= (at <= low + lesser64(low - bounds->low[axis], cell)) & (ahead <= 0.0);
        leaves |= (at >= high - lesser64(bounds->high[axis] - high, cell)) & (ahead >= 0.0);
    }
    if (GEOMETRY == AXISYMMETRIC) {
        const double radius = bounds->support_radius;
        const double inside = radius - lesser64(bounds->radius - radius, bounds->spacing[0]);
        leaves |= (p.x * p.x + p.y * p.y >= inside * inside) & (p.x * heading.x + p.y * heading.y >= 0.0);
    }
    return leaves;
}

// Distance at which a line from p leaves the box, and the number of the face. The distance is in units of `heading`,
// and not a number if the line misses the box.
static inline doubles exit_of(const Bounds *bounds, Triples p, Triples heading, truths *face)
{
    const Spans span = crossing_each(VECTOR64(bounds->low), VECTOR64(bounds->high), bounds->radius, p, heading);
    *face = nearest_face_each(bounds, ahead_of(p, span.leave, heading));
    return CHOOSE64(span.leave, (doubles)NAN, span.enter > span.leave);
}

#endif
