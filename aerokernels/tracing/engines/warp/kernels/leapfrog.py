r"""The Warp kernel that traces nearly straight rays, all with the same number of evenly spaced samples.

Equation. With t the distance along the undisturbed ray p + d t, P the part of the momentum n dr/ds across d, q the part
of the deviation across d, s = (n^2 - a^2) / 2 and w the momentum along d,

    q' = P / w,   P' = grad s / w across d,   w = sqrt(a^2 + 2 s - P^2)
    optical path - a t = int (2 s - a (w - a)) / w dt

These are the full ray equations as long as the ray does not turn away from d. Every ray takes the same number N of
samples, in the middles of N equal parts of its path: a leapfrog step is one lookup without a branch, so neighbouring
rays stay in step (on a CPU in the lanes of a vector, on a GPU in a warp).

Order. The sums are the midpoint rule with the weights 13/12, 7/8, 25/24, 1, 1 ... at both ends, of fourth order; on
fields that fade out at both ends it converges faster than any power. P and q at the end are such sums, q the sum of P'
times the path still to go. The P and q of the leapfrog itself, of second order in t / N, determine where samples are
taken, which matters only in the second order of the contrast.

Error. The same sums over every third sample are the rule with N / 3 samples. The error estimate is a share of the
differences (those of position and direction as far as they matter at an oblique stop), and a share of int P^2 / w dt
for the leapfrog; a pilot bundle determines both shares (tracing/leapfrog/sample_count.py). A ray is rejected, and
traced by another method, if the estimate exceeds the budget, or if the ray turns by more than LEAPFROG_ANGLE, comes
near a body or leaves by an edge of the box.

Stop. A ray that has left the field's support flies straight on: to a plane (ends.py), or to where this line leaves the
box. In disturbed air the ray flies along a parabola from the last point of the undisturbed ray to its surface; the
error of the parabola counts as an error too, as does the air outside the support (support.py).
"""

import warp as wp

from ....plan import OUTPUT_BITS
from ....scheme import BEYOND_SUPPORT, LEAPFROG_ANGLE, LEAST_COSINE, LEFT_SHARE, STEEPEST_COSINE, TINY
from ....stop import RayStatus
from ..library import Scene, built_once
from .box import build_box
from .cubes import build_cube_sample
from .ends import build_ends
from .grid import build_grid
from .motion import advance
from .outputs import build_write_outputs
from .support import build_support
from .wall import build_wall

# Per thread of a GPU: with the 200 that the compiler would use, too few rays could wait for memory at the same time.
MOST_REGISTERS = 128


@wp.func
def quadrature_weight(k: int, count: int):
    """Weight of sample k of `count`: the end-corrected midpoint rule."""
    end = wp.min(k, count - 1 - k)
    weight = wp.float64(1.0)
    if end == 0:
        weight = wp.float64(13.0) / wp.float64(12.0)
    elif end == 1:
        weight = wp.float64(0.875)
    elif end == 2:
        weight = wp.float64(25.0) / wp.float64(24.0)
    return weight


