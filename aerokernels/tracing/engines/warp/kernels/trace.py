r"""The ray tracer as a Warp kernel, one ray per thread.

Equation. r'' = grad s with the optical potential s = (n^2 - a^2) / 2, T = r' = n dr/ds, d sigma = ds / n,
optical path' = n^2 = a^2 + 2 s (A. Sharma, D. V. Kumar, A. K. Ghatak, Appl. Opt. 21 (1982) 984), integrated by the
Runge-Kutta-Nystrom pair of tableau.py: order 4, three field evaluations per step.

Deviation form. With n = a + m (ambient + contrast) and the straight ray p + d a sigma:

    r = p + d a sigma + q,   T = a d + P,   q' = P,   P' = grad s,   P(0) = m d
    optical path = a^2 sigma + 2 S,   S = int s d sigma
    arc length   = a sigma + M,       M = int m d sigma,   m = 2 s / (n + a)

q, P, S and M are small and summed with compensation, so float32 is accurate enough; the start of a ray, the free flight
outside the box and the intersection with the stop are float64. After each step T is projected back to |T| = n. The
optical path difference against the undisturbed ray at the same stop is 2 S + a (distance along d at the stop - that of
the undisturbed ray).

Method "straight" evaluates the field along p + d a sigma and adds grad s . q: the optical path is correct to second
order in the contrast, position and direction to first order.
"""

import warp as wp

from ....scheme import ARC_SURFACE, LEAST_STEP, MAGNIFIED, STRAIGHT_LEVER, TINY, WALL_ASIDE, WALL_BACK, WALL_CLOSE
from ....stop import RayStatus
from ....tableau import A, C, has_consistent_gradient
from ..library import Scene, built_once
from .crossings import NEVER
from .edges import build_edges
from .ends import build_ends
from .error import build_bends, build_error
from .event_location import build_event_location
from .grid import build_grid
from .mesh import build_mesh
from .motion import advance, build_cells, build_motion
from .outputs import build_write_outputs
from .step import build_step
from .step_bound import build_step_bound
from .wall import build_wall


