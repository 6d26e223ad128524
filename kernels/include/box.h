// Where a straight ray meets the field's box, and the box's faces as stop surfaces. In float64.
#ifndef BOX_H
#define BOX_H

#include "constants.h"
#include "types.h"

static inline void slab(double low, double high, double p, double d, double2 *span)
{
    if (d == 0.0) {
        if (p < low || p > high) {
            *span = (double2)(1.0, -1.0);
        }
        return;
    }
    const double near = (low - p) / d;
    const double far = (high - p) / d;
    *span = (double2)(greater64(span->x, lesser64(near, far)), lesser64(span->y, greater64(near, far)));
}

static inline void cylinder(double radius, double3 p, double3 d, double2 *span)
{
    const double a = d.x * d.x + d.y * d.y;
    if (a == 0.0) {
        if (p.x * p.x + p.y * p.y > radius * radius) {
            *span = (double2)(1.0, -1.0);
        }
        return;
    }
    const double middle = -(p.x * d.x + p.y * d.y) / a;
    const double x = p.x + middle * d.x;
    const double y = p.y + middle * d.y;
    const double rest = radius * radius - x * x - y * y;
    if (rest < 0.0) {
        *span = (double2)(1.0, -1.0);
        return;
    }
    const double half_chord = sqrt(rest / a);
    *span = (double2)(greater64(span->x, middle - half_chord), lesser64(span->y, middle + half_chord));
}

// Distances at which a straight ray enters and leaves a box; entry > exit means a miss.
static inline double2 crossing(double3 low, double3 high, double radius, double3 p, double3 d)
{
    double2 span = (double2)(-1.0e300, 1.0e300);
    slab(low.z, high.z, p.z, d.z, &span);
    if (GEOMETRY == AXISYMMETRIC) {
        cylinder(radius, p, d, &span);
    } else {
        slab(low.y, high.y, p.y, d.y, &span);
    }
    if (GEOMETRY == VOLUME) {
        slab(low.x, high.x, p.x, d.x, &span);
    }
    return span;
}

// Distance outside surface k, and its gradient per cell. Surfaces 0 and 1 are the z faces; then the cylinder, or the y
// faces, or the y and x faces; the last is the plane.
static inline real4 surface(const Control *control, int k, int3 cell, real3 frac)
{
    if (k == FACE_COUNT) {
        const real3 n = VECTOR(control->plane_normal);
        const real place = (real)cell.x * n.x + (real)cell.y * n.y + (real)cell.z * n.z - control->plane_offset;
        return (real4)(place + dot(n, frac), n);
    }
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        const real radius = control->radius;
        const real value = (frac.x * frac.x + frac.y * frac.y - radius * radius) / (R(2.0) * radius);
        return (real4)(value, frac.x / radius, frac.y / radius, R(0.0));
    }
    const int axis = 2 - k / 2;
    const real whole = (real)pick_int(cell, axis);
    const real part = pick(frac, axis);
    const real sense = k % 2 == 0 ? R(-1.0) : R(1.0);
    const real outside =
        k % 2 == 0 ? (control->face_low[axis] - whole) - part : (whole - control->face_high[axis]) + part;
    return (real4)(outside, axis == 0 ? sense : R(0.0), axis == 1 ? sense : R(0.0), axis == 2 ? sense : R(0.0));
}

// Distance outside surface k [m], and the unit normal of the surface.
static inline double surface_distance(const Bounds *bounds, int k, double3 p, double3 *normal)
{
    if (k == FACE_COUNT) {
        *normal = VECTOR64(bounds->plane_normal);
        return dot(*normal, p - VECTOR64(bounds->plane_point));
    }
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        const double square = p.x * p.x + p.y * p.y;
        const double inverse = 1.0 / sqrt(square);
        *normal = (double3)(p.x * inverse, p.y * inverse, 0.0);
        return square * inverse - bounds->radius;
    }
    const int axis = 2 - k / 2;
    const double place = pick64(p, axis);
    *normal = (k % 2 == 0 ? -1.0 : 1.0) * unit64(axis);
    return k % 2 == 0 ? bounds->low[axis] - place : place - bounds->high[axis];
}

// Distance at which a line meets surface k. For a line that grazes the surface it returns the guess.
static inline double meeting(const Bounds *bounds, int k, double3 p, double3 d, double guess)
{
    double along = guess;
    const int trials = GEOMETRY == AXISYMMETRIC && k == 2 ? 3 : 1;  // Newton's method; on flat faces one step is exact
    for (int trial = 0; trial < trials; trial++) {
        double3 normal;
        const double miss = surface_distance(bounds, k, p + along * d, &normal);
        const double cosine = dot(normal, d);
        if (fabs(cosine) > LEAST_COSINE) {
            along -= miss / cosine;
        }
    }
    return along;
}

// Correction for a ray that grazes surface k: the remaining length along the tangent `heading` to the surface [m]; 0 if
// that is more than the rounding of the ray's position explains, or if the line along d met the surface already (see
// `meeting`). `grazing` gets the length left uncorrected because it is too long [m], and the cosine of the angle
// between tangent and normal.
static inline double grazing_correction(
    const Bounds *bounds, const Control *control, int k, double3 p, double3 d, double3 heading, double2 *grazing)
{
    double3 normal;
    const double miss = surface_distance(bounds, k, p, &normal);
    const double cosine = dot(normal, heading);
    const double most = GRAZING_TOLERANCE / (double)greatest(VECTOR(control->cell_rate));
    const int is_flat = fabs(dot(normal, d)) <= LEAST_COSINE;
    const int grazes = is_flat && fabs(miss) < most * fabs(cosine);
    const double shortfall = is_flat && !grazes ? fabs(miss) / fmax(fabs(cosine), 1.0e-200) : 0.0;
    *grazing = (double2)(shortfall, fabs(cosine));
    return grazes ? -miss / cosine : 0.0;
}

// Extra distance along d to face k for a line shifted by q, relative to the line itself, which leaves the box at
// `leave`. Returns `other` if the line leaves by another face or at a grazing angle.
static inline double detour(const Bounds *bounds, int k, double3 p, double3 d, double3 q, double leave, double other)
{
    double3 normal;
    const double miss = surface_distance(bounds, k, p + leave * d, &normal);
    const double cosine = dot(normal, d);
    const double size = size64(VECTOR64(bounds->high) - VECTOR64(bounds->low)) + size64(p);
    if (fabs(miss) > 1.0e-14 * size || fabs(cosine) < LEAST_COSINE) {
        return other;
    }
    double further = -dot(normal, q) / cosine;
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        // |c + (further d + q)|^2 = |c|^2 across the axis, c of length `radius`: the root that is 0 for q = 0
        const double2 at = p.xy + leave * d.xy;
        const double a = dot(d.xy, d.xy), b = dot(at + q.xy, d.xy), c = dot(2.0 * at + q.xy, q.xy);
        const double square = b * b - a * c;
        if (b <= 0.0 || square < 0.0) {
            return other;
        }
        further = -c / (b + sqrt(square));
    }
    return further;
}

#endif
