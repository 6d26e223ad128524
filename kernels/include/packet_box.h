// Where the straight rays of a packet meet a box, and the box's faces: the functions of generated/box.h for all lanes of a
// packet.
#ifndef PACKET_BOX_H
#define PACKET_BOX_H

#include "constants.h"
#include "lanes.h"
#include "types.h"

// A vector in space for each lane.
#if LANES == 1
typedef double3 Triples;
#else
typedef struct {
    doubles x, y, z;
} Triples;
#endif

// Distances along straight rays at which they enter something and leave it; enter > leave means a miss.
typedef struct {
    doubles enter, leave;
} Spans;

static inline doubles lesser_each(doubles a, doubles b) { return CHOOSE64(b, a, a < b); }
static inline doubles greater_each(doubles a, doubles b) { return CHOOSE64(b, a, a > b); }
static inline doubles inner(Triples a, Triples b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline doubles inner_with(double3 a, Triples b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline doubles pick_each(Triples v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

static inline Triples triples_of(doubles x, doubles y, doubles z)
{
    Triples out;
    out.x = x;
    out.y = y;
    out.z = z;
    return out;
}

static inline Triples sum_of(Triples a, Triples b) { return triples_of(a.x + b.x, a.y + b.y, a.z + b.z); }

static inline Triples ahead_of(Triples p, doubles along, Triples d)
{
    return triples_of(p.x + along * d.x, p.y + along * d.y, p.z + along * d.z);
}

static inline Triples in_all_lanes(double3 v) { return triples_of((doubles)v.x, (doubles)v.y, (doubles)v.z); }

static inline Triples choose_triples(Triples other, Triples value, truths where)
{
    return triples_of(
        CHOOSE64(other.x, value.x, where), CHOOSE64(other.y, value.y, where), CHOOSE64(other.z, value.z, where));
}

// Vectors of rays from `first` on; unused lanes repeat the last ray.
static inline Triples load_triples(__global const double *from, int first, int ray_count)
{
#if LANES == 1
    return vload3(first, from);
#else
    Triples out;
    for (int lane = 0; lane < LANES; lane++) {
        const int ray = min(first + lane, ray_count - 1);
        DOUBLE_AT(out.x, lane) = from[3 * ray];
        DOUBLE_AT(out.y, lane) = from[3 * ray + 1];
        DOUBLE_AT(out.z, lane) = from[3 * ray + 2];
    }
    return out;
#endif
}

static inline void slab_each(double low, double high, doubles p, doubles d, Spans *span)
{
    const truths level = d == 0.0, beside = level & ((p < low) | (p > high));
    const doubles near = (low - p) / d, far = (high - p) / d;
    const doubles enter = greater_each(span->enter, lesser_each(near, far));
    const doubles leave = lesser_each(span->leave, greater_each(near, far));
    span->enter = CHOOSE64(CHOOSE64(enter, span->enter, level), (doubles)1.0, beside);
    span->leave = CHOOSE64(CHOOSE64(leave, span->leave, level), (doubles)(-1.0), beside);
}

static inline void cylinder_each(double radius, Triples p, Triples d, Spans *span)
{
    const doubles a = d.x * d.x + d.y * d.y;
    const truths level = a == 0.0;
    const doubles middle = -(p.x * d.x + p.y * d.y) / a;
    const doubles x = p.x + middle * d.x, y = p.y + middle * d.y;
    const doubles rest = radius * radius - x * x - y * y;
    const truths beside = (level & (p.x * p.x + p.y * p.y > radius * radius)) | (!level & (rest < 0.0));
    const doubles half_chord = sqrt(CHOOSE64(rest / a, (doubles)0.0, level | beside));
    const doubles enter = greater_each(span->enter, middle - half_chord);
    const doubles leave = lesser_each(span->leave, middle + half_chord);
    span->enter = CHOOSE64(CHOOSE64(enter, span->enter, level), (doubles)1.0, beside);
    span->leave = CHOOSE64(CHOOSE64(leave, span->leave, level), (doubles)(-1.0), beside);
}

// Distances at which straight rays enter and leave a box; entry > exit means a miss.
static inline Spans crossing_each(double3 low, double3 high, double radius, Triples p, Triples d)
{
    Spans span = {(doubles)(-1.0e300), (doubles)1.0e300};
    slab_each(low.z, high.z, p.z, d.z, &span);
    if (GEOMETRY == AXISYMMETRIC) {
        cylinder_each(radius, p, d, &span);
    } else {
        slab_each(low.y, high.y, p.y, d.y, &span);
    }
    if (GEOMETRY == VOLUME) {
        slab_each(low.x, high.x, p.x, d.x, &span);
    }
    return span;
}

// Distance outside surface k [m], and the unit normal of the surface.
static inline doubles surface_each(const Bounds *bounds, int k, Triples p, Triples *normal)
{
    if (k == FACE_COUNT) {
        const double3 n = VECTOR64(bounds->plane_normal), point = VECTOR64(bounds->plane_point);
        *normal = in_all_lanes(n);
        return n.x * (p.x - point.x) + n.y * (p.y - point.y) + n.z * (p.z - point.z);
    }
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        const doubles square = p.x * p.x + p.y * p.y;
        const doubles inverse = 1.0 / sqrt(square);
        normal->x = p.x * inverse;
        normal->y = p.y * inverse;
        normal->z = (doubles)0.0;
        return square * inverse - bounds->radius;
    }
    const int axis = 2 - k / 2;
    const doubles place = pick_each(p, axis);
    *normal = in_all_lanes((k % 2 == 0 ? -1.0 : 1.0) * unit64(axis));
    return k % 2 == 0 ? bounds->low[axis] - place : place - bounds->high[axis];
}

// The component of a vector along the normal of surface k, which is along an axis except for the plane and the
// cylinder.
static inline doubles along_normal(int k, Triples normal, Triples v)
{
    if (k == FACE_COUNT || (GEOMETRY == AXISYMMETRIC && k == 2)) {
        return inner(normal, v);
    }
    return k % 2 == 0 ? -pick_each(v, 2 - k / 2) : pick_each(v, 2 - k / 2);
}

// Number of the box's face nearest to a place.
static inline truths nearest_face_each(const Bounds *bounds, Triples at)
{
    truths nearest = (truths)0;
    doubles least = (doubles)1.0e300;
#pragma unroll
    for (int k = 0; k < FACE_COUNT; k++) {
        Triples normal;
        const doubles miss = fabs(surface_each(bounds, k, at, &normal));
        const truths nearer = miss < least;
        least = CHOOSE64(least, miss, nearer);
        nearest = CHOOSE64(nearest, (truths)k, nearer);
    }
    return nearest;
}

// Distance at which a line from p meets surface k going outward. The distance is in units of `heading`, and not a
// number if the line never does.
static inline doubles line_to(const Bounds *bounds, int k, Triples p, Triples heading)
{
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        const doubles a = heading.x * heading.x + heading.y * heading.y, b = p.x * heading.x + p.y * heading.y;
        const doubles c = p.x * p.x + p.y * p.y - bounds->radius * bounds->radius;
        const doubles root = sqrt(b * b - a * c);
        return CHOOSE64((root - b) / a, -c / (b + root), b > 0.0);
    }
    Triples normal;
    const doubles miss = surface_each(bounds, k, p, &normal);
    return -miss / along_normal(k, normal, heading);
}

#endif
