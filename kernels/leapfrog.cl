// The kernel that traces nearly straight rays, all with the same number of evenly spaced samples. Its Warp twin,
// aerokernels/tracing/engines/warp/kernels/leapfrog.py, says what it computes and why.
//
// A work-item moves a packet of LANES rays in step. Its arguments are those of the tracer and the count of rejected
// rays, which are to be traced by another method: their step_error is above the tolerance, or infinite if this method
// is not valid for them.

#include "types.h"
#include "flight.h"
#include "packet_ends.h"
#include "support.h"

#define IN_DOUBLE(v) triples_of(TO_DOUBLES((v)[0]), TO_DOUBLES((v)[1]), TO_DOUBLES((v)[2]))
#define INNER(a, b) ((a)[0] * (b)[0] + (a)[1] * (b)[1] + (a)[2] * (b)[2])
#define GREATER(a, b) CHOOSE(b, a, (a) > (b))
#define LESSER(a, b) CHOOSE(b, a, (a) < (b))
#define ALL_THREE(c) for (int c = 0; c < 3; c++)

#if HAS_BODY
// Whether undisturbed rays, and all rays deflected by at most `angle`, stay out of the body.
static inline truths have_clearance(
    const Field *field, const Arrays *arrays, Triples p, Triples d, const Starts *starts, doubles angle)
{
    truths clear = (truths)0;
    for (int lane = 0; lane < LANES; lane++) {
        const double first = DOUBLE_AT(starts->whole.enter, lane), last = DOUBLE_AT(starts->whole.leave, lane);
        NUMBER_AT(clear, lane) = TRUTH_AT(starts->runs, lane) &&
            has_clearance(field, arrays, TRIPLE_AT(p, lane), TRIPLE_AT(d, lane), first, last,
                          (last - first) * DOUBLE_AT(angle, lane));
    }
    return clear != (truths)0;
}
#endif

// Where a packet's rays enter the disturbed air, and the lengths of their paths in it [m].
typedef struct {
    Starts starts;
    Path path;
    reals length;
    reals kick[3];  // momentum across the rays, by refraction where they leave the body
} Entries;

APART Entries enter(
    const Field *field,
    const Arrays *arrays,
    const Bounds *bounds,
    const Control *control,
    int first,
    int ray_count,
    __global const double *position_in,
    __global const double *direction_in)
{
    const Triples p = load_triples(position_in, first, ray_count), d = load_triples(direction_in, first, ray_count);
    Entries in;
    in.starts = start_each(field, arrays, bounds, p, d);
    const truths runs = in.starts.runs;
    const Triples entry = ahead_of(p, in.starts.part.enter, d);
    const doubles zero = (doubles)0.0;
    in.length = TO_REALS(CHOOSE64(zero, in.starts.part.leave - in.starts.part.enter, runs));
    const Path path = {
        TO_REALS(CHOOSE64(zero, (entry.x - bounds->origin[0]) / bounds->spacing[0], runs)),
        TO_REALS(CHOOSE64(zero, (entry.y - bounds->origin[1]) / bounds->spacing[1], runs)),
        TO_REALS(CHOOSE64(zero, (entry.z - bounds->origin[2]) / bounds->spacing[2], runs)),
        TO_REALS(d.x), TO_REALS(d.y), TO_REALS(d.z), in.length / (real)control->sample_count};  // its sums start at 0
    in.path = path;
    in.kick[0] = in.kick[1] = in.kick[2] = (reals)R(0.0);
#if HAS_BODY
    const reals s = sample_packet(field, arrays, path.x0, path.y0, path.z0).value;
    const reals cosine = TO_REALS(inner(in.starts.normal, d)), before = (real)bounds->ambient * cosine;
    const reals kick = CHOOSE((reals)R(0.0), LEAVING_KICK(before, s), before > R(0.0));
    in.kick[0] = kick * (TO_REALS(in.starts.normal.x) - cosine * path.dx);
    in.kick[1] = kick * (TO_REALS(in.starts.normal.y) - cosine * path.dy);
    in.kick[2] = kick * (TO_REALS(in.starts.normal.z) - cosine * path.dz);
#endif
    return in;
}

