// The error of a step and of a ray, as optical path, and the share that may be rounding.
#ifndef ERROR_H
#define ERROR_H

#include "motion.h"

// The error [m], the greatest angle with d so far, the weight of an error of direction, the displacement, and the error
// by `kinks` that a step crosses on a mesh, as a vector (see Bends). The weight is the length by which an error of the
// direction is multiplied. The displacement is how far sideways the step may put the ray where it leaves the field. The
// ray meets its stop at an `obliquity` (ends.h), `lever_arm` further on.
static inline real step_error(
    real ambient,
    real3 d,
    real3 total,
    real3 momentum,
    real h,
    int is_smooth,
    real max_deflection,
    const StopGeometry *to_stop,
    real pot,
    real3 force,
    real4 s2,
    real4 s3,
    real4 s4,
    real kinks,
    real *angle,
    real *direction_weight,
    real *step_displacement,
    real3 *bend)
{
    const real reach = to_stop->reach, lever_arm = to_stop->lever_arm;
    // After the ray has turned, the initial obliquity does not apply; the angle of the turn counts instead.
    const real obliquity = to_stop->obliquity * greater(R(1.0) - max_deflection / OBLIQUITY_KEPT, R(0.0));
    const real3 f2 = FORCE(s2), f3 = FORCE(s3), f4 = FORCE(s4);
    const real error_s = h * (RKN_F1 * pot + RKN_F2 * s2.x + RKN_F3 * s3.x + RKN_F4 * s4.x);
    real3 error_q = (h * h) * (RKN_E1 * force + RKN_E2 * f2 + RKN_E3 * f3 + RKN_E4 * f4);
    real3 error_p = h * (RKN_F1 * force + RKN_F2 * f2 + RKN_F3 * f3 + RKN_F4 * f4);
    const real3 end_momentum = momentum + h * f4;
    *angle = greater(max_deflection, size3(end_momentum - dot(end_momentum, d) * d) / ambient);
    real error_ratio = R(1.0);
    if (INTERPOLATION == CUBIC || INTERPOLATION == LINEAR) {
        // On a nearly straight ray a quadrature of higher order with the slopes along the ray gives a sharper error of
        // the path; the other errors are assumed to be overestimated in the same ratio.
        const real slope1 = dot(force, total);
        const real slope2 = dot(f2, total + (R(0.5) * RKN_C2 * h) * (force + f2));
        const real slope3 = dot(f3, total + (R(0.5) * RKN_C3 * h) * (force + f3));
        const real slope4 = dot(f4, total + (R(0.5) * h) * (force + f4));
        real fine = h * (RKN_G1 * pot + RKN_G2 * s2.x + RKN_G3 * s3.x + RKN_G4 * s4.x);
        fine += (h * h) * (RKN_K1 * slope1 + RKN_K2 * slope2 + RKN_K3 * slope3 + RKN_K4 * slope4);
        error_ratio = fabs(fine) / greater(fabs(error_s), TINY);
        const int smooth = (INTERPOLATION == LINEAR && GEOMETRY != AXISYMMETRIC) || is_smooth;
        const real least_ratio = smooth ? LEAST_RATIO_SMOOTH : LEAST_RATIO;
        error_ratio = bounded(error_ratio, lesser(least_ratio + RATIO_GROWTH * *angle, R(1.0)), R(1.0));
    }
    real error = R(4.0) * error_ratio * fabs(error_s);
    if (!CONSISTENT_GRADIENT || *angle > NEARLY_STRAIGHT) {
        // The errors along d and in arc length.
        const real error_m = RKN_F1 * contrast(ambient, pot) + RKN_F2 * contrast(ambient, s2.x)
            + RKN_F3 * contrast(ambient, s3.x) + RKN_F4 * contrast(ambient, s4.x);
        error += ambient * (fabs(dot(error_q, d)) + h * fabs(error_m));
    }
    error_q -= dot(error_q, d) * d;
    error_p -= dot(error_p, d) * d;
    const real weight = *angle + error_ratio * DIRECTION_SHARE;
    // At far stops the ray's own deflection adds to the obliquity. The error of a direction is assumed to be
    // overestimated less than that of the path, because it is not a sum along the ray.
    const int is_far = lever_arm > R(2.0) * reach;
    const real own = is_far && *angle < LEAPFROG_ANGLE ? *angle : R(0.0);
    const real tilt_ratio = is_far || INTERPOLATION == LINEAR ? greater(error_ratio, LEAST_RATIO) : error_ratio;
    const real tilt = tilt_ratio * (obliquity + own);
    *direction_weight = weight * (reach + ambient * h) + obliquity * (lever_arm + ambient * h);
    const real error_p_size = size3(MAGNIFIED * error_p) / MAGNIFIED;
    const real error_q_size = size3(MAGNIFIED * error_q) / MAGNIFIED;
    *step_displacement = greater(error_ratio, LEAST_RATIO) * (error_q_size + reach * error_p_size / ambient);
    const real arm = weight * reach + tilt * lever_arm;
    *bend = (real3)R(0.0);
    if (ON_MESH && kinks > R(0.0)) {
        *bend = arm * error_p + (ambient * (weight + tilt)) * error_q + (R(4.0) * error_s) * d;
        const real size = size3(MAGNIFIED * *bend) / MAGNIFIED;
        const real least = h * kinks * (KINK_SHARE * arm + KINK_PATH * h * ambient);
        if (size < least) {
            *bend = size > R(0.0) ? (least / size) * *bend : least * d;
        }
        return error - R(4.0) * fabs(error_s);
    }
    return error + error_p_size * arm + ambient * error_q_size * (weight + tilt);
}

