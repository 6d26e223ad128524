r"""The ray tracer as a Warp kernel.

Equation. r'' = grad s with the optical potential s = (n^2 - a^2) / 2, T = r' = n dr/ds, d sigma = ds / n,
optical path' = n^2 = a^2 + 2 s (A. Sharma, D. V. Kumar, A. K. Ghatak, Appl. Opt. 21 (1982) 984), moved by the
Runge-Kutta-Nystrom pair of tableau.py: order 4, three field evaluations a step.

Deviation form. With n = a + m (ambient + contrast) and the straight ray p + d a sigma:

    r = p + d a sigma + q,   T = a d + P,   q' = P,   P' = grad s,   P(0) = m d
    optical path = a^2 sigma + 2 S,   S = int s d sigma
    arc length   = a sigma + M,       M = int m d sigma,   m = 2 s / (n + a)

q, P, S and M are small and summed with compensation, so float32 loses nothing that matters; a ray's start, the free
flight outside the box and the meeting with the stop are float64. After each step T is brought back to |T| = n. The
optical path difference against the undisturbed ray at the same stop is 2 S + a (distance along d at the stop - that of
the undisturbed ray).

Method "straight" looks the field up along p + d a sigma and adds grad s . q: the optical path is right to second order
in the contrast, position and direction to first order.

Along d. On a nearly straight ray q . d enters the path difference in first order and, as a twofold sum of slopes, would
bring in their error. It is int (T . d - a) d sigma = M - B with B = int (n - T . d) d sigma of second order: sums of
values, taken by the rule of the path itself. So the OPD of a ray through a shock is as good as the quadrature of S.

Error control. A step's error is the embedded formula's in S, in position and in momentum, the latter two weighted by
how much they can matter further on. On a nearly straight ray the error of S is known better, from a rule of degree 7
that also uses the slopes along the ray. How far a step may look ahead says the table of quiet.py; the faces of cells
are the ends of steps where the interpolant has kinks there.

Stop. The step is shortened to where its parabola first meets a surface, by the root of the quadratic; the rest, of
third order in the step, is flown along the tangent; the distance along d is then solved for in float64.
"""

import functools

import warp as wp

from . import warp_grid, warp_mesh
from .status import RayStatus
from .tableau import BT, NEARLY_STRAIGHT, START_FROM_LATER, A, B, C, is_one_scalar
from .warp_box import FACE_COUNT, build_crossing, build_detour, build_meeting
from .warp_error import build_step_error
from .warp_motion import advance, build_cells, build_contrast, build_lag, build_landing, build_look, deflection
from .warp_reach import HAIR, build_cone, build_reach, build_to_face
from .warp_types import types
from .warp_wall import build_clear_way, build_wall_distance, build_way_out

# Greatest distance before a face, in cells, at which a step across a kinked interpolant's cell may stop.
SHIEST = 1e-3
# The share of the remaining error budget that one step may use up, however short it is.
STEP_SHARE = 0.02
# Steps in cells from which down an error estimate may be taken for rounding.
NOISE_STEP = 0.5


