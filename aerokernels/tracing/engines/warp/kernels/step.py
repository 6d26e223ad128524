"""Device functions of a step of the tracer: its length, its stages, whether it is accepted, slopes behind faces."""

from types import SimpleNamespace

import warp as wp

from ....scheme import AT_FACE, FACE_TOLERANCE, GREATEST_STAND_OFF, NOISE_STEP, STEP_SHARE, TINY
from ....tableau import BT, END_RATE, B
from ..library import Scene, built_once
from .edges import build_edges
from .error import build_bends
from .grid import build_grid
from .mesh import build_mesh
from .step_bound import build_step_bound


@built_once("geometry", "interpolation", "on_mesh", "method")
def build_step(scene: Scene):
    """Build the functions of a step."""
    geometry, interpolation, on_mesh, method = scene.geometry, scene.interpolation, scene.on_mesh, scene.method
    t = scene.types
    real, vec3, vec4, Field, Control, Stride = t.real, t.vec3, t.vec4, t.Field, t.Control, t.Stride
    StopGeometry = t.StopGeometry
    air = build_mesh(scene) if on_mesh else build_grid(scene)
    blocks, edges, bends = build_step_bound(scene), build_edges(scene), build_bends(scene)
    straight, at_faces = method == "straight", interpolation == "linear" and method in ("adaptive", "straight")
    linear, piecewise_smooth = interpolation == "linear", interpolation in ("linear", "monotone")
    at_face = AT_FACE[scene.precision]
    # Products of literals would be computed in float32 inside a kernel.
    least_stand_off, clearance = 0.1 * FACE_TOLERANCE, 10.0 * FACE_TOLERANCE
    b1, b2, b3 = (float(v) for v in B[:3])
    v1, v2, v3, v4 = (float(v) for v in BT)
    r1, r3, r4 = (float(END_RATE[stage]) for stage in (0, 2, 3))
    tiny = TINY[scene.precision]

    @wp.func
    def stride(
        field: Field,
        control: Control,
        current_cell: int,
        cone: int,
        cell: wp.vec3i,
        frac: vec3,
        total: vec3,
        force: vec3,
        index: real,
        derating: real,
        h_cell: real,
        h_next: real,
        h_cap: real,
        to_stop: StopGeometry,
        max_deflection: real,
        used: real,
    ):
        """The length of the next step."""
        out = Stride()
        out.edge = int(-1)
        out.h = h_next
        out.stand_off = real(least_stand_off)
        if wp.static(method == "fixed"):
            out.h = control.step / index
        elif wp.static(method == "paper"):
            out.h = air.paper_step(field, cell, frac, current_cell) / index
        else:
            limit = control.step_limit * h_cell
            if wp.static(piecewise_smooth):
                # The interpolant has kinks at the cells' faces, so no step crosses one. On a linear grid the ray flies
                # the rest along the tangent (rest_to_face); on a monotone grid a face nearer than the distance to keep
                # from faces counts as reached.
                velocity = wp.cw_mul(total, field.inverse_spacing)
                acceleration = wp.cw_mul(force, field.inverse_spacing)
                close = real(10.0) * out.stand_off
                if wp.static(linear):
                    # How far before a face to stop, in cells: a share of the bend over a cell, because the parabola
                    # leaves out that the bend changes over the step.
                    bend = real(0.15) * wp.length(acceleration) / wp.dot(velocity, velocity)
                    out.stand_off += wp.min(bend, real(GREATEST_STAND_OFF))
                    close = real(at_face)
                face = blocks.to_face(frac, velocity, acceleration, close)
                limit = wp.max(face - out.stand_off / wp.length(velocity), real(0.5) * face)
            if wp.static(on_mesh):
                if current_cell >= 0:
                    curve = force
                    if wp.static(method == "straight"):
                        curve = vec3(real(0.0), real(0.0), real(0.0))
                    return edges.step_to_edge(
                        field,
                        control,
                        current_cell,
                        frac,
                        total,
                        curve,
                        index,
                        wp.min(h_next, h_cap),
                        limit,
                        to_stop,
                        max_deflection,
                        used,
                    )
            # End before the face at which the first block that is not smooth may begin.
            bound = derating * blocks.step_bound_of(control, cone, cell, frac, total)
            out.safe = bound - real(clearance) * h_cell
            out.h = wp.min(out.h, wp.max(limit, out.safe))
        out.h = wp.min(out.h, h_cap)
        return out

    @wp.func
    def sample_at_stage(
        field: Field,
        current_cell: int,
        cell: wp.vec3i,
        frac: vec3,
        rate: vec3,
        h: real,
        total: vec3,
        momentum: vec3,
        q: vec3,
        kick: vec3,
    ):
        """The field at a stage; on a straight line it is linear in the deviation from the line."""
        if wp.static(straight):
            s = air.sample(field, cell, frac + h * wp.cw_mul(total, rate), current_cell)
            s[0] += wp.dot(vec3(s[1], s[2], s[3]), q + h * momentum + kick)
            return s
        else:
            return air.sample(field, cell, frac + wp.cw_mul(h * total + kick, rate), current_cell)

    @wp.func
    def time_apart(jump: vec3, total: vec3, q: vec3, h_cell: real):
        """Time between the line's and the ray's crossings of a face whose normal is along `jump`; at most h_cell."""
        aside, pace = wp.abs(wp.dot(jump, q)), wp.abs(wp.dot(jump, total))
        if aside < h_cell * pace:
            return aside / pace
        if aside > real(0.0):
            return h_cell
        return real(0.0)

    @wp.func
    def sample_neglected(
        field: Field,
        current_cell: int,
        cell: wp.vec3i,
        frac: vec3,
        rate: vec3,
        total: vec3,
        q: vec3,
        pot: real,
        force: vec3,
        h: real,
        h_cell: real,
    ):
        """What the linear field along a straight line neglects at the end of a step: path [m], and momentum.

        The ray is q beside the line, where `pot` is continued. Where slopes jump at faces, the ray crosses a face
        before the line or behind it, so that both sides of the line count. On a linear grid every step ends at a face:
        a jump, which is normal to its face, counts only for the time between the two crossings.
        """
        there = air.sample(field, cell, frac + wp.cw_mul(q, rate), current_cell)
        change = vec3(there[1], there[2], there[3]) - force
        turn, path = h * wp.length(change), h * wp.abs(there[0] - pot)
        if wp.static(interpolation != "cubic"):
            opposite = air.sample(field, cell, frac - wp.cw_mul(q, rate), current_cell)
            other = vec3(opposite[1], opposite[2], opposite[3]) - force
            if wp.static(interpolation == "linear"):
                other_path = h * wp.abs(opposite[0] - (pot - real(2.0) * wp.dot(force, q)))
                jump = change
                if wp.length(other) > wp.length(change):
                    jump = other
                along = vec3(real(0.0), real(0.0), jump[2])
                first = vec3(jump[0], jump[1], real(0.0))
                if wp.static(geometry == "volume"):
                    first = vec3(jump[0], real(0.0), real(0.0))
                second = jump - along - first
                time1, time2 = time_apart(first, total, q, h_cell), time_apart(second, total, q, h_cell)
                time3 = time_apart(along, total, q, h_cell)
                share = wp.max(wp.max(time1, time2), time3) / h_cell
                path = wp.min(path, other_path) + share * wp.max(path, other_path)
                turn = wp.min(turn, h * wp.length(other)) + time1 * wp.length(first) + time2 * wp.length(second)
                turn += time3 * wp.length(along)
            else:
                turn = wp.max(turn, h * wp.length(other))
        return real(2.0) * path, turn

    @wp.func
    def kick_of(h: real, force: vec3, s2: vec4, s3: vec4):
        force2 = vec3(s2[1], s2[2], s2[3])
        force3 = vec3(s3[1], s3[2], s3[3])
        return (h * h) * (real(b1) * force + real(b2) * force2 + real(b3) * force3)

    @wp.func
    def impulse_of(h: real, force: vec3, s2: vec4, s3: vec4, s4: vec4):
        force2 = vec3(s2[1], s2[2], s2[3])
        force3 = vec3(s3[1], s3[2], s3[3])
        force4 = vec3(s4[1], s4[2], s4[3])
        return h * (real(v1) * force + real(v2) * force2 + real(v3) * force3 + real(v4) * force4)

    @wp.func
    def force_rate_of(h: real, force: vec3, s3: vec4, s4: vec4):
        force3 = vec3(s3[1], s3[2], s3[3])
        force4 = vec3(s4[1], s4[2], s4[3])
        return (real(r1) * force + real(r3) * force3 + real(r4) * force4) / wp.max(h, real(tiny))

    @wp.func
    def step_acceptance(
        limit: real,
        error: real,
        bend: real,
        rounding: real,
        used: real,
        h: real,
        h_cell: real,
        h_least: real,
        index: real,
        reach: real,
    ):
        """Whether a step with this error is accepted, ratio of the next step's length to this.

        `bend` is the error by kinks on a mesh.
        """
        left = wp.max(limit - used, real(0.0))
        allowed = wp.max(real(STEP_SHARE) * left, limit * h * index / reach)
        if h <= real(NOISE_STEP) * h_cell:
            allowed = wp.max(allowed, rounding)
        whole = error
        if wp.static(on_mesh):
            whole += bend * wp.min(allowed / (limit * bends.bend_share(allowed / limit)), real(1.0))
        ratio = real(4.0)
        if whole > real(0.0):
            ratio = wp.clamp(real(0.9) * wp.sqrt(wp.sqrt(allowed / whole)), real(0.2), real(4.0))
        return bool((whole <= allowed and wp.isfinite(whole)) or h <= h_least), ratio

    if on_mesh:

        @wp.func
        def slope_behind(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int, bearing: vec3, q: vec3):
            """Potential at the ray, slope, where and for which potential they were looked up.

            On a grid they are looked up a little behind the face, and continued back to it; on a mesh in the cell
            behind the edge. On a straight line the potential is continued to the ray, q beside the line.
            """
            beyond = air.sample_in(field, current_cell, frac)
            pot, force = beyond[0], vec3(beyond[1], beyond[2], beyond[3])
            if wp.static(straight):
                pot += wp.dot(force, q)
            return pot, force, frac, pot

    else:

        @wp.func
        def slope_behind(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int, bearing: vec3, q: vec3):
            rate = field.inverse_spacing
            pace = wp.cw_mul(bearing, rate)
            over = real(at_face) / wp.length(pace)
            push = blocks.push_off_faces(frac, pace)
            probe = frac + over * pace + push
            beyond = air.sample(field, cell, probe, current_cell)
            force, probe_pot = vec3(beyond[1], beyond[2], beyond[3]), beyond[0]
            pot = blocks.before_push(probe_pot - over * wp.dot(force, bearing), force, push, rate)
            if wp.static(straight):
                pot, probe_pot = pot + wp.dot(force, q), probe_pot + wp.dot(force, q)
            return pot, force, probe, probe_pot

    @wp.func
    def first_sample(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int, d: vec3):
        """(potential, slope) where a ray with the direction d starts.

        With `at_faces` the slope is that of the cell into which a ray flies that starts in a face.
        """
        probe = frac
        if wp.static(at_faces):
            push = blocks.push_off_faces(frac, wp.cw_mul(d, field.inverse_spacing))
            probe = frac + push
        s = air.sample(field, cell, probe, current_cell)
        pot, force = s[0], vec3(s[1], s[2], s[3])
        if wp.static(at_faces):
            pot = blocks.before_push(pot, force, push, field.inverse_spacing)
        return pot, force

    @wp.func
    def rest_to_face(frac: vec3, velocity: vec3, acceleration: vec3, stand_off: real, h: real):
        """Rest [sigma] to the face `stand_off` cells before which a step of length h stopped, or 0."""
        rest = blocks.to_face(frac, velocity, acceleration, real(0.0))
        if rest <= h and rest * wp.length(velocity) <= real(4.0) * stand_off:
            return rest
        return real(0.0)

    return SimpleNamespace(**locals())