// Weight of an error of the direction of a ray on a mesh [m], as in step_error.
static inline real bend_arm(const StopGeometry *to_stop, real max_deflection)
{
    const real obliquity = to_stop->obliquity * greater(R(1.0) - max_deflection / OBLIQUITY_KEPT, R(0.0));
    const int is_far = to_stop->lever_arm > R(2.0) * to_stop->reach;
    const real own = is_far && max_deflection < LEAPFROG_ANGLE ? max_deflection : R(0.0);
    return (max_deflection + DIRECTION_SHARE) * to_stop->reach + (obliquity + own) * to_stop->lever_arm;
}

// Share of a ray's tolerance that the error of a step by kinks may have, if smooth errors may have the share `part`.
static inline real bend_share(real part)
{
    return sqrt(part) / (BEND_SPREAD + R(2.0));
}

// The errors by kinks with that of another step, of a size [m].
static inline Bends with_bend(const Bends *bends, real3 bend, real size)
{
    Bends out;
    out.x = bends->x + bend.x;
    out.y = bends->y + bend.y;
    out.z = bends->z + bend.z;
    out.greatest = greater(bends->greatest, size3(MAGNIFIED * (real3)(out.x, out.y, out.z)) / MAGNIFIED);
    out.root = size2(MAGNIFIED * (real2)(bends->root, size)) / MAGNIFIED;
    out.sizes = bends->sizes + size;
    return out;
}

// Error of a ray by the kinks that its steps crossed [m].
static inline real bend_error(const Bends *bends)
{
    return lesser(bends->sizes, bends->greatest + BEND_SPREAD * bends->root);
}

// Rounding error of a step [m].
static inline real step_rounding(
    const Control *control,
    real h,
    real direction_weight,
    real3 rate,
    real3 frac,
    real pot,
    real3 force,
    real4 s3)
{
    real size = greater(fabs(pot), fabs(s3.x));
    if (GEOMETRY == AXISYMMETRIC) {
        // Coordinates across the axis are measured from the axis, and rounded relative to the distance from it.
        size += size3(force) * size2(frac.xy) / rate.x;
    }
    const real steep = greater(size3(force), size * greatest(VECTOR(control->cell_rate)));
    return NOISE * h * (R(2.0) * size + steep * direction_weight);
}

// The error [m] to which steps are controlled: the tolerance, or what rounding of a deflection `angle` makes. Far stops
// that are almost parallel to the ray magnify rounding beyond any tolerance: shorter steps are in vain.
static inline real attainable_error(const Control *control, real ambient, const StopGeometry *to_stop, real angle)
{
    const real rounding = to_stop->resolution * ambient * angle * to_stop->obliquity * to_stop->lever_arm;
    return greater(control->tolerance, rounding);
}