@built_once("geometry", "interpolation", "on_mesh", "method", "stop", "has_body", "measured")
def build_kernel(scene: Scene):
    """Build the kernel for one kind of scene; Warp compiles it at its first launch and caches it on disk.

    Unless `measured`, the kernel neither estimates nor returns the errors of steps; error control needs them.
    """
    interpolation, on_mesh, method = scene.interpolation, scene.on_mesh, scene.method
    stop, has_body, measured = scene.stop, scene.has_body, scene.measured
    t = scene.types
    real, vec3 = t.real, t.vec3
    air = build_mesh(scene) if on_mesh else build_grid(scene)
    cells, motion, ends, wall = build_cells(scene), build_motion(scene), build_ends(scene), build_wall(scene)
    stepping, blocks, edges = build_step(scene), build_step_bound(scene), build_edges(scene)
    errors, kinks, surfaces = build_error(scene), build_bends(scene), build_event_location(scene)
    write_outputs = build_write_outputs(scene)
    controlled, straight = method in ("adaptive", "straight"), method == "straight"
    consistent_gradient = has_consistent_gradient(interpolation)
    arc_surface = wp.constant(ARC_SURFACE)
    at_faces, at_edges = interpolation == "linear" and controlled, on_mesh and controlled
    tiny = TINY[scene.precision]
    c2, c3, a21, a31, a32 = (float(v) for v in (*C[1:3], A[1, 0], A[2, 0], A[2, 1]))
    ends_of = RayStatus.OK, RayStatus.HIT_BODY, RayStatus.MAX_STEPS, RayStatus.NOT_FINITE
    ok, hit_body, max_steps, not_finite = map(int, ends_of)

    @wp.func
    def trace_ray(
        field: t.Field,
        bounds: t.Bounds,
        control: t.Control,
        ray: int,
        p0: wp.vec3d,
        d0: wp.vec3d,
        outputs: t.RayOutputs,
    ):
        """Traces one ray and writes its outputs."""
        status, interval = ends.start_of(field, bounds, p0, d0)
        d = vec3(real(d0[0]), real(d0[1]), real(d0[2]))
        ambient = real(bounds.ambient)
        q = vec3(real(0.0), real(0.0), real(0.0))
        q_carry = q
        momentum = q  # P, the deviation of T
        momentum_carry = q  # (assigned together by `a, b = q, q` both would change with one another in Warp)
        sums = t.vec4(real(0.0), real(0.0), real(0.0), real(0.0))  # sigma, S, M, B
        sums_carry = sums
        used, max_deflection = real(0.0), real(0.0)  # error; greatest angle with d so far
        bends = t.Bends()  # errors by kinks
        steps, evaluations, ends_on = int(0), int(0), int(-1)
        obliquity_first, opd_rate = real(0.0), real(0.0)
        displacement = real(0.0)  # how far sideways the ray may be displaced
        gain, turned = real(0.0), real(0.0)  # path it may gain behind a face or beside its line; momentum beside it
        undecided = bool(False)  # whether it has run in a face, where it may have left the box

        if interval.meets and status == ok:
            frac, cell = cells.in_cells(bounds, p0 + interval.t_enter * d0)
            frac_carry = vec3(real(0.0), real(0.0), real(0.0))
            rate = field.inverse_spacing
            current_cell = air.find_current_cell(field, frac, -1)  # the cell of a mesh
            pot, force = stepping.first_sample(field, cell, frac, current_cell, d)
            evaluations += 1
            momentum = motion.contrast(ambient, pot) * d
            if wp.static(has_body):
                momentum = wall.starting_momentum(ambient, pot, d, interval.normal)
                max_deflection = wp.length(momentum - wp.dot(momentum, d) * d) / ambient
            cone = blocks.cone_of(d0)
            to_stop = ends.stop_geometry_of(bounds, control, interval, p0, d0)
            obliquity, lever_arm, reach = to_stop.obliquity, to_stop.lever_arm, to_stop.reach
            derating = real(to_stop.derating)
            if wp.static(at_faces):
                # The table of step bounds weighs the kinks that a step may pass by their effect on the path alone.
                if obliquity * lever_arm * wp.max(control.cell_rate) > real(1.0):
                    derating = real(0.0)
            greatest_momentum, arc_left = wp.length(momentum), real(bounds.length - interval.t_enter)
            aside = real(0.0)  # sideways deviation within which the ray meets no body
            if wp.static(has_body):
                near = real(WALL_ASIDE) / wp.max(control.cell_rate)
                if wall.has_clearance(field, p0, d0, interval.t_enter, wp.float64(NEVER), wp.float64(near)):
                    aside = near
            h_next = control.extent / ambient
            h_cap = h_next  # reduced after a step that would have ended far behind a surface
            running = bool(True)
            while running:
                tangent = ambient * d + momentum
                total = tangent
                index = ambient + motion.contrast(ambient, pot)
                if wp.static(straight):
                    total = ambient * d
                h_cell = real(1.0) / wp.max(wp.length(wp.cw_mul(total, control.cell_rate)), real(tiny))
                h_least = real(LEAST_STEP) / (wp.max(control.cell_rate) * wp.length(total))
                spent = used + kinks.bend_error(bends)
                ahead = stepping.stride(
                    field,
                    control,
                    current_cell,
                    cone,
                    cell,
                    frac,
                    total,
                    force,
                    index,
                    derating,
                    h_cell,
                    h_next,
                    h_cap,
                    to_stop,
                    max_deflection,
                    spent,
                )
                ray_frac = frac
                if wp.static(straight):
                    ray_frac = frac + wp.cw_mul(q, rate)
                h, event, runs = surfaces.event_location(
                    control, rate, interval.side, cell, ray_frac, tangent, force, ahead.h
                )
                if wp.static(stop == "arc"):
                    rest = arc_left - (ambient * sums[0] + sums[2])
                    h, event = surfaces.arc_event_location(rest, index, total, force, h, event)

                # The later stages are inline: in a function of their own they are slower.
                kick2 = (real(a21) * (h * h)) * force
                s2 = stepping.sample_at_stage(
                    field, current_cell, cell, frac, rate, real(c2) * h, total, momentum, q, kick2
                )
                force2 = vec3(s2[1], s2[2], s2[3])
                kick3 = (h * h) * (real(a31) * force + real(a32) * force2)
                s3 = stepping.sample_at_stage(
                    field, current_cell, cell, frac, rate, real(c3) * h, total, momentum, q, kick3
                )
                kick = stepping.kick_of(h, force, s2, s3)
                s4 = stepping.sample_at_stage(field, current_cell, cell, frac, rate, h, total, momentum, q, kick)
                force4 = vec3(s4[1], s4[2], s4[3])
                evaluations += 3
                error, angle_now, direction_weight, step_displacement, bend = errors.step_error(
                    ambient,
                    d,
                    total,
                    momentum,
                    h,
                    h <= ahead.safe,
                    max_deflection,
                    to_stop,
                    pot,
                    force,
                    s2,
                    s3,
                    s4,
                    ahead.kinks,
                )
                bend_size = wp.length(real(MAGNIFIED) * bend) / real(MAGNIFIED)
                # Whether the step ends at the edge of a cell of a mesh, before which it stops.
                at_edge = bool(event < 0 and ahead.edge >= 0 and h == ahead.h)

                accept = bool(True)
                if wp.static(controlled):
                    rounding = errors.step_rounding(control, h, direction_weight, rate, frac, pot, force, s3)
                    limit = errors.attainable_error(control, ambient, to_stop, angle_now)
                    accept, ratio = stepping.step_acceptance(
                        limit, error, bend_size, rounding, spent, h, h_cell, h_least, index, reach
                    )
                    if accept:
                        # A step cut short by a surface is no reason to shorten the next one.
                        h_next = wp.max(h * ratio, wp.where(at_edge, h_next, h_least))
                        if event >= 0:
                            h_next = wp.max(h_next, ahead.h)
                    else:
                        h_next = wp.max(h * wp.min(ratio, real(0.8)), h_least)

                # If the force changes along the step, the parabola may miss the surface: come closer first.
                runs_on = bool(False)  # whether the step ends in a face
                if accept and h > h_least:
                    there = ray_frac + wp.cw_mul(h * (tangent) + kick, rate)
                    end_velocity = wp.cw_mul(tangent + h * force4, rate)
                    missed, nearest = surfaces.passed_surface(control, interval.side, cell, there, event)
                    if event >= 0 and event != arc_surface:
                        near = real(0.05) * wp.max(ahead.h * wp.length(wp.cw_mul(total, rate)), real(0.01))
                        missed = missed or surfaces.overshoots(
                            control, event, interval.side, cell, there, end_velocity, h, near
                        )
                    else:
                        allowance = surfaces.face_margin(control, displacement)
                        if wp.static(controlled) and nearest <= allowance:
                            runs_on = surfaces.in_face(control, interval.side, cell, there, end_velocity, allowance)
                    if wp.static(stop == "arc"):
                        missed = missed or (
                            event == arc_surface and surfaces.passes_arc(rest, ambient, pot, s2, s3, s4, h)
                        )
                    if missed:
                        accept = bool(False)
                        h_cap = real(0.5) * h

                # A step into the body is repeated up to its surface, until the rest is short enough for the tangent.
                behind = real(-1.0)
                if wp.static(has_body):
                    if accept and not (wp.length(q + h * momentum + kick) < aside):
                        here = wall.place_of(p0, d0, interval, bounds.ambient, q, q_carry, sums, sums_carry)
                        allowance = real(wp.min(steps, 1)) * real(WALL_BACK) * h_cell
                        behind = wall.behind_wall(field, control, here, tangent, kick, h, allowance)
                        if behind > real(WALL_CLOSE) * h_cell:
                            accept = bool(False)
                            h_cap = (h - behind) + real(0.5) * real(WALL_CLOSE) * h_cell

                if accept:
                    h_cap = control.extent / ambient
                    steps, used = steps + 1, used + error
                    late, gain_rate = real(0.0), real(0.0)  # what may be behind a face, and its gain per length
                    if wp.static(controlled):
                        if runs or undecided:
                            late = h
                            if not undecided:
                                late = surfaces.time_beyond_face(
                                    control, rate, interval.side, cell, ray_frac, tangent, force, h
                                )
                            gain_rate = errors.possible_gain(ambient, to_stop, angle_now, pot, force, s3)
                            gain += late * gain_rate
                            if surfaces.leaves_by_rounding(
                                control, event, rate, interval.side, cell, ray_frac, tangent
                            ):
                                gain = real(1.0e30)
                        undecided = undecided or runs_on or late > real(0.0)
                    bends = kinks.with_bend(bends, bend, bend_size)
                    displacement += step_displacement
                    max_deflection = angle_now
                    added = motion.step_sums(ambient, d, momentum, h, pot, force, s2, s3, s4)
                    sums, sums_carry = advance(sums, sums_carry, added)
                    q, q_carry = advance(q, q_carry, h * momentum + kick)
                    momentum, momentum_carry = advance(
                        momentum, momentum_carry, stepping.impulse_of(h, force, s2, s3, s4)
                    )
                    flown = h * total
                    if wp.static(not straight):
                        flown += kick
                    frac, frac_carry = advance(frac, frac_carry, wp.cw_mul(flown, rate))
                    cell, frac = cells.carry_over(cell, frac)
                    force_rate = real(0.0) * d
                    if wp.static(at_faces):
                        force_rate = stepping.force_rate_of(h, force, s3, s4)
                    pot, force = s4[0], force4
                    bearing, curve = ambient * d + momentum, force
                    if wp.static(straight):
                        bearing, curve = ambient * d, vec3(real(0.0), real(0.0), real(0.0))
                    cell_before = int(current_cell)
                    rest, behind_face = real(0.0), bool(wp.static(at_faces))
                    if wp.static(at_edges):
                        if at_edge:
                            rest = edges.rest_to_edge(field, ahead.edge, frac, bearing, curve, h)
                            behind_face = bool(rest >= real(0.0))
                    elif wp.static(at_faces):
                        if event < 0:
                            rest = stepping.rest_to_face(
                                frac, wp.cw_mul(bearing, rate), wp.cw_mul(curve, rate), ahead.stand_off, h
                            )
                    if wp.static(at_edges) and behind_face:
                        current_cell = field.neighbors[ahead.edge]
                    else:
                        current_cell = air.find_current_cell(field, frac, current_cell)
                    probe, probe_pot = frac, pot  # where the slope is `force`: at a face, behind it
                    if behind_face:
                        # The slope jumps at the face before which the step stopped: the ray flies the rest along the
                        # tangent, and the next step starts with the slope behind the face. In a linear cell the slope
                        # changes over the rest as it does at the end of the step.
                        added = motion.tangent_sums(ambient, d, momentum, rest, pot, force)
                        sums, sums_carry = advance(sums, sums_carry, added)
                        q, q_carry = advance(q, q_carry, rest * momentum + (real(0.5) * rest * rest) * force)
                        impulse = rest * force + (real(0.5) * rest * rest) * force_rate
                        momentum, momentum_carry = advance(momentum, momentum_carry, impulse)
                        flown = rest * bearing + (real(0.5) * rest * rest) * curve
                        frac, frac_carry = advance(frac, frac_carry, wp.cw_mul(flown, rate))
                        cell, frac = cells.carry_over(cell, frac)
                        if wp.static(at_edges):
                            doubt = kinks.bend_arm(to_stop, angle_now) * edges.edge_rounding(
                                field, ahead.edge, frac, bearing, h
                            )
                            bends = kinks.with_bend(bends, real(0.0) * d, doubt)
                        pot, force, probe, probe_pot = stepping.slope_behind(
                            field, cell, frac, current_cell, bearing, q
                        )
                        evaluations += 1
                    if wp.static(consistent_gradient) or (cell_before < 0) != (current_cell < 0):
                        # Project back onto |T| = n: this removes the error along the ray, which would add to the path,
                        # and follows the jump of the index between a gap in a mesh and its cells, which no force tells.
                        projecting = motion.project_momentum(ambient, d, momentum, pot)
                        momentum += projecting
                        if wp.static(straight):
                            q += (real(0.5) * h) * projecting  # the error grew linearly over the step
                    greatest_momentum = wp.max(greatest_momentum, wp.length(momentum))
                    if wp.static(controlled and straight):
                        beside = stepping.sample_neglected(
                            field, current_cell, cell, probe, rate, total, q, probe_pot, force, h, h_cell
                        )
                        gain, turned, evaluations = gain + beside[0], turned + beside[1], evaluations + 1

                    back = real(0.0)  # sigma still to go along the tangent, negative to go back
                    if behind >= real(0.0):
                        back = -behind
                        running = bool(False)
                        status = int(hit_body)
                    if running and event >= 0:
                        done = bool(False)
                        if event == arc_surface:
                            rest, index = (
                                arc_left - (ambient * sums[0] + sums[2]),
                                ambient + motion.contrast(ambient, pot),
                            )
                            total = ambient * d + momentum
                            back, done = surfaces.arc_surface_intersection(rest, index, total, force, arc_left, h)
                        else:
                            ray_frac = frac
                            if wp.static(straight):
                                ray_frac = frac + wp.cw_mul(q, rate)
                            velocity, slope = wp.cw_mul(ambient * d + momentum, rate), wp.cw_mul(force, rate)
                            back, done = surfaces.surface_intersection(
                                control, event, interval.side, cell, ray_frac, velocity, slope, h, h_cell
                            )
                        if done:
                            running = bool(False)
                            ends_on = event
                            gain -= wp.clamp(-back, real(0.0), late) * gain_rate  # it is not flown after all
                    if back != real(0.0):
                        added = motion.tangent_sums(ambient, d, momentum, back, pot, force)
                        sums, sums_carry = advance(sums, sums_carry, added)
                        q, q_carry = advance(q, q_carry, back * momentum + (real(0.5) * back * back) * force)
                        momentum, momentum_carry = advance(momentum, momentum_carry, back * force)
                    if running and steps >= control.max_steps:
                        running = bool(False)
                        status = int(max_steps)
                elif evaluations // 12 > control.max_steps:
                    running = bool(False)
                    status = int(max_steps)
                if not (wp.isfinite(wp.length(q)) and wp.isfinite(sums[1])):
                    running = bool(False)
                    status = int(not_finite)
            if wp.static(controlled):
                used += kinks.bend_error(bends)
                used += turned * (obliquity + real(STRAIGHT_LEVER) * max_deflection) * lever_arm
                # A stop met at a slant magnifies errors of place and direction; without a stop, the gain is a length.
                if wp.static(stop != "none"):
                    used, gain = used + gain, real(0.0)
                used = errors.stop_error(
                    used, bounds, control, d0, ambient, greatest_momentum, max_deflection, to_stop, displacement
                )
                obliquity_first = obliquity
                opd_rate = (wp.abs(pot) + wp.length(force) * (obliquity + max_deflection) * lever_arm) / ambient

        arrival = ends.end_of(
            bounds, control, p0, d0, interval, status, ends_on, q, q_carry, momentum, sums, sums_carry, max_deflection
        )
        step_error_out = wp.float64(0.0)
        if wp.static(controlled):
            if arrival.status == ok and ends_on >= 0:
                size = real(1.0) / wp.max(control.cell_rate)
                used = errors.event_location_error(
                    used, ambient, size, ends_on, arrival.grazing, obliquity_first, opd_rate, displacement
                )
            used += gain
            judged, used = kinks.judged_status(arrival.status, control.tolerance, used)
            arrival.status = judged
        if wp.static(measured):
            step_error_out = wp.float64(used)
        write_outputs(outputs, control.outputs, ray, arrival, step_error_out, steps, evaluations)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_kernel(
        field: t.Field,
        bounds: t.Bounds,
        control: t.Control,
        first_ray: int,
        position_in: wp.array(dtype=wp.vec3d),
        direction_in: wp.array(dtype=wp.vec3d),
        outputs: t.RayOutputs,
    ):
        # The second index is always 0. With one index Warp compiles the kernel twice for a CPU, for arrays without gaps
        # and for others, which takes half as long again.
        thread, _ = wp.tid()
        ray = thread + first_ray
        trace_ray(field, bounds, control, ray, position_in[ray], direction_in[ray], outputs)

    return trace_kernel