// From the last sample of a packet's rays to their stop: computes their errors and writes the outputs.
APART void leave(
    const Field *field,
    const Arrays *arrays,
    const Bounds *bounds,
    const Control *control,
    int first,
    int ray_count,
    __global const double *position_in,
    __global const double *direction_in,
    const Entries *in,
    const Flying *flight,
    const RayOutputs *outputs,
    __global int *rejected_count_out)
{
    const real3 rate = VECTOR(field->inverse_spacing);
    const double ambient = bounds->ambient;
    const reals length = in->length;
    const Starts *starts = &in->starts;
    const reals missed = unresolved_of(field, arrays, control, &in->path, length, flight->q);

    const Triples p = load_triples(position_in, first, ray_count), d = load_triples(direction_in, first, ray_count);
    const truths runs = starts->runs, uniform = starts->uniform;
    const doubles step = TO_DOUBLES(flight->path.h), rest64 = TO_DOUBLES(flight->slowness);
    const reals rest = flight->slowness, none = (reals)R(0.0);
    doubles path = step * (TO_DOUBLES(flight->paths) - TO_DOUBLES(flight->paths_carry));
    doubles longitudinal_deficit = step * (TO_DOUBLES(flight->deficits) - TO_DOUBLES(flight->deficits_carry));
    doubles arc = step * (TO_DOUBLES(flight->arcs) - TO_DOUBLES(flight->arcs_carry));
    reals across[3], q[3], force[3], turn[3];
    // In uniform air there is no force.
#pragma unroll
    ALL_THREE(c) {
        across[c] = flight->p[c];
        q[c] = flight->q[c];
        turn[c] = rest * across[c];
        force[c] = CHOOSE(rest * flight->f[c], none, uniform);
    }
    const doubles rise = TO_DOUBLES(CHOOSE(flight->ahead, none, uniform));
    const doubles s = TO_DOUBLES(CHOOSE(flight->s, none, uniform));
    const reals steep = CHOOSE(flight->steep, none, uniform);
    const reals lead =
        CHOOSE(flight->lead, -INNER(across, across) * rest / (R(1.0) / rest + (real)ambient), uniform);

    // The rest to the surface, which the ray meets a little beside the undisturbed ray.
    const Triples turned = IN_DOUBLE(turn), beside = IN_DOUBLE(q), pull = IN_DOUBLE(force);
    const Triples heading = sum_of(d, turned);
    const Triples last = ahead_of(p, starts->part.leave, d);
    const Triples here = sum_of(last, beside);
    truths rejected = (truths)0, ends_on = starts->surface;
    doubles more = (doubles)0.0;
    Triples normal = in_all_lanes(VECTOR64(bounds->plane_normal));
    if (SOME(uniform)) {
        // A ray that has turned may fly on through disturbed air.
        rejected = uniform & TO_TRUTHS(length > R(0.0)) & !leaves_support(bounds, here, heading);
        truths face = (truths)BEYOND_SUPPORT;
#if STOP != PLANE
        more = CHOOSE64(more, exit_of(bounds, here, heading, &face), uniform);
#endif
        ends_on = CHOOSE64(ends_on, face, uniform);
    }
#pragma unroll
    for (int k = 0; k <= FACE_COUNT; k++) {
        const truths now = ends_on == (truths)k;
        if ((k < FACE_COUNT || STOP == PLANE) && SOME(now)) {
            Triples outward;
            more = CHOOSE64(more, line_to(bounds, k, here, heading), now & !uniform);
            surface_each(bounds, k, ahead_of(here, more, heading), &outward);
            normal = choose_triples(normal, outward, now);
        }
    }
    const doubles cosine = inner(normal, heading);
    // Along the parabola; its error, from the change of the slope over a cell, counts as an error.
    const truths meets_steeply = !uniform & (fabs(cosine) > LEAST_COSINE);
    const doubles bow = 0.5 * more * more * rest64 * inner(normal, pull);
    more -= CHOOSE64((doubles)0.0, bow / cosine, meets_steeply);
    more = CHOOSE64((doubles)0.0, more, runs);
    const doubles climb = 0.5 * more * rise;
    const doubles added = more * rest64 * (s + climb);
    path += added;
    longitudinal_deficit += more * (TO_DOUBLES(lead) + rest64 * climb / ambient);
    arc += added / ambient;
    const reals onward_here = TO_REALS(more);
    const reals tail = fabs(onward_here), steep_tail = steep * tail, none_left = (reals)R(1.0);
    const real cells = greatest(rate);
    reals lateral_error = GREATER(
        flight->error, steep_tail * (tail / TO_REALS(fabs(cosine))) * LESSER(tail * cells, none_left));
    // Error of the direction from the path between the last sample and the surface.
    const reals off_tail = rest * steep_tail * LESSER((tail + R(0.5) * flight->path.h) * cells, none_left);
    const reals lead_rate = lead / rest;
    reals momentum[3];
    const reals toward[3] = {TO_REALS(d.x), TO_REALS(d.y), TO_REALS(d.z)};
#pragma unroll
    ALL_THREE(c) {
        q[c] += onward_here * rest * (across[c] + (R(0.5) * onward_here) * force[c]);
        across[c] += onward_here * force[c];
        momentum[c] = CHOOSE(none, across[c] + lead_rate * toward[c], runs);
    }
    const doubles flown = TO_DOUBLES(length) + more;
    const Triples aside = IN_DOUBLE(q), pushed = IN_DOUBLE(momentum);
    const Triples end = sum_of(ahead_of(p, starts->part.enter + flown, d), aside);
    const reals angle = sqrt(flight->max_deflection) / (real)ambient;
    // The ray stays within the greatest angle about the undisturbed ray.
#if HAS_BODY
    rejected |= !have_clearance(field, arrays, p, d, starts, TO_DOUBLES(angle));
#endif
    rejected |= may_have_left(bounds, last, d, TO_DOUBLES(length), TO_DOUBLES(angle));
    rejected |= TO_TRUTHS(!(angle <= (reals)LEAPFROG_ANGLE)) | !(fabs(path) < (double)INFINITY);
    rejected |= TO_TRUTHS(!(fabs(lateral_error) < (reals)INFINITY)) | (fabs(cosine) <= LEAST_COSINE);
    if (STOP == PLANE) {
        rejected |= fabs(inner_with(VECTOR64(bounds->plane_normal), heading)) <= LEAST_COSINE;
    }
    const double steepest[3] = {control->steepest[0], control->steepest[1], control->steepest[2]};
    rejected |= (fabs(d.x) > steepest[0]) | (fabs(d.y) > steepest[1]) | (fabs(d.z) > steepest[2]);
    lateral_error = CHOOSE(lateral_error, (reals)INFINITY, rejected);
    // If the box's end is the stop, the path is wrong by the whole excess, else by the field's contribution on it.
    // A ray that has left the support must not have left the box before.
    const doubles excess = overrun(
        bounds, control, CHOOSE64(ends_on, (truths)(-1), uniform), choose_triples(end, here, uniform), heading);
    if (SOME(excess > 0.0)) {
        doubles loss = greater_each(fabs(s) / ambient, (doubles)1.0e-30);
        if (STOP == NONE) {
            loss = CHOOSE64((doubles)ambient, loss, uniform);
        }
        const reals lost = TO_REALS(CHOOSE64((doubles)0.0, excess * loss, excess > 0.0));
        lateral_error = GREATER(lateral_error, lost);
    }

    // As the tracer's sums: sigma, S, M and B, of which M - B is the deviation along the ray.
    const Arrivals arrival = end_each(
        bounds, control, p, d, starts, CHOOSE64((truths)(-1), ends_on, runs), aside, pushed,
        (flown - longitudinal_deficit) / ambient, path, arc, arc - longitudinal_deficit);

    // Errors of position and direction count if the ray meets its stop at an angle, and so does the effect of the air
    // outside the field's support on both.
    const Triples deviation_diff = IN_DOUBLE(flight->deviation_diff), momentum_diff = IN_DOUBLE(flight->momentum_diff);
    doubles onward = arrival.flight;
    if (STOP == PLANE) {
        normal = in_all_lanes(VECTOR64(bounds->plane_normal));
    } else {
        onward += more;
    }
    // The error of direction of a deflected ray also has a part along d, which shifts where it meets a far stop.
    const Triples displacement = ahead_of(deviation_diff, onward * rest64, momentum_diff);
    const doubles obliquity = fabs(inner(normal, displacement)) + fabs(rest64 * inner(pushed, displacement));
    const doubles upright = greater_each(fabs(inner(normal, d)), (doubles)STEEPEST_COSINE);
    const reals slipped = control->quadrature_error_scale * TO_REALS(ambient * obliquity / upright);
    lateral_error = GREATER(lateral_error, slipped);
    const doubles tangent = sqrt(greater_each(1.0 - upright * upright, (doubles)0.0)) / upright;
    const doubles greatest_tangent = tangent + TO_DOUBLES(sqrt(flight->max_deflection));
    const reals strayed = off_tail * TO_REALS(ambient * onward * greatest_tangent);
    lateral_error = GREATER(lateral_error, strayed);
    const doubles chord = starts->whole.leave - starts->whole.enter;
    const doubles outside = greater_each(chord - TO_DOUBLES(length), (doubles)0.0);
    const doubles lever_arm = (chord + onward) * greatest_tangent;
    const reals left =
        TO_REALS(outside * ((double)control->left_potential + lever_arm * (double)control->left_slope));
    lateral_error = CHOOSE(
        lateral_error, left, (left > LEFT_SHARE * control->tolerance) & !(lateral_error > left));
#if CUBES
    // The errors of the cubes' polynomials at the samples, and the effect of their slopes up to the stop.
    const reals sway = flight->path.off_slope * (length + TO_REALS(onward));
    lateral_error += flight->path.off + (sway - flight->path.off_moment) * TO_REALS(greatest_tangent);
#endif
    if (arrays->step_bound_start[0] >= 0) {
        const doubles farther = arrival.flight + starts->part.leave - starts->part.enter;
        const reals unseen = with_lever_arm(
            field, missed, TO_REALS(farther), TO_REALS(fabs(inner(normal, d))));
        lateral_error += CHOOSE(none, unseen, missed > none);
    }
    // A deflected ray may miss a plane on the box's edge.
    lateral_error = CHOOSE(lateral_error, (reals)INFINITY, arrival.status != (truths)RAY_OK);
    lateral_error = CHOOSE(flight->error, lateral_error, runs);
    write_packet(
        outputs, control, first, ray_count, &arrival, lateral_error, runs, rejected_count_out);
}