@functools.cache
def build_kernel(
    precision: str,
    geometry: str,
    interpolation: str,
    on_mesh: bool,
    method: str,
    stop: str,
    has_body: bool,
    outputs: frozenset,
):
    """Build the kernel for one kind of scene; Warp compiles it at its first launch and keeps it on disk."""
    t = types(precision)
    real, vec3, Field, Bounds, Control = t.real, t.vec3, t.Field, t.Bounds, t.Control
    source = warp_mesh if on_mesh else warp_grid
    sample = source.build_sample(precision, geometry, interpolation)
    paper_step = source.build_paper_step(precision, geometry)
    cone_of = build_cone(geometry)
    reach_of = build_reach(precision, "mesh" if on_mesh else geometry)
    to_face = build_to_face(precision, geometry)
    crossing = build_crossing(precision, geometry)
    meeting = build_meeting(precision, geometry)
    detour = build_detour(precision, geometry)
    wall_distance = build_wall_distance(precision, geometry)
    way_out = build_way_out(precision, geometry)
    wall_at, clear_way = build_clear_way(precision, geometry)
    contrast = build_contrast(precision)
    lag, lag_sum = build_lag(precision)
    in_cells, carry_over = build_cells(precision, "mesh" if on_mesh else geometry)
    oriented, surface_unit, landing = build_landing(precision, geometry, stop)
    step_error, step_rounding = build_step_error(precision, geometry, interpolation)
    look = build_look(precision, sample, method == "straight")
    face_count = wp.constant(FACE_COUNT[geometry])
    landed_arc = wp.constant(100)
    tiny = 1e-30 if precision == "float32" else 1e-290
    least_step = 1e-4  # of a cell: error control does not ask for less
    straight = method == "straight"
    one_scalar = is_one_scalar(interpolation)
    controlled = method in ("adaptive", "straight")
    kinked = interpolation in ("linear", "monotone") and controlled

    c2, c3 = (float(v) for v in C[1:3])
    a21, a31, a32 = float(A[1, 0]), float(A[2, 0]), float(A[2, 1])
    w2, w3, w4 = (float(v) for v in START_FROM_LATER)
    b1, b2, b3 = (float(v) for v in B[:3])
    v1, v2, v3, v4 = (float(v) for v in BT)
    ok, missed, not_reached = int(RayStatus.OK), int(RayStatus.MISSED_FIELD), int(RayStatus.STOP_NOT_REACHED)
    hit_body, inside_body = int(RayStatus.HIT_BODY), int(RayStatus.INSIDE_BODY)
    too_many, not_finite = int(RayStatus.MAX_STEPS), int(RayStatus.NOT_FINITE)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_kernel(
        field: Field,
        bounds: Bounds,
        control: Control,
        first_ray: int,
        position_in: wp.array(dtype=wp.vec3d),
        direction_in: wp.array(dtype=wp.vec3d),
        position_out: wp.array(dtype=wp.vec3d),
        direction_out: wp.array(dtype=wp.vec3d),
        optical_path_out: wp.array(dtype=wp.float64),
        opd_out: wp.array(dtype=wp.float64),
        arc_length_out: wp.array(dtype=wp.float64),
        step_error_out: wp.array(dtype=wp.float64),
        step_count_out: wp.array(dtype=wp.int32),
        evaluation_count_out: wp.array(dtype=wp.int32),
        status_out: wp.array(dtype=wp.int32),
    ):
        ray = wp.tid() + first_ray
        p0 = position_in[ray]
        d0 = direction_in[ray]
        ambient64 = bounds.ambient
        none64 = wp.float64(0.0)
        status = int(ok)

        # Where the undisturbed ray stops, and whether it meets the box before.
        span = crossing(bounds, p0, d0)
        enter = wp.max(span[0], none64)
        meets = span[0] <= span[1] and span[1] >= none64
        stop_distance = span[1]
        has_undisturbed = bool(True)
        side = real(1.0)
        if wp.static(stop == "plane"):
            height = wp.dot(bounds.plane_normal, p0 - bounds.plane_point)
            slope = wp.dot(bounds.plane_normal, d0)
            stop_distance = none64
            if height != none64:
                has_undisturbed = bool(height * slope < none64)
                if has_undisturbed:
                    stop_distance = -height / slope
            if height > none64:
                side = real(-1.0)
        if wp.static(stop == "arc"):
            stop_distance = bounds.length
        if meets and has_undisturbed and wp.static(stop != "none"):
            meets = stop_distance > enter
        if wp.static(stop == "none"):
            if meets and span[1] > wp.float64(1.0e299):
                status = int(not_reached)  # along x in a planar field, which has no end there

        # A ray that starts behind the body's surface begins where it leaves it.
        if wp.static(has_body):
            if meets:
                enter, solid = way_out(field, p0, d0, enter, span[1])
                if solid:
                    status = int(inside_body)
                if has_undisturbed and wp.static(stop != "none"):
                    if stop_distance <= enter:
                        meets = bool(False)
                        status = int(ok)

        d = vec3(real(d0[0]), real(d0[1]), real(d0[2]))
        ambient = real(ambient64)
        q = vec3(real(0.0), real(0.0), real(0.0))
        q_carry = q
        momentum = q  # P, the deviation of T
        momentum_carry = q
        sums = t.vec4(real(0.0), real(0.0), real(0.0), real(0.0))  # sigma, S, M, B
        sums_carry = sums
        used = real(0.0)
        bent = real(0.0)  # greatest angle with d so far
        steps = int(0)
        evaluations = int(0)
        landed = int(-1)

        if meets and status == ok:
            cell, frac = in_cells(bounds, p0 + enter * d0)
            frac_carry = vec3(real(0.0), real(0.0), real(0.0))
            rate = field.inverse_spacing
            s = sample(field, cell, frac)
            evaluations += 1
            pot = s[0]
            force = vec3(s[1], s[2], s[3])
            momentum = contrast(ambient, pot) * d
            far = span[1]
            if has_undisturbed and wp.static(stop != "none"):
                far = wp.min(far, stop_distance)
            cone = cone_of(d0)
            reach = wp.min(real(wp.min(far - enter, wp.float64(1.0e30))), control.extent)
            arc_left = real(bounds.length - enter)
            gap = real(0.0)
            if wp.static(has_body):
                start = p0 + enter * d0
                gap = wp.max(wall_distance(field, vec3(real(start[0]), real(start[1]), real(start[2]))), real(0.0))
            h_next = control.extent / ambient
            h_cap = h_next  # shorter after a step that would have ended well behind a surface
            running = bool(True)
            while running:
                total = ambient * d + momentum
                m = contrast(ambient, pot)
                if wp.static(straight):
                    total = ambient * d
                h = h_next
                safe = real(0.0)
                shy = real(0.1 * HAIR)
                h_cell = real(1.0) / wp.max(wp.length(wp.cw_mul(total, control.cell_rate)), real(tiny))
                h_least = real(least_step) / (wp.max(control.cell_rate) * wp.length(total))
                if wp.static(method == "fixed"):
                    h = control.step / (ambient + m)
                elif wp.static(method == "paper"):
                    h = paper_step(field, cell, frac) / (ambient + m)
                else:
                    limit = control.step_limit * h_cell
                    if wp.static(kinked):
                        # The interpolant has kinks at the cells' faces: no step across one.
                        pace = wp.cw_mul(total, rate)
                        pull = wp.cw_mul(force, rate)
                        if wp.static(interpolation == "linear"):
                            # In cells, how far before a face to stop: a share of the bend over a cell, whose change
                            # over the step the parabola does not know.
                            bend = real(0.15) * wp.length(pull) / wp.dot(pace, pace)
                            shy = real(0.1 * HAIR) + wp.min(bend, real(SHIEST))
                        limit = to_face(cell, frac, pace, pull, real(10.0) * shy) - shy / wp.length(pace)
                    # Short of the face at which the first rough block may begin.
                    safe = reach_of(control, cone, cell, frac, total) - real(10.0 * HAIR) * h_cell
                    h = wp.min(h, wp.max(limit, safe))
                h = wp.min(h, h_cap)
                wanted = h
                if wp.static(controlled and has_body):
                    # No further than the way ahead is known to be clear, so that no step jumps over the body.
                    h = clear_way(field, bounds, cell, frac, rate, total, force, gap, h)
                cut = bool(h < wanted)
                shown = frac
                if wp.static(straight):
                    shown = frac + wp.cw_mul(q, rate)
                h_free = h
                h, land = landing(control, rate, side, cell, shown, ambient * d + momentum, force, h)
                if wp.static(stop == "arc"):
                    rest = arc_left - (ambient * sums[0] + sums[2])
                    n = ambient + m
                    bend = wp.dot(force, total) / n
                    if h * (n + real(0.5) * bend * h) >= rest:
                        h_arc = wp.min(rest / n, h)
                        h = wp.clamp(rest / (n + real(0.5) * bend * h_arc), real(0.0), h)
                        land = int(landed_arc)

                hh = h * h
                kick2 = (real(a21) * hh) * force
                s2 = look(field, cell, frac, rate, real(c2) * h, total, momentum, q, kick2)
                force2 = vec3(s2[1], s2[2], s2[3])
                kick3 = hh * (real(a31) * force + real(a32) * force2)
                s3 = look(field, cell, frac, rate, real(c3) * h, total, momentum, q, kick3)
                force3 = vec3(s3[1], s3[2], s3[3])
                kick = hh * (real(b1) * force + real(b2) * force2 + real(b3) * force3)
                s4 = look(field, cell, frac, rate, h, total, momentum, q, kick)
                force4 = vec3(s4[1], s4[2], s4[3])
                evaluations += 3
                crossed = bool(False)
                if wp.static(interpolation == "linear" and controlled):
                    if h > safe:
                        # The slope at the start, a jump, by the parabola through the others, which lie in one cell:
                        # if that is not what was found behind the face, the step went on into the next cell.
                        first = real(w2) * force2 + real(w3) * force3 + real(w4) * force4
                        odd = real(0.01) * wp.length(force) + real(1.0e-4) * wp.abs(pot) * wp.max(control.cell_rate)
                        crossed = bool(wp.length(first - force) > odd and h > real(4.0) * h_least)
                        force = first
                        kick = hh * (real(b1) * force + real(b2) * force2 + real(b3) * force3)

                judged = step_error(ambient, d, total, momentum, h, reach, h <= safe, bent, pot, force, s2, s3, s4)
                off = judged[0]
                turn_now = judged[1]

                accept = bool(True)
                if wp.static(controlled):
                    left = wp.max(control.budget - used, real(0.0))
                    allowed = wp.max(real(STEP_SHARE) * left, control.budget * h * (ambient + m) / reach)
                    rounding = step_rounding(control, ambient, h, reach, judged[2], rate, frac, pot, force, s3)
                    if h <= real(NOISE_STEP) * h_cell:
                        allowed = wp.max(allowed, rounding)
                    ratio = real(4.0)
                    if off > real(0.0):
                        ratio = wp.clamp(real(0.9) * wp.pow(allowed / off, real(0.25)), real(0.2), real(4.0))
                    accept = bool((off <= allowed and wp.isfinite(off)) or h <= h_least)
                    if accept:
                        # A step cut short by a surface or a wall says nothing against the length wanted.
                        h_next = wp.max(h * ratio, h_least)
                        if land >= 0 or cut:
                            h_next = wp.max(h_next, wanted)
                    else:
                        h_next = wp.max(h * wp.min(ratio, real(0.8)), h_least)

                # Where the force changes along the step, the parabola may miss the surface: come closer first.
                if accept and land >= 0 and land != landed_arc:
                    ahead = oriented(
                        control, land, side, cell, shown + wp.cw_mul(h * (ambient * d + momentum) + kick, rate)
                    )
                    close = real(0.05) * wp.max(h_free * wp.length(wp.cw_mul(total, rate)), real(0.01))
                    if ahead[0] > close * surface_unit(control, land):
                        accept = bool(False)
                        h_cap = real(0.5) * h
                if crossed:
                    accept = bool(False)
                    h_cap = real(0.5) * h

                if accept:
                    h_cap = control.extent / ambient
                    steps += 1
                    used += off
                    bent = turn_now
                    behind = lag_sum(ambient, d, momentum, h, pot, force, s2, s3, s4)
                    move = h * momentum + kick
                    q, q_carry = advance(q, q_carry, move)
                    momentum, momentum_carry = advance(
                        momentum,
                        momentum_carry,
                        h * (real(v1) * force + real(v2) * force2 + real(v3) * force3 + real(v4) * force4),
                    )
                    flown = h * total
                    if wp.static(not straight):
                        flown += kick
                    frac, frac_carry = advance(frac, frac_carry, wp.cw_mul(flown, rate))
                    cell, frac = carry_over(cell, frac)
                    pot_before = pot
                    pot = s4[0]
                    force = force4
                    if wp.static(interpolation == "linear" and controlled):
                        # The slope jumps at the face just reached: the next step is to have the one behind it.
                        over = real(3.0) * shy / wp.length(wp.cw_mul(total, rate))
                        beyond = sample(field, cell, frac + over * wp.cw_mul(total, rate))
                        force = vec3(beyond[1], beyond[2], beyond[3])
                        pot = beyond[0] - over * wp.dot(force, total)
                        if wp.static(straight):
                            pot += wp.dot(force, q)
                        evaluations += 1
                    if wp.static(one_scalar):
                        # Back onto |T| = n: the error along the ray, which the path would feel in full, is gone.
                        surplus = real(2.0) * pot - wp.dot(momentum, real(2.0) * ambient * d + momentum)
                        tangent = ambient * d + momentum
                        square = wp.dot(tangent, tangent)
                        root = wp.sqrt(wp.max(square * (square + surplus), real(0.0)))
                        mend = (surplus / (square + root)) * tangent
                        momentum += mend
                        if wp.static(straight):
                            q += (real(0.5) * h) * mend  # it grew over the step

                    sums, sums_carry = advance(
                        sums,
                        sums_carry,
                        t.vec4(
                            h,
                            h * (real(v1) * pot_before + real(v2) * s2[0] + real(v3) * s3[0] + real(v4) * s4[0]),
                            h
                            * (
                                real(v1) * m
                                + real(v2) * contrast(ambient, s2[0])
                                + real(v3) * contrast(ambient, s3[0])
                                + real(v4) * contrast(ambient, s4[0])
                            ),
                            behind,
                        ),
                    )

                    back = real(0.0)  # sigma still to go along the tangent, negative to go back
                    if wp.static(has_body):
                        gap_now = wall_at(field, bounds, cell, frac)
                        if gap_now < real(-1.0e-3) / field.wall_rate[1]:
                            back = -h * gap_now / (gap_now - gap)
                            running = bool(False)
                            status = int(hit_body)
                        gap = wp.max(gap_now, real(0.0))
                    if running and land == landed_arc:
                        rest = arc_left - (ambient * sums[0] + sums[2])
                        if (
                            wp.abs(rest)
                            <= real(1.0e-4) * h * (ambient + contrast(ambient, pot)) + real(1.0e-6) * arc_left
                        ):
                            back = rest / (ambient + contrast(ambient, pot))
                            running = bool(False)
                            landed = land
                    elif running and land >= 0:
                        shown = frac
                        if wp.static(straight):
                            shown = frac + wp.cw_mul(q, rate)
                        now = oriented(control, land, side, cell, shown)
                        total = ambient * d + momentum
                        speed = wp.dot(vec3(now[1], now[2], now[3]), wp.cw_mul(total, rate))
                        # Behind it, or close enough to fly the rest along the tangent: else land once more.
                        unit = surface_unit(control, land)
                        if speed > real(0.0) and now[0] >= real(-0.02) * speed * h - real(1.0e-5) * unit:
                            back = -now[0] / speed
                            running = bool(False)
                            landed = land
                        elif h <= real(1.0e-9) * h_cell or now[0] > real(1.0e-3) * unit:
                            running = bool(False)  # outside, and coming back or not moving
                            landed = land
                    if back != real(0.0):
                        half = real(0.5) * back * back
                        q, q_carry = advance(q, q_carry, back * momentum + half * force)
                        climb = wp.dot(force, ambient * d + momentum)
                        m_now = contrast(ambient, pot)
                        sums, sums_carry = advance(
                            sums,
                            sums_carry,
                            t.vec4(
                                back,
                                back * pot + half * climb,
                                back * m_now + half * climb / (ambient + m_now),
                                back * lag(ambient, d, momentum, pot),
                            ),
                        )
                        momentum, momentum_carry = advance(momentum, momentum_carry, back * force)
                    if running and steps >= control.max_steps:
                        running = bool(False)
                        status = int(too_many)
                elif evaluations // 12 > control.max_steps:
                    running = bool(False)
                    status = int(too_many)
                if not (wp.isfinite(wp.length(q)) and wp.isfinite(sums[1])):
                    running = bool(False)
                    status = int(not_finite)

        # From here on float64: deviations back onto the straight ray, free flight to a stop outside the box.
        q64 = wp.vec3d(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2])) - wp.vec3d(
            wp.float64(q_carry[0]), wp.float64(q_carry[1]), wp.float64(q_carry[2])
        )
        p64 = wp.vec3d(wp.float64(momentum[0]), wp.float64(momentum[1]), wp.float64(momentum[2]))
        sigma = wp.float64(sums[0]) - wp.float64(sums_carry[0])
        work = wp.float64(2.0) * (wp.float64(sums[1]) - wp.float64(sums_carry[1]))
        stretch = wp.float64(sums[2]) - wp.float64(sums_carry[2])
        if wp.static(one_scalar) and bent <= real(NEARLY_STRAIGHT):
            # Along d the deviation is int (T . d - a) d sigma = M - B: sums of what the path itself is summed of.
            lagging = wp.float64(sums[3]) - wp.float64(sums_carry[3])
            q64 += (stretch - lagging - wp.dot(q64, d0)) * d0
        turn = deflection(ambient64, d0, p64)
        heading = d0 + turn
        along = enter + ambient64 * sigma  # distance along the straight ray
        if landed >= 0 and landed < landed_arc:
            along = meeting(bounds, landed, p0 + q64, d0, along)
        if not meets:
            along = none64
            if wp.static(stop == "none"):
                status = int(missed)
                stop_distance = none64

        flight = none64
        if status == ok:
            if wp.static(stop == "plane"):
                if not meets or (landed >= 0 and landed != face_count):
                    here = p0 + along * d0 + q64
                    height = wp.dot(bounds.plane_normal, here - bounds.plane_point)
                    slope = wp.dot(bounds.plane_normal, heading)
                    # A plane on a face of the box: rounding may put the ray a hair behind it.
                    hair = wp.float64(1.0e-3) / wp.float64(wp.max(control.cell_rate))
                    if height * slope < none64 or (meets and wp.abs(height) < hair * wp.abs(slope)):
                        flight = -height / slope
                    elif height != none64:
                        status = int(not_reached)
            elif wp.static(stop == "arc"):
                flight = bounds.length - (along + stretch)
        deviation = q64 + flight * turn
        along += flight

        arc = wp.max(along + stretch, none64)  # a ray that leaves where it starts may end a rounding before it
        opd = wp.float64(0.0)
        if status == ok and has_undisturbed and wp.static(stop != "arc"):
            # How much further along d the stop is met than by the undisturbed ray: from the deviation where that is
            # exact, since the difference of two distances would lose its last digits.
            further = along - stop_distance
            if wp.static(stop == "plane"):
                descent = wp.dot(bounds.plane_normal, d0)
                if wp.abs(descent) > wp.float64(0.05):
                    further = -wp.dot(bounds.plane_normal, deviation) / descent
            elif landed >= 0:
                further = detour(bounds, landed, p0, d0, deviation, stop_distance, further)
            opd = work + ambient64 * further
        else:
            opd = work - ambient64 * stretch
        if wp.static("position" in outputs):
            position_out[ray] = p0 + along * d0 + deviation
        if wp.static("direction" in outputs):
            direction_out[ray] = heading / wp.length(heading)
        if wp.static("optical_path" in outputs):
            optical_path_out[ray] = wp.max(ambient64 * along + work, none64)
        if wp.static("opd" in outputs):
            opd_out[ray] = opd
        if wp.static("arc_length" in outputs):
            arc_length_out[ray] = arc
        if wp.static("step_error" in outputs):
            step_error_out[ray] = wp.float64(used)
        if wp.static("step_count" in outputs):
            step_count_out[ray] = steps
        if wp.static("evaluation_count" in outputs):
            evaluation_count_out[ray] = evaluations
        status_out[ray] = status

    return trace_kernel
