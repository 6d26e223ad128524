// Both ends of a ray, before its first step and after its last one. In float64.
#ifndef ENDS_H
#define ENDS_H

#include "box.h"
#include "motion.h"
#include "ray_status.h"
#include "wall.h"

// Initial status of a ray, and Interval of the undisturbed ray.
APART int start_of(
    const Field *field, const Arrays *arrays, const Bounds *bounds, double3 p, double3 d, Interval *interval)
{
    int status = RAY_OK;

    // Where the undisturbed ray stops, and whether it meets the box before.
    const double2 span = crossing(VECTOR64(bounds->low), VECTOR64(bounds->high), bounds->radius, p, d);
    double enter = greater64(span.x, 0.0);
    int meets = span.x <= span.y && span.y >= 0.0;
    double stop_distance = span.y;
    int has_stop = 1;
    double3 normal = (double3)0.0;
    interval->side = R(1.0);
#if STOP == PLANE
    const double height = dot(VECTOR64(bounds->plane_normal), p - VECTOR64(bounds->plane_point));
    const double slope = dot(VECTOR64(bounds->plane_normal), d);
    stop_distance = 0.0;
    if (height != 0.0) {
        has_stop = height * slope < 0.0 && fabs(slope) > LEAST_SLOPE;
        if (has_stop) {
            stop_distance = -height / slope;
        }
    }
    if (height > 0.0) {
        interval->side = R(-1.0);
    }
#elif STOP == ARC
    stop_distance = bounds->length;
#else
    if (meets && span.y > 1.0e299) {
        status = RAY_STOP_NOT_REACHED;  // along x in a planar field, which has no end there
    }
#endif
    if (meets && has_stop && STOP != NONE) {
        meets = stop_distance > enter;
    }
#if HAS_BODY
    // A ray that starts inside the body begins where it leaves the body. If the body extends beyond the box, a ray may
    // hit the body before it reaches the box.
    if (meets) {
        const WallMeeting met = body_exit(field, arrays, p, d, enter);
        const double leaves = met.exit;
        const double hits = body_entry(field, arrays, p, d, enter);
        if (hits < NEVER) {
            status = RAY_HIT_BODY;
            enter = hits;
        } else if (has_stop && STOP != NONE && stop_distance <= lesser64(leaves, span.y)) {
            meets = 0;
        } else if ((leaves > enter && leaves >= (1.0 - ENTRY_ROUNDING) * span.y) || leaves >= NEVER) {
            status = RAY_INSIDE_BODY;  // it comes out where the box ends, if at all
        } else {
            enter = leaves;
            if (met.odd) {
                normal = outward_normal(arrays, met.piece, p + leaves * d);
            }
        }
    }
#endif
    interval->t_enter = enter;
    interval->t_exit = has_stop && STOP != NONE ? lesser64(span.y, stop_distance) : span.y;
    interval->stop_distance = stop_distance;
    interval->has_stop = has_stop;
    interval->meets = meets;
    interval->normal = normal;
    return status;
}

// Number of the surface on which the undisturbed ray ends.
static inline int surface_of(const Bounds *bounds, const Interval *interval, double3 p, double3 d)
{
    if (STOP == PLANE && interval->has_stop && interval->t_exit == interval->stop_distance) {
        return FACE_COUNT;
    }
    int nearest = 0;
    double least = 1.0e300;
    for (int k = 0; k < FACE_COUNT; k++) {
        double3 normal;
        const double miss = fabs(surface_distance(bounds, k, p + interval->t_exit * d, &normal));
        if (miss < least) {
            least = miss;
            nearest = k;
        }
    }
    return nearest;
}

// Shift of the stop along d per sideways shift of the ray. This is the tangent of the angle of incidence on the stop,
// at most the tangent that STEEPEST_COSINE allows.
static inline double obliquity_of(const Bounds *bounds, const Interval *interval, double3 p, double3 d)
{
    double obliquity = 0.0;
    if (STOP != ARC && interval->has_stop) {
        double3 normal = VECTOR64(bounds->plane_normal);
        if (STOP == NONE) {
            surface_distance(bounds, surface_of(bounds, interval, p, d), p + interval->t_exit * d, &normal);
        }
        const double cosine = dot(normal, d);
        obliquity = size64(normal - cosine * d) / greater64(fabs(cosine), STEEPEST_COSINE);
    }
    return obliquity;
}

// Position of a ray, from the sums of its steps so far.
static inline double3 place_of(
    double3 p, double3 d, const Interval *interval, double ambient, real3 q, real3 q_carry, real4 sums,
    real4 sums_carry)
{
    const double sigma = (double)sums.x - (double)sums_carry.x;
    return p + (interval->t_enter + ambient * sigma) * d + (convert_double3(q) - convert_double3(q_carry));
}