// Trace the packets of a work-item, from ray `first` on.
APART void trace_packets(
    const Field *field,
    const Arrays *arrays,
    const Bounds *bounds,
    const Control *control,
    int first,
    int ray_count,
    __global const double *position_in,
    __global const double *direction_in,
    const RayOutputs *outputs,
    __global int *rejected_count_out)
{
    const real ambient = (real)bounds->ambient;
    Entries in[PACKETS];
    Flying rays[PACKETS];
#pragma unroll
    for (int packet = 0; packet < PACKETS; packet++) {
        // Unused packets repeat the last ray, as unused lanes do.
        in[packet] = enter(
            field, arrays, bounds, control, first + packet * LANES, ray_count, position_in, direction_in);
        rays[packet] = take_off(ambient, &in[packet].path, in[packet].kick);
    }
    take_samples(field, arrays, control, ambient, rays);
#pragma unroll
    for (int packet = 0; packet < PACKETS; packet++) {
        land(control, ambient, &rays[packet]);
        leave(field, arrays, bounds, control, first + packet * LANES, ray_count, position_in, direction_in,
              &in[packet], &rays[packet], outputs, rejected_count_out);
    }
}

__kernel void leapfrog(TRACED_ARGUMENTS, __global int *rejected_count_out)
{
    Arrays arrays = ARRAYS;
#if DESKS
    __local float4 desks[WORK_GROUP * DESK_ROW];
    arrays.desk = desks + get_local_id(0) / WARP * (WARP * DESK_ROW);
#endif
    const int first = (int)get_global_id(0) * (LANES * PACKETS) + first_ray;
    if (first >= ray_count) {
        return;
    }
    const RayOutputs outputs = RAY_OUTPUTS;
    trace_packets(&field, &arrays, &bounds, &control, first, ray_count, position_in, direction_in, &outputs,
                  rejected_count_out);
}
