// Nearly straight rays by equally many, evenly spaced samples; what it computes, and why so, stands in
// aerokernels/tracing/engines/warp/kernels/leapfrog.py, its Warp twin.
//
// A work-item moves a packet of LANES rays in step. Arguments are those of the tracer; rejected_count_out counts the
// rays that are to be traced otherwise: their step_error_out is above the tolerance, or infinite where this method does
// not hold.

#include "arguments.h"
#include "ends.h"
#include "flight.h"
#include "outputs.h"
#include "support.h"
#include "unresolved.h"

__kernel void leapfrog(LEAPFROG_ARGUMENTS)
{
    const int first = (int)get_global_id(0) * LANES + first_ray;
    if (first >= ray_count) {
        return;
    }
    const Arrays arrays = ARRAYS;
    const RayOutputs outputs = RAY_OUTPUTS;
    const real3 rate = VECTOR(field.inverse_spacing);
    const int count = control.sample_count;

    // Each lane's ray; spare lanes repeat the last one.
    Interval intervals[LANES];
    double2 wholes[LANES];  // where their paths through the box begin and end, with the part in uniform air
    int statuses[LANES], is_rejected[LANES], surfaces[LANES], is_uniform[LANES];
    reals x0, y0, z0, dx, dy, dz, length;
    for (int lane = 0; lane < LANES; lane++) {
        const int ray = min(first + lane, ray_count - 1);
        const double3 p = vload3(ray, position_in), d = vload3(ray, direction_in);
        Interval interval;
        statuses[lane] = start_of(&field, &arrays, &bounds, p, d, &interval);
        const int runs = interval.meets && statuses[lane] == RAY_OK;
        is_rejected[lane] = 0;
        wholes[lane] = (double2)(interval.t_enter, interval.t_exit);
        const Interval whole = interval;
        is_uniform[lane] = runs && keep_support(&bounds, p, d, &interval.t_enter, &interval.t_exit);
        surfaces[lane] = runs && !is_uniform[lane] ? surface_of(&bounds, &whole, p, d) : -1;
        const double3 place = (p + interval.t_enter * d - VECTOR64(bounds.origin)) / VECTOR64(bounds.spacing);
        REAL_AT(x0, lane) = runs ? (real)place.x : R(0.0);
        REAL_AT(y0, lane) = runs ? (real)place.y : R(0.0);
        REAL_AT(z0, lane) = runs ? (real)place.z : R(0.0);
        REAL_AT(dx, lane) = (real)d.x;
        REAL_AT(dy, lane) = (real)d.y;
        REAL_AT(dz, lane) = (real)d.z;
        REAL_AT(length, lane) = runs ? (real)(interval.t_exit - interval.t_enter) : R(0.0);
        intervals[lane] = interval;
    }

    const Flight flight = fly(&field, &arrays, &control, (real)bounds.ambient, x0, y0, z0, dx, dy, dz, length);
    const reals missed = unresolved_of(
        &field, &arrays, &control, x0, y0, z0, dx, dy, dz, length, flight.q[0], flight.q[1], flight.q[2]);

    for (int lane = 0; lane < LANES && first + lane < ray_count; lane++) {
        const int ray = first + lane;
        const double3 p = vload3(ray, position_in), d = vload3(ray, direction_in);
        Interval interval = intervals[lane];
        const int runs = interval.meets && statuses[lane] == RAY_OK;
        const real step = REAL_AT(flight.h, lane);
        real3 across = VECTOR_AT(flight.p, lane);
        const real rest = REAL_AT(flight.slowness, lane);
        real3 q = VECTOR_AT(flight.q, lane);
        double path = (double)step * ((double)REAL_AT(flight.paths, lane) - (double)REAL_AT(flight.paths_carry, lane));
        double longitudinal_deficit =
            (double)step * ((double)REAL_AT(flight.deficits, lane) - (double)REAL_AT(flight.deficits_carry, lane));
        double arc = (double)step * ((double)REAL_AT(flight.arcs, lane) - (double)REAL_AT(flight.arcs_carry, lane));
        real lateral_error = REAL_AT(flight.error, lane);
        real3 momentum = (real3)R(0.0);
        double flown = (double)REAL_AT(length, lane);
        double3 normal = (double3)(0.0), end = p;
        double more = 0.0;
        real off_tail = R(0.0);  // error of direction from the path between the last sample and the surface
        int ends_on = -1;
        if (runs) {
            // What is left to the surface, which the ray meets a little beside the undisturbed one.
            const int uniform = is_uniform[lane];
            const double3 heading = d + convert_double3(rest * across);
            const double3 here = p + interval.t_exit * d + convert_double3(q);
            ends_on = surfaces[lane];
            if (uniform) {
                if (flown > 0.0 && !leaves_support(&bounds, here, heading)) {
                    is_rejected[lane] = 1;  // turned, it goes on through disturbed air
                }
#if STOP == PLANE
                ends_on = BEYOND_SUPPORT;
                normal = VECTOR64(bounds.plane_normal);
#else
                more = exit_of(&bounds, here, heading, &ends_on);
#endif
            }
            if (ends_on != BEYOND_SUPPORT) {
                if (!uniform) {
                    more = line_to(&bounds, ends_on, here, heading);
                }
                surface_distance(&bounds, ends_on, here + more * heading, &normal);
            }
            const double cosine = dot(normal, heading);
            // Along the parabola; what that leaves out, by the change of the slope over a cell, counts as an error.
            // In uniform air there is nothing to leave out.
            const real there = uniform ? R(0.0) : R(1.0);
            const real3 force = there * rest * VECTOR_AT(flight.f, lane);
            const double rise = there * (double)REAL_AT(flight.ahead, lane);
            const double s = there * (double)REAL_AT(flight.s, lane);
            const real lead = uniform ? -dot(across, across) * rest / (R(1.0) / rest + (real)bounds.ambient)
                                    : REAL_AT(flight.lead, lane);
            const double bow = 0.5 * more * more * (double)rest * dot(normal, convert_double3(force));
            more -= !uniform && fabs(cosine) > LEAST_COSINE ? bow / cosine : 0.0;
            const double climb = 0.5 * more * rise;
            const double added = more * (double)rest * (s + climb);
            path += added;
            longitudinal_deficit += more * ((double)lead + (double)rest * climb / bounds.ambient);
            arc += added / bounds.ambient;
            const real tail = (real)fabs(more);
            const real steep_tail = there * REAL_AT(flight.steep, lane) * tail;
            lateral_error = greater(
                lateral_error, steep_tail * (tail / (real)fabs(cosine)) * lesser(tail * greatest(rate), R(1.0)));
            off_tail = rest * steep_tail * lesser((tail + R(0.5) * step) * greatest(rate), R(1.0));
            q += (real)more * rest * (across + (R(0.5) * (real)more) * force);
            flown += more;
            across += (real)more * force;
            momentum = across + (lead / rest) * convert_real3(d);
            end = p + (interval.t_enter + flown) * d + convert_double3(q);
            const real angle = sqrt(REAL_AT(flight.max_deflection, lane)) / (real)bounds.ambient;
            // Beside the undisturbed ray it stays within that angle of it.
            const double chord = wholes[lane].y - wholes[lane].x;
            if (HAS_BODY && !has_clearance(&field, &arrays, p, d, wholes[lane].x, wholes[lane].y, chord * angle)) {
                is_rejected[lane] = 1;
            }
            if (may_have_left(&bounds, p + interval.t_exit * d, d, (double)REAL_AT(length, lane), (double)angle)) {
                is_rejected[lane] = 1;
            }
            if (is_rejected[lane] || !(angle <= LEAPFROG_ANGLE) || !isfinite(path) || !isfinite(lateral_error) ||
                fabs(cosine) <= LEAST_COSINE ||
                (STOP == PLANE && fabs(dot(VECTOR64(bounds.plane_normal), heading)) <= LEAST_COSINE)) {
                lateral_error = (real)INFINITY;
            }
            // Where the box's end is the stop, the path is off by all of that excess, else by what the field adds.
            // One that has left the support must not have left the box before.
            const double excess = overrun(&bounds, &control, uniform ? -1 : ends_on, uniform ? here : end, heading);
            const double loss = STOP == NONE && !uniform ? bounds.ambient : fmax(fabs(s) / bounds.ambient, 1.0e-30);
            lateral_error = greater(lateral_error, excess > 0.0 ? (real)(excess * loss) : R(0.0));
        }
        // In the tracer's sums: sigma, S, M and B, of which M - B is the deviation along the ray.
        const double4 sums64 =
            (double4)((flown - longitudinal_deficit) / bounds.ambient, path, arc, arc - longitudinal_deficit);
        const real4 sums = (real4)((real)sums64.x, (real)sums64.y, (real)sums64.z, (real)sums64.w);
        const real4 carry = (real4)(
            (real)((double)sums.x - sums64.x), (real)((double)sums.y - sums64.y), (real)((double)sums.z - sums64.z),
            (real)((double)sums.w - sums64.w));
        const Arrival arrival = end_of(
            &bounds, &control, p, d, &interval, statuses[lane], ends_on, q, (real3)R(0.0), momentum, sums, carry,
            R(0.0));
        if (runs && arrival.status != RAY_OK) {
            lateral_error = (real)INFINITY;  // a deflected ray may miss a plane on the box's edge
        } else if (runs) {
            // Errors of place and direction count where the ray meets its stop at an angle, and so does what the air
            // outside the field's support does to both.
            const double3 deviation_diff = convert_double3(VECTOR_AT(flight.deviation_diff, lane));
            const double3 momentum_diff = convert_double3(VECTOR_AT(flight.momentum_diff, lane));
            const double onward = STOP == PLANE ? arrival.flight : arrival.flight + more;
            if (STOP == PLANE) {
                normal = VECTOR64(bounds.plane_normal);
            }
            // The direction error of a deflected ray also has a part along d, by which it meets a far stop earlier.
            const double3 displacement = deviation_diff + (onward * (double)rest) * momentum_diff;
            const double obliquity =
                fabs(dot(normal, displacement)) + fabs(dot(convert_double3(rest * momentum), displacement));
            const double cosine = fmax(fabs(dot(normal, d)), STEEPEST_COSINE);
            lateral_error =
                greater(lateral_error, control.quadrature_error_scale * (real)(bounds.ambient * obliquity / cosine));
            const double tangent = sqrt(fmax(1.0 - cosine * cosine, 0.0)) / cosine;
            const double greatest_tangent = tangent + (double)sqrt(REAL_AT(flight.max_deflection, lane));
            lateral_error = greater(lateral_error, off_tail * (real)(bounds.ambient * onward * greatest_tangent));
            const double chord = wholes[lane].y - wholes[lane].x;
            const double lever_arm = (chord + onward) * greatest_tangent;
            const double outside = fmax(chord - (double)REAL_AT(length, lane), 0.0);
            const real left =
                (real)(outside * ((double)control.left_potential + lever_arm * (double)control.left_slope));
            if (left > LEFT_SHARE * control.tolerance) {
                lateral_error = greater(lateral_error, left);
            }
#if CUBES
            // What its samples may be off the spline, and what their slopes do up to the stop.
            const double aside = REAL_AT(flight.off_slope, lane) * (REAL_AT(length, lane) + onward);
            lateral_error +=
                REAL_AT(flight.off, lane) + (real)((aside - REAL_AT(flight.off_moment, lane)) * greatest_tangent);
#endif
        }
        if (runs && REAL_AT(missed, lane) > R(0.0)) {
            const double onward = arrival.flight + interval.t_exit - interval.t_enter;
            lateral_error += with_lever_arm(&field, REAL_AT(missed, lane), (real)onward, (real)fabs(dot(normal, d)));
        }
        if (lateral_error > control.tolerance) {
            atomic_inc(rejected_count_out);
        }
        const int samples = runs ? count : 0;
        write_outputs(&outputs, control.outputs, ray, &arrival, (double)lateral_error, samples, samples);
    }
}