APART StopGeometry stop_geometry_of(
    const Bounds *bounds, const Control *control, const Interval *interval, double3 p, double3 d)
{
    const double chord = interval->t_exit - interval->t_enter;
    StopGeometry out;
    out.reach = chord < 1.0e30 ? (real)chord : control->extent;  // along x a planar box has no end
    out.obliquity = CONTROLLED ? (real)obliquity_of(bounds, interval, p, d) : R(0.0);
    out.resolution = DIRECTION_NOISE;
    if (STOP == PLANE) {
        const double cosine = greater64(fabs(dot(VECTOR64(bounds->plane_normal), d)), LEAST_SLOPE);
        out.resolution += (real)(INCIDENCE_NOISE / cosine);
    }
    const real beyond = STOP == PLANE ? (real)greater64(interval->stop_distance - interval->t_exit, 0.0) : R(0.0);
    out.lever_arm = out.reach + beyond;
    out.derating = R(1.0);
    if (beyond > R(0.0)) {
        out.derating = pow(R(1.0) + R(0.25) * out.obliquity * beyond * greatest(VECTOR(control->cell_rate)), R(-0.25));
    }
    return out;
}

// The ray at its stop: adds the sums of the steps, (sigma, S, M, B), to the straight ray and flies on to a stop outside
// the box. p and d are the ray's start and direction, `interval` and `status` are those of `start_of`. `ends_on` is the
// number of the surface on which the ray ended, or -1. `max_deflection` is the greatest angle between the ray and d.
APART Arrival end_of(
    const Bounds *bounds,
    const Control *control,
    double3 p,
    double3 d,
    const Interval *interval,
    int status,
    int ends_on,
    real3 q,
    real3 q_carry,
    real3 momentum,
    real4 sums,
    real4 sums_carry,
    real max_deflection)
{
    const double ambient = bounds->ambient;
    double3 q64 = convert_double3(q) - convert_double3(q_carry);
    const double sigma = (double)sums.x - (double)sums_carry.x;
    const double work = 2.0 * ((double)sums.y - (double)sums_carry.y);
    const double stretch = (double)sums.z - (double)sums_carry.z;
    if (CONSISTENT_GRADIENT && max_deflection <= NEARLY_STRAIGHT) {
        // Along d the deviation is int (T . d - a) d sigma = M - B: sums of the same values as the path (motion.py).
        const double lagging = (double)sums.w - (double)sums_carry.w;
        q64 += (stretch - lagging - dot(q64, d)) * d;
    }
    const double3 tangent_change = deflection(ambient, d, convert_double3(momentum));
    const double3 heading = d + tangent_change;
    double along = interval->t_enter + ambient * sigma;  // distance along the straight ray
    double2 grazing = (double2)(0.0, 1.0);
    if (ends_on >= 0 && ends_on < ARC_SURFACE) {
        along = meeting(bounds, ends_on, p + q64, d, along);
        const double rest = grazing_correction(bounds, control, ends_on, p + along * d + q64, d, heading, &grazing);
        along += rest;
        q64 += rest * tangent_change;
    }
    double stop_distance = interval->stop_distance;
    if (!interval->meets) {
        along = 0.0;
        if (STOP == NONE) {
            status = RAY_MISSED_FIELD;
            stop_distance = 0.0;
        }
    }

    double flight = 0.0;
    if (status == RAY_OK) {
        if (STOP == PLANE && (!interval->meets || (ends_on >= 0 && ends_on != FACE_COUNT))) {
            const double3 here = p + along * d + q64;
            const double height = dot(VECTOR64(bounds->plane_normal), here - VECTOR64(bounds->plane_point));
            const double slope = dot(VECTOR64(bounds->plane_normal), heading);
            // If the plane is on a face of the box, rounding may put the ray behind the plane.
            const double face_tolerance = 1.0e-3 / (double)greatest(VECTOR(control->cell_rate));
            // The undisturbed ray of a parallel ray never meets the plane: there is no path to compare with.
            const double descent = dot(VECTOR64(bounds->plane_normal), d);
            const int toward = height * slope < 0.0 && lesser64(fabs(slope), fabs(descent)) > LEAST_SLOPE;
            if (toward || (interval->meets && fabs(height) < face_tolerance * fabs(slope))) {
                flight = -height / slope;
            } else if (height != 0.0) {
                status = RAY_STOP_NOT_REACHED;
            }
        }
        if (STOP == ARC) {
            flight = bounds->length - (along + stretch);
        }
    }
    const double3 deviation = q64 + flight * tangent_change;
    along += flight;

    double opd = work - ambient * stretch;
    if (status == RAY_OK && interval->has_stop && STOP != ARC) {
        // How much further along d than the undisturbed ray the ray meets the stop: computed from the deviation where
        // that is exact, because the difference of two distances would lose its last digits.
        double further = along - stop_distance;
        if (STOP == PLANE) {
            const double descent = dot(VECTOR64(bounds->plane_normal), d);
            if (fabs(descent) > LEAST_COSINE) {
                further = -dot(VECTOR64(bounds->plane_normal), deviation) / descent;
            }
        } else if (ends_on >= 0) {
            further = detour(bounds, ends_on, p, d, deviation, stop_distance, further);
        }
        opd = work + ambient * further;
    }

    Arrival out;
    out.position = p + along * d + deviation;
    out.direction = heading / size64(heading);
    out.optical_path = greater64(ambient * along + work, 0.0);
    out.opd = opd;
    out.arc_length = greater64(along + stretch, 0.0);  // rounding may make it negative if a ray leaves at its start
    out.flight = flight;
    out.grazing = grazing;
    out.status = status;
    return out;
}

#endif