@built_once("geometry", "interpolation", "method", "stop", "has_body", "cubes")
def build_leapfrog_kernel(scene: Scene):
    """Build the kernel for one kind of scene; its arguments are those of the tracer and the count of rejected rays."""
    stop, has_body, cubes = scene.stop, scene.has_body, scene.cubes
    t = scene.types
    real, vec3, vec4 = t.real, t.vec3, t.vec4
    sample = build_cube_sample(scene) if cubes else build_grid(scene).sample
    box, ends, support, wall = build_box(scene), build_ends(scene), build_support(scene), build_wall(scene)
    write_outputs = build_write_outputs(scene)
    ok = int(RayStatus.OK)
    tiny = TINY[scene.precision]
    beyond_support = wp.constant(BEYOND_SUPPORT)

    # With fast_math a GPU uses its own roots and quotients, accurate to about two units in the last place; here they
    # are factors of small deviations. Compensated sums stay as written: the compiler does not change their order.
    @wp.kernel(
        module="unique", enable_backward=False, cuda_max_registers=MOST_REGISTERS, module_options={"fast_math": True}
    )
    def leapfrog(
        field: t.Field,
        bounds: t.Bounds,
        control: t.Control,
        first_ray: int,
        position_in: wp.array(dtype=wp.vec3d),
        direction_in: wp.array(dtype=wp.vec3d),
        outputs: t.RayOutputs,
        rejected_count_out: wp.array(dtype=wp.int32),
    ):
        thread, _ = wp.tid()  # two indices, see trace.py
        ray = thread + first_ray
        p0 = position_in[ray]
        d0 = direction_in[ray]
        status, interval = ends.start_of(field, bounds, p0, d0)
        runs = bool(interval.meets and status == ok)

        d = vec3(real(d0[0]), real(d0[1]), real(d0[2]))
        rate = field.inverse_spacing
        pace = wp.cw_mul(d, rate)
        ambient = real(bounds.ambient)
        count = control.sample_count
        none = vec3(real(0.0), real(0.0), real(0.0))
        momentum = none  # across the ray
        q = none  # deviation across it
        impulse = none  # the end-corrected sum of the momentum
        moment = none  # the sum of its moments about the start
        momentum_diff = none  # the momentum minus the sum over every third sample
        deviation_diff = none  # the same of its moments
        sigma = real(0.0)  # int 1 / w dt
        bend = real(0.0)  # sum of P^2 / w
        slowness = real(1.0) / ambient  # 1 / w
        sums = vec4(real(0.0), real(0.0), real(0.0), real(0.0))  # of s / w, (w - a) / w, m / w, and every third sample
        carry = sums
        max_deflection = real(0.0)
        s = real(0.0)  # the potential at the last sample, its slope along the ray (ahead) and across it (force)
        ahead = real(0.0)
        force = none
        length = real(0.0)
        h = real(0.0)
        error = real(0.0)
        whole = wp.vec2d(wp.float64(0.0), wp.float64(0.0))  # ends of its path in the box, with the part in uniform air
        missed = real(0.0)
        start = none
        cube_errors = none  # sums of error bounds of the cubes: of the potential, its slope, and the slope's moments
        clear = bool(True)
        ends_on = int(-1)
        uniform = bool(False)
        chord = wp.float64(0.0)  # length of the undisturbed ray in the box, up to its stop
        if runs:
            whole = wp.vec2d(interval.t_enter, interval.t_exit)
            chord = interval.t_exit - interval.t_enter
            uniform, enter, last = support.keep_support(bounds, p0, d0, interval.t_enter, interval.t_exit)
            if not uniform:
                ends_on = ends.surface_of(bounds, interval, p0, d0)
            interval.t_enter = enter
            interval.t_exit = last
            entry = wp.cw_div(p0 + interval.t_enter * d0 - bounds.origin, bounds.spacing)
            start = vec3(real(entry[0]), real(entry[1]), real(entry[2]))
            length = real(interval.t_exit - interval.t_enter)
            h = length / real(count)
            corner = wp.vec3i(0, 0, 0)
            if wp.static(has_body):
                # Refraction where the ray leaves the body: part of the momentum, and no error of the sums.
                if wp.static(cubes):
                    at, _bound, _slope_bound = sample(field, start)
                else:
                    at = sample(field, corner, start, 0)
                momentum = wall.starting_momentum(ambient, at[0], d, interval.normal)
                momentum -= wp.dot(momentum, d) * d
                impulse += momentum
                momentum_diff -= momentum
            for triple in range(count // 3):
                added = vec4(real(0.0), real(0.0), real(0.0), real(0.0))
                for j in range(3):
                    k = 3 * triple + j
                    weight = real(quadrature_weight(k, count))
                    along = (real(k) + real(0.5)) * h
                    middle = real(0.5) * h * slowness
                    here_in_cells = start + along * pace + wp.cw_mul(q + middle * momentum, rate)
                    if wp.static(cubes):
                        at, bound, slope_bound = sample(field, here_in_cells)
                        cube_errors += vec3(bound, slope_bound, along * slope_bound)
                    else:
                        at = sample(field, corner, here_in_cells, 0)
                    s = at[0]
                    force = vec3(at[1], at[2], at[3])
                    ahead = wp.dot(force, d)
                    force -= ahead * d
                    here = momentum + middle * force
                    across = wp.dot(here, here)
                    surplus = real(2.0) * s - across
                    w = wp.sqrt(wp.max(ambient * ambient + surplus, real(tiny)))
                    slowness = real(1.0) / w
                    deficit = surplus / (w + ambient) * slowness
                    stretch = real(0.0)
                    if (control.outputs & wp.static(OUTPUT_BITS["arc_length"])) != 0:
                        index = wp.sqrt(wp.max(ambient * ambient + real(2.0) * s, real(0.0)))
                        stretch = slowness * (real(2.0) * s / (index + ambient))
                    added += weight * vec4(s * slowness, deficit, stretch, real(0.0))
                    pace_now = h * slowness
                    momentum += pace_now * force
                    q += pace_now * here
                    kick = weight * pace_now
                    impulse += kick * force
                    place = sigma + real(0.5) * pace_now
                    moment += (kick * place) * force
                    if j == 1:
                        third = real(quadrature_weight(triple, count // 3))
                        added += vec4(
                            real(0.0), real(0.0), real(0.0), third * (real(2.0) * s * slowness - ambient * deficit)
                        )
                        coarse_kick = real(3.0) * third * pace_now
                        momentum_diff -= coarse_kick * force
                        deviation_diff -= (coarse_kick * place) * force
                    sigma += pace_now
                    bend += across * slowness
                    max_deflection = wp.max(max_deflection, across)
                sums, carry = advance(sums, carry, added)
            difference = wp.abs(h * ((real(2.0) * sums[0] - ambient * sums[1]) - real(3.0) * sums[3]))
            error = wp.max(difference * control.quadrature_error_scale, h * bend * control.trajectory_error_scale)

        # Momentum and deviation at the end, half a step behind the last sample, in fourth order.
        momentum = impulse
        q = sigma * impulse - moment
        momentum_diff += impulse
        deviation_diff = sigma * momentum_diff - (deviation_diff + moment)
        if runs:
            missed = support.unresolved_of(field, control, start, d, length, q)
        steep = wp.sqrt(ahead * ahead + wp.dot(force, force))
        s += real(0.5) * h * ahead
        if uniform:  # in uniform air there is no force
            s = real(0.0)
            ahead = real(0.0)
            steep = real(0.0)
            force = none
        lead = (real(2.0) * s - wp.dot(momentum, momentum)) * slowness / (real(1.0) / slowness + ambient)
        path = wp.float64(h) * (wp.float64(sums[0]) - wp.float64(carry[0]))
        longitudinal_deficit = wp.float64(h) * (wp.float64(sums[1]) - wp.float64(carry[1]))
        arc = wp.float64(h) * (wp.float64(sums[2]) - wp.float64(carry[2]))
        flown = wp.float64(length)
        turned = none
        normal = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
        more = wp.float64(0.0)
        off_tail = real(0.0)  # error of the direction from the path between the last sample and the surface
        end = p0
        if runs:
            # The rest to the surface, which the ray meets a little beside the undisturbed ray.
            obliquity = slowness * momentum
            heading = d0 + wp.vec3d(wp.float64(obliquity[0]), wp.float64(obliquity[1]), wp.float64(obliquity[2]))
            beside = wp.vec3d(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2]))
            tip = p0 + interval.t_exit * d0 + beside
            pull = slowness * force
            if uniform:
                if length > real(0.0) and not support.leaves_support(bounds, tip, heading):
                    clear = bool(False)  # it has turned and may fly on through disturbed air
                if wp.static(stop == "plane"):
                    ends_on = int(beyond_support)
                    normal = bounds.plane_normal
                else:
                    more, ends_on = support.exit_of(bounds, tip, heading)
            if ends_on != beyond_support:
                if not uniform:
                    more = support.line_to(bounds, ends_on, tip, heading)
                miss = box.surface_distance(bounds, ends_on, tip + more * heading)
                normal = wp.vec3d(miss[1], miss[2], miss[3])
            cosine = wp.dot(normal, heading)
            if not uniform and wp.abs(cosine) > wp.float64(LEAST_COSINE):
                # Along the parabola; its error, from the change of the slope over a cell, counts as an error.
                line = more
                inward = normal[0] * wp.float64(pull[0]) + normal[1] * wp.float64(pull[1])
                inward += normal[2] * wp.float64(pull[2])
                more = line - wp.float64(0.5) * line * line * wp.float64(slowness) * inward / cosine
                tail = real(wp.abs(more))
                cells = wp.max(rate)
                error = wp.max(error, steep * tail * (tail / real(wp.abs(cosine))) * wp.min(tail * cells, real(1.0)))
                off_tail = slowness * steep * tail * wp.min((tail + real(0.5) * h) * cells, real(1.0))
            climb = wp.float64(0.5) * more * wp.float64(ahead)
            extra = more * wp.float64(slowness) * (wp.float64(s) + climb)
            path += extra
            longitudinal_deficit += more * (wp.float64(lead) + wp.float64(slowness) * climb / bounds.ambient)
            arc += extra / bounds.ambient
            q += real(more) * (obliquity + (real(0.5) * real(more) * slowness) * pull)
            flown += more
            turned = momentum + real(more) * pull + (lead / slowness) * d
            beside = wp.vec3d(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2]))
            end = p0 + (interval.t_enter + flown) * d0 + beside
            fit = bool(wp.sqrt(max_deflection) / ambient <= real(LEAPFROG_ANGLE))
            angle = wp.float64(wp.sqrt(max_deflection) / ambient)
            fit = fit and not support.may_have_left(bounds, p0 + interval.t_exit * d0, d0, wp.float64(length), angle)
            fit = fit and wp.isfinite(path) and wp.isfinite(error) and wp.abs(cosine) > wp.float64(LEAST_COSINE)
            if wp.static(stop == "plane"):
                fit = fit and wp.abs(wp.dot(bounds.plane_normal, heading)) > wp.float64(LEAST_COSINE)
            for axis in range(3):
                fit = fit and wp.abs(d0[axis]) <= wp.float64(control.steepest[axis])
            # If the box's end is the stop, the path is wrong by the whole excess, else by the field's contribution on
            # it.
            excess = support.overrun(bounds, control, ends_on, end, heading)
            rise = bounds.ambient
            if wp.static(stop != "none"):
                rise = wp.max(wp.abs(wp.float64(s)) / bounds.ambient, wp.float64(1.0e-30))
            if uniform:
                # A ray that has left the support must not have left the box before.
                excess = support.overrun(bounds, control, -1, tip, heading)
                rise = wp.float64(1.0e-30)
            if excess > wp.float64(0.0):
                error = wp.max(error, real(excess * rise))
            if wp.static(has_body):
                # The ray stays within the greatest angle about the undisturbed ray.
                margin = (whole[1] - whole[0]) * wp.float64(wp.sqrt(max_deflection) / ambient)
                fit = fit and wall.has_clearance(field, p0, d0, whole[0], whole[1], margin)
            if not (fit and clear):
                error = real(wp.inf)
        # As the tracer's sums: sigma, S, M and B, of which M - B is the deviation along the ray.
        exact = wp.vec4d((flown - longitudinal_deficit) / bounds.ambient, path, arc, arc - longitudinal_deficit)
        rounded = vec4(real(exact[0]), real(exact[1]), real(exact[2]), real(exact[3]))
        rest = vec4(
            real(wp.float64(rounded[0]) - exact[0]),
            real(wp.float64(rounded[1]) - exact[1]),
            real(wp.float64(rounded[2]) - exact[2]),
            real(wp.float64(rounded[3]) - exact[3]),
        )
        arrival = ends.end_of(
            bounds, control, p0, d0, interval, status, ends_on, q, none, turned, rounded, rest, real(0.0)
        )
        if runs and arrival.status != ok:
            error = real(wp.inf)  # a deflected ray may miss a plane on the box's edge
        elif runs:
            # Errors of position and direction count if the ray meets its stop at an angle, and so does the effect of
            # the air outside the field's support on both.
            flight = wp.length(arrival.position - end)
            beside = wp.vec3d(
                wp.float64(deviation_diff[0]), wp.float64(deviation_diff[1]), wp.float64(deviation_diff[2])
            )
            aside = wp.vec3d(wp.float64(momentum_diff[0]), wp.float64(momentum_diff[1]), wp.float64(momentum_diff[2]))
            if wp.static(stop == "plane"):
                normal = bounds.plane_normal
            else:
                flight += more
            # The error of direction of a deflected ray also has a part along d, which shifts where it meets a far stop.
            pushed = wp.vec3d(wp.float64(turned[0]), wp.float64(turned[1]), wp.float64(turned[2]))
            displacement = beside + flight * wp.float64(slowness) * aside
            off_stop = wp.abs(wp.dot(normal, displacement)) + wp.abs(
                wp.dot(wp.float64(slowness) * pushed, displacement)
            )
            cosine = wp.max(wp.abs(wp.dot(normal, d0)), wp.float64(STEEPEST_COSINE))
            error = wp.max(error, control.quadrature_error_scale * real(bounds.ambient * off_stop / cosine))
            tangent = wp.sqrt(wp.max(wp.float64(1.0) - cosine * cosine, wp.float64(0.0))) / cosine
            greatest_tangent = tangent + wp.float64(wp.sqrt(max_deflection))
            error = wp.max(error, off_tail * real(bounds.ambient * flight * greatest_tangent))
            lever_arm = (chord + flight) * greatest_tangent
            outside = wp.max(chord - wp.float64(length), wp.float64(0.0))
            left = real(outside * (wp.float64(control.left_potential) + lever_arm * wp.float64(control.left_slope)))
            if left > real(LEFT_SHARE) * control.tolerance:
                error = wp.max(error, left)
            if wp.static(cubes):
                # The errors of the cubes' polynomials at the samples, and the effect of their slopes up to the stop.
                slope_error = (length + real(flight)) * cube_errors[1] - cube_errors[2]
                error += h * slowness * (cube_errors[0] + slope_error * real(greatest_tangent))
        if missed > real(0.0):
            onward = real(wp.length(arrival.position - end) + interval.t_exit - interval.t_enter)
            error += support.with_lever_arm(field, missed, onward, real(wp.abs(wp.dot(normal, d0))))
        if error > control.tolerance:
            wp.atomic_add(rejected_count_out, 0, 1)
        samples = wp.where(runs, count, 0)
        write_outputs(outputs, control.outputs, ray, arrival, wp.float64(error), samples, samples)

    return leapfrog