// Optical path that a ray may gain behind a face per length of its step; without a stop it may end there.
static inline real possible_gain(real ambient, const StopGeometry *to_stop, real angle, real pot, real3 force, real4 s3)
{
    const real steep = greater(size3(force), size3(FORCE(s3)));
    const real gain = greater(fabs(pot), fabs(s3.x)) + steep * (to_stop->obliquity + angle) * to_stop->lever_arm;
    return STOP == NONE ? ambient * ambient : gain;
}

// Error of a ray at its stop: the errors of its steps, and the rounding of the direction of its flight there.
// Rounding affects the momentum, whose part along d is the contrast, and the slopes between nodes: differences of
// coefficients as great as the greatest contrast that the ray flew through, however even it is. The ray may meet a plane
// at a smaller angle than the obliquity allows for. If the ray is turned late, the errors of direction of its first steps
// also meet a far stop at that angle: the sideways `displacement` grows beyond the field.
static inline real stop_error(
    real used,
    const Bounds *bounds,
    const Control *control,
    double3 direction,
    real ambient,
    real greatest_momentum,
    real max_deflection,
    const StopGeometry *to_stop,
    real displacement)
{
    real size = greatest_momentum + ambient * max_deflection;
    size *= R(1.0) + SLOPE_NOISE * to_stop->reach * greatest(VECTOR(control->cell_rate));
    real error = used + DIRECTION_NOISE * size * (to_stop->obliquity + max_deflection) * to_stop->lever_arm;
    const real met_at = max_deflection < LEAPFROG_ANGLE ? max_deflection : R(0.0);
    error += ambient * met_at * (to_stop->lever_arm - to_stop->reach) * (displacement / greater(to_stop->reach, TINY));
    if (STOP == PLANE) {
        const double cosine = fabs(dot(VECTOR64(bounds->plane_normal), direction));
        error *= (real)(STEEPEST_COSINE / fmin(fmax(cosine, 1.0e-9), STEEPEST_COSINE));
    }
    return error;
}

// Error of a ray that ended on surface `ends_on`; `grazing` has the length left to the surface and the cosine.
// `obliquity` is that of the undisturbed ray; the ray may end at a smaller angle, or on another surface. If the ray
// flies on from the surface, a shift of one metre along the ray changes the path by `opd_rate`. Normal to the surface,
// the position is wrong by a share of a `cell` [m] by rounding and by `displacement` from the steps; along the ray, by
// these over the cosine.
static inline real event_location_error(
    real used, real ambient, real cell, int ends_on, double2 grazing, real obliquity, real opd_rate,
    real displacement)
{
    real shortfall = (real)fmin(grazing.x, 1.0e30);
    const real cosine = (real)fmax(grazing.y, 1.0e-15);
    const real rounded = EVENT_LOCATION_NOISE * cell / cosine;
    if (STOP == NONE) {
        shortfall += cosine < (real)LEAST_COSINE ? rounded : R(0.0);
        return greater(used * greater(R(1.0) / (cosine * (R(1.0) + obliquity)), R(1.0)), ambient * shortfall);
    }
    if (ends_on == FACE_COUNT) {
        return greater(used, ambient * shortfall);
    }
    const real beside = rounded + (cosine < (real)LEAST_COSINE ? displacement / cosine : R(0.0));
    return used + opd_rate * (shortfall + beside);
}

// Status of a ray, by its error `used`: TOLERANCE_NOT_MET where it is to be traced again, see retrace.py. So is a ray
// whose steps float32 exhausted, with an infinite error: rounding may have kept them short, or refused them, so that
// float64 decides.
static inline int judged_status(int status, real tolerance, real *used)
{
    if (!REAL_IS_DOUBLE && status == RAY_MAX_STEPS && isfinite(*used)) {
        *used = INFINITY;
        return RAY_TOLERANCE_NOT_MET;
    }
    return status == RAY_OK && !(*used <= tolerance) ? RAY_TOLERANCE_NOT_MET : status;
}

#endif
