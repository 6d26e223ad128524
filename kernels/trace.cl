// The ray tracer, one ray per work-item. Its Warp twin, aerokernels/tracing/engines/warp/kernels/trace.py, says what it
// computes and why.
//
// Lengths along the ray inside the field are in sigma, d sigma = ds / n; positions are whole cells and a fraction of a
// cell; q, momentum and the sums are deviations from the undisturbed ray, summed with compensation. Rays first_ray to
// ray_count: position_in [m] and direction_in (ray_count, 3), packed; outputs that are not requested stay unchanged.

#include "arguments.h"
#include "ends.h"
#include "error.h"
#include "event_location.h"
#include "outputs.h"
#include "step.h"

__kernel void trace_kernel(TRACE_KERNEL_ARGUMENTS)
{
    const int ray = (int)get_global_id(0) + first_ray;
    if (ray >= ray_count) {
        return;
    }
    const Arrays arrays = ARRAYS;
    const RayOutputs outputs = RAY_OUTPUTS;
    const double3 p0 = vload3(ray, position_in);
    const double3 d0 = vload3(ray, direction_in);
    Interval interval;
    int status = start_of(&field, &arrays, &bounds, p0, d0, &interval);

    const real3 d = convert_real3(d0);
    const real ambient = (real)bounds.ambient;
    real3 q = (real3)R(0.0), q_carry = q;
    real3 momentum = q, momentum_carry = q;  // P, the deviation of T
    real4 sums = (real4)R(0.0), sums_carry = sums;  // sigma, S, M, B
    real used = R(0.0);
    Bends bends = {R(0.0), R(0.0), R(0.0), R(0.0), R(0.0), R(0.0)};  // errors by kinks
    real max_deflection = R(0.0);  // greatest angle with d so far
    int steps = 0, evaluations = 0, ends_on = -1;
    real obliquity_first = R(0.0), opd_rate = R(0.0);
    real displacement = R(0.0);  // how far sideways the ray may be displaced
    real gain = R(0.0), turned = R(0.0);  // path it may gain behind a face or beside its line; momentum beside it
    int undecided = 0;  // whether it has run in a face, where it may have left the box

    if (interval.meets && status == RAY_OK) {
        int3 cell;
        const double3 entry = p0 + interval.t_enter * d0;
        real3 frac = in_cells(&bounds, entry, &cell), frac_carry = (real3)R(0.0);
        const real3 rate = VECTOR(field.inverse_spacing);
        const real3 cell_rate = VECTOR(control.cell_rate);
        int current_cell = find_current_cell(&field, &arrays, frac, -1);
        // A ray that starts in a face at which the slope jumps flies into the cell whose slope it needs.
        const real3 push_in = AT_FACES ? push_off_faces(frac, d * rate) : (real3)R(0.0);
        const real4 s = sample(&field, &arrays, cell, frac + push_in, current_cell);
        evaluations++;
        real3 force = FORCE(s);
        real pot = AT_FACES ? before_push(s.x, force, push_in, rate) : s.x;
        momentum = HAS_BODY ? starting_momentum(ambient, pot, d, interval.normal) : contrast(ambient, pot) * d;
        max_deflection = HAS_BODY ? size3(momentum - dot(momentum, d) * d) / ambient : R(0.0);
        const int cone = cone_of(d0);
        const StopGeometry to_stop = stop_geometry_of(&bounds, &control, &interval, p0, d0);
        const real obliquity = to_stop.obliquity, lever_arm = to_stop.lever_arm;
        // The table of step bounds weighs the kinks that a step may pass by their effect on the path, not by how they
        // deflect the ray.
        const real derating =
            AT_FACES && obliquity * lever_arm * greatest(cell_rate) > R(1.0) ? R(0.0) : to_stop.derating;
        real greatest_momentum = size3(momentum);
        const real arc_left = (real)(bounds.length - interval.t_enter);
        real aside = R(0.0);  // sideways deviation within which the ray meets no body
        const real near = WALL_ASIDE / greatest(cell_rate);
        if (HAS_BODY && has_clearance(&field, &arrays, p0, d0, interval.t_enter, NEVER, near)) {
            aside = near;
        }
        real h_next = control.extent / ambient;
        real h_cap = h_next;  // reduced after a step that would have ended far behind a surface
        int running = 1;
        while (running) {
            const real3 tangent = ambient * d + momentum;
            const real3 total = IS_STRAIGHT ? ambient * d : tangent;
            const real index = ambient + contrast(ambient, pot);
            const real h_cell = R(1.0) / greater(size3(total * cell_rate), TINY);
            const real h_least = LEAST_STEP / (greatest(cell_rate) * size3(total));
            const Stride ahead = stride(
                &field, &arrays, &control, current_cell, cone, cell, frac, total, force, index, derating, h_cell,
                h_next, h_cap, &to_stop, max_deflection, used + bend_error(&bends));
            const real3 ray_frac = IS_STRAIGHT ? frac + q * rate : frac;
            int event, runs;
            real h = event_location(
                &control, rate, interval.side, cell, ray_frac, tangent, force, ahead.h, &event, &runs);
            if (STOP == ARC) {
                h = arc_event_location(arc_left - (ambient * sums.x + sums.z), index, total, force, h, &event);
            }

            const real hh = h * h;
            const real4 s2 = sample_at_stage(
                &field, &arrays, current_cell, cell, frac, rate, RKN_C2 * h, total, momentum, q,
                (RKN_A21 * hh) * force);
            const real4 s3 = sample_at_stage(
                &field, &arrays, current_cell, cell, frac, rate, RKN_C3 * h, total, momentum, q,
                hh * (RKN_A31 * force + RKN_A32 * FORCE(s2)));
            const real4 s4 = sample_at_stage(
                &field, &arrays, current_cell, cell, frac, rate, h, total, momentum, q, kick_of(h, force, s2, s3));
            evaluations += 3;
            const real3 kick = kick_of(h, force, s2, s3);

            real angle_now, direction_weight, step_displacement;
            real3 bend;
            const real error = step_error(
                ambient, d, total, momentum, h, h <= ahead.safe, max_deflection, &to_stop, pot, force, s2, s3, s4,
                ahead.kinks, &angle_now, &direction_weight, &step_displacement, &bend);
            const real bend_size = size3(MAGNIFIED * bend) / MAGNIFIED;

            // Whether the step ends at the edge of a cell of a mesh, before which it stops.
            const int at_edge = ON_MESH && CONTROLLED && event < 0 && ahead.edge >= 0 && h == ahead.h;
            int accept = 1;
            if (CONTROLLED) {
                const real rounding = step_rounding(&control, h, direction_weight, rate, frac, pot, force, s3);
                real ratio;
                const real limit = attainable_error(&control, ambient, &to_stop, angle_now);
                accept = step_acceptance(
                    limit, error, bend_size, rounding, used + bend_error(&bends), h, h_cell, h_least, index,
                    to_stop.reach, &ratio);
                if (accept) {
                    // A step cut short by a surface is no reason to shorten the next one.
                    h_next = greater(h * ratio, at_edge ? h_next : h_least);
                    if (event >= 0) {
                        h_next = greater(h_next, ahead.h);
                    }
                } else {
                    h_next = greater(h * lesser(ratio, R(0.8)), h_least);
                }
            }

            // If the force changes along the step, the parabola may miss the surface: come closer first.
            int runs_on = 0;  // whether the step ends in a face
            if (accept && h > h_least) {
                const real3 there = ray_frac + (h * tangent + kick) * rate;
                const real3 end_velocity = (tangent + h * FORCE(s4)) * rate;
                real nearest;
                int missed = passed_surface(&control, interval.side, cell, there, event, &nearest);
                if (event >= 0 && event != ARC_SURFACE) {
                    const real close = R(0.05) * greater(ahead.h * size3(total * rate), R(0.01));
                    missed |= overshoots(&control, event, interval.side, cell, there, end_velocity, h, close);
                } else {
                    const real allowance = face_margin(&control, displacement);
                    if (CONTROLLED && nearest <= allowance) {
                        runs_on = in_face(&control, interval.side, cell, there, end_velocity, allowance);
                    }
                }
                if (STOP == ARC && event == ARC_SURFACE) {
                    const real rest = arc_left - (ambient * sums.x + sums.z);
                    missed |= passes_arc(rest, ambient, pot, s2, s3, s4, h);
                }
                if (missed) {
                    accept = 0;
                    h_cap = R(0.5) * h;
                }
            }

            // A step into the body is repeated up to the body's surface, until the rest is short enough for the
            // tangent.
            real behind = R(-1.0);
            if (HAS_BODY && accept && !(size3(q + h * momentum + kick) < aside)) {
                const double3 here = place_of(p0, d0, &interval, bounds.ambient, q, q_carry, sums, sums_carry);
                const real allowance = steps ? WALL_BACK * h_cell : R(0.0);
                behind = behind_wall(&field, &arrays, &control, here, tangent, kick, h, allowance);
                if (behind > WALL_CLOSE * h_cell) {
                    accept = 0;
                    h_cap = (h - behind) + R(0.5) * WALL_CLOSE * h_cell;
                }
            }

            if (accept) {
                h_cap = control.extent / ambient;
                steps++;
                used += error;
                bends = with_bend(&bends, bend, bend_size);
                real late = R(0.0), gain_rate = R(0.0);  // what may be behind a face, and its gain per length
                if (CONTROLLED && (runs || undecided)) {
                    late = undecided
                               ? h
                               : time_beyond_face(&control, rate, interval.side, cell, ray_frac, tangent, force, h);
                    gain_rate = possible_gain(ambient, &to_stop, angle_now, pot, force, s3);
                    gain += late * gain_rate;
                    if (leaves_by_rounding(&control, event, rate, interval.side, cell, ray_frac, tangent)) {
                        gain = NO_ROOT;
                    }
                }
                undecided |= runs_on || late > R(0.0);
                displacement += step_displacement;
                max_deflection = angle_now;
                advance4(&sums, &sums_carry, step_sums(ambient, d, momentum, h, pot, force, s2, s3, s4));
                advance3(&q, &q_carry, h * momentum + kick);
                advance3(&momentum, &momentum_carry, impulse_of(h, force, s2, s3, s4));
                advance3(&frac, &frac_carry, (IS_STRAIGHT ? h * total : h * total + kick) * rate);
                carry_over(&cell, &frac);
                const int cell_before = current_cell;
                const real3 force_rate = AT_FACES ? force_rate_of(h, force, s3, s4) : (real3)R(0.0);
                pot = s4.x;
                force = FORCE(s4);
                const real3 bearing = IS_STRAIGHT ? ambient * d : ambient * d + momentum;
                const real3 curve = IS_STRAIGHT ? (real3)R(0.0) : force;
#if ON_MESH
                const real rest = at_edge ? rest_to_edge(&field, &arrays, ahead.edge, frac, bearing, curve, h) : R(-1.0);
                const int behind_face = CONTROLLED && rest >= R(0.0);
                current_cell = behind_face ? arrays.neighbors[ahead.edge]
                                           : find_current_cell(&field, &arrays, frac, current_cell);
#else
                const int behind_face = AT_FACES;
                const real rest = AT_FACES && event < 0
                                      ? rest_to_face(frac, bearing * rate, curve * rate, ahead.stand_off, h)
                                      : R(0.0);
#endif
                real3 probe = frac;  // where the slope is `force`: at a face, behind it
                real probe_pot = pot;
                if (behind_face) {
                    // The slope jumps at the face before which the step stopped: the ray flies the rest along the
                    // tangent, and the next step starts with the slope behind the face. In a linear cell the slope
                    // changes over the rest as it does at the end of the step.
                    advance4(&sums, &sums_carry, tangent_sums(ambient, d, momentum, rest, pot, force));
                    advance3(&q, &q_carry, rest * momentum + (R(0.5) * rest * rest) * force);
                    advance3(&momentum, &momentum_carry, rest * force + (R(0.5) * rest * rest) * force_rate);
                    advance3(&frac, &frac_carry, (rest * bearing + (R(0.5) * rest * rest) * curve) * rate);
                    carry_over(&cell, &frac);
#if ON_MESH
                    const real doubt =
                        bend_arm(&to_stop, angle_now) * edge_rounding(&field, &arrays, ahead.edge, frac, bearing, h);
                    bends = with_bend(&bends, (real3)R(0.0), doubt);
                    const real4 beyond = sample_in(&field, &arrays, current_cell, frac);
                    pot = beyond.x;
                    force = FORCE(beyond);
                    if (IS_STRAIGHT) {
                        pot += dot(force, q);
                        probe = frac;
                        probe_pot = pot;
                    }
#else
                    const real over = AT_FACE / size3(bearing * rate);
                    const real3 push = push_off_faces(frac, bearing * rate);
                    const real4 beyond = sample(
                        &field, &arrays, cell, frac + over * (bearing * rate) + push, current_cell);
                    force = FORCE(beyond);
                    pot = before_push(beyond.x - over * dot(force, bearing), force, push, rate);
                    if (IS_STRAIGHT) {
                        pot += dot(force, q);
                        probe = frac + over * (bearing * rate) + push;
                        probe_pot = beyond.x + dot(force, q);
                    }
#endif
                    evaluations++;
                }
                if (CONSISTENT_GRADIENT || (ON_MESH && (cell_before < 0) != (current_cell < 0))) {
                    // Project back onto |T| = n: this removes the error along the ray, which would add to the path, and
                    // follows the jump of the index between a gap in a mesh and its cells, which no force tells.
                    const real3 projecting = project_momentum(ambient, d, momentum, pot);
                    momentum += projecting;
                    if (IS_STRAIGHT) {
                        q += (R(0.5) * h) * projecting;  // the error grew linearly over the step
                    }
                }
                greatest_momentum = greater(greatest_momentum, size3(momentum));

                if (CONTROLLED && IS_STRAIGHT) {
                    real turn;
                    gain += sample_neglected(
                        &field, &arrays, current_cell, cell, probe, rate, total, q, probe_pot, force, h, h_cell,
                        &turn);
                    turned += turn;
                    evaluations++;
                }

                real back = R(0.0);  // sigma still to go along the tangent, negative to go back
                if (behind >= R(0.0)) {
                    back = -behind;
                    running = 0;
                    status = RAY_HIT_BODY;
                }
                if (running && event >= 0) {
                    int done = 0;
                    if (STOP == ARC && event == ARC_SURFACE) {
                        const real rest = arc_left - (ambient * sums.x + sums.z);
                        back = arc_surface_intersection(
                            rest, ambient + contrast(ambient, pot), ambient * d + momentum, force, arc_left, h, &done);
                    } else {
                        const real3 now = IS_STRAIGHT ? frac + q * rate : frac;
                        const real3 velocity = (ambient * d + momentum) * rate;
                        back = surface_intersection(
                            &control, event, interval.side, cell, now, velocity, force * rate, h, h_cell, &done);
                    }
                    if (done) {
                        running = 0;
                        ends_on = event;
                        gain -= clamp(-back, R(0.0), late) * gain_rate;  // it is not flown after all
                    }
                }
                if (back != R(0.0)) {
                    advance4(&sums, &sums_carry, tangent_sums(ambient, d, momentum, back, pot, force));
                    advance3(&q, &q_carry, back * momentum + (R(0.5) * back * back) * force);
                    advance3(&momentum, &momentum_carry, back * force);
                }
                if (running && steps >= control.max_steps) {
                    running = 0;
                    status = RAY_MAX_STEPS;
                }
            } else if (evaluations / 12 > control.max_steps) {
                running = 0;
                status = RAY_MAX_STEPS;
            }
            if (!(isfinite(size3(q)) && isfinite(sums.y))) {
                running = 0;
                status = RAY_NOT_FINITE;
            }
        }
        if (CONTROLLED) {
            used += bend_error(&bends);
            used += turned * (obliquity + STRAIGHT_LEVER * max_deflection) * lever_arm;
            // A stop met at a slant magnifies errors of place and direction; without a stop, the gain is a length.
            if (STOP != NONE) {
                used += gain;
                gain = R(0.0);
            }
            used = stop_error(
                used, &bounds, &control, d0, ambient, greatest_momentum, max_deflection, &to_stop, displacement);
            obliquity_first = obliquity;
            opd_rate = (fabs(pot) + size3(force) * (obliquity + max_deflection) * lever_arm) / ambient;
        }
    }

    Arrival arrival = end_of(
        &bounds, &control, p0, d0, &interval, status, ends_on, q, q_carry, momentum, sums, sums_carry,
        max_deflection);
    if (CONTROLLED && arrival.status == RAY_OK && ends_on >= 0) {
        const real cell_size = R(1.0) / greatest(VECTOR(control.cell_rate));
        used = event_location_error(
            used, ambient, cell_size, ends_on, arrival.grazing, obliquity_first, opd_rate, displacement);
    }
    used += gain;
    if (CONTROLLED) {
        arrival.status = judged_status(arrival.status, control.tolerance, &used);
    }
    write_outputs(
        &outputs, control.outputs, ray, &arrival, MEASURED ? (double)used : 0.0, steps, evaluations);
}
