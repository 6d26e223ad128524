"""Device functions of a step of the tracer: its length, the field at its later stages, and whether it is accepted."""

import warp as wp

from ....scheme import AT_FACE, FACE_TOLERANCE, GREATEST_STAND_OFF, NOISE_STEP, STEP_SHARE, TINY
from ....tableau import BT, END_RATE, B
from ..library import KernelLibrary, built_once
from . import grid, mesh
from .edges import build_edges
from .error import build_bends
from .step_bound import build_step_bound, build_to_face


@built_once
def build_stride(library: KernelLibrary, geometry: str, interpolation: str, on_mesh: bool, method: str):
    """Build a function: the length of the next step."""
    t = library.types
    real, vec3, Field, Control, Stride = t.real, t.vec3, t.Field, t.Control, t.Stride
    StopGeometry = t.StopGeometry
    paper_step = (mesh if on_mesh else grid).build_paper_step(library, geometry)
    step_bound_of = build_step_bound(library, "mesh" if on_mesh else geometry)
    to_face, _, _ = build_to_face(library, geometry)
    step_to_edge = build_edges(library, geometry, interpolation)[0] if on_mesh else None
    linear, piecewise_smooth = interpolation == "linear", interpolation in ("linear", "monotone")
    at_face = AT_FACE[library.precision]
    # Products of literals would be computed in float32 inside a kernel.
    least_stand_off, clearance = 0.1 * FACE_TOLERANCE, 10.0 * FACE_TOLERANCE

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
        out = Stride()
        out.edge = int(-1)
        out.h = h_next
        out.stand_off = real(least_stand_off)
        if wp.static(method == "fixed"):
            out.h = control.step / index
        elif wp.static(method == "paper"):
            out.h = paper_step(field, cell, frac, current_cell) / index
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
                face = to_face(frac, velocity, acceleration, close)
                limit = wp.max(face - out.stand_off / wp.length(velocity), real(0.5) * face)
            if wp.static(on_mesh):
                if current_cell >= 0:
                    curve = force
                    if wp.static(method == "straight"):
                        curve = vec3(real(0.0), real(0.0), real(0.0))
                    return step_to_edge(
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
            bound = derating * step_bound_of(control, cone, cell, frac, total)
            out.safe = bound - real(clearance) * h_cell
            out.h = wp.min(out.h, wp.max(limit, out.safe))
        out.h = wp.min(out.h, h_cap)
        return out

    return stride


def build_sample_at_stage(library: KernelLibrary, sample, straight: bool, geometry: str, interpolation: str):
    """Build functions that evaluate the field at a stage of a step, and what a straight line neglects."""
    t = library.types
    real, vec3, Field = t.real, t.vec3, t.Field

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
            s = sample(field, cell, frac + h * wp.cw_mul(total, rate), current_cell)
            s[0] += wp.dot(vec3(s[1], s[2], s[3]), q + h * momentum + kick)
            return s
        else:
            return sample(field, cell, frac + wp.cw_mul(h * total + kick, rate), current_cell)

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
        there = sample(field, cell, frac + wp.cw_mul(q, rate), current_cell)
        change = vec3(there[1], there[2], there[3]) - force
        turn, path = h * wp.length(change), h * wp.abs(there[0] - pot)
        if wp.static(interpolation != "cubic"):
            opposite = sample(field, cell, frac - wp.cw_mul(q, rate), current_cell)
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

    return sample_at_stage, sample_neglected


@built_once
def build_kick(library: KernelLibrary):
    """Build functions of a step and its forces: h^2 times the mean force, the impulse, the rate of force at its end."""
    t = library.types
    real, vec3, vec4 = t.real, t.vec3, t.vec4
    b1, b2, b3 = (float(v) for v in B[:3])
    v1, v2, v3, v4 = (float(v) for v in BT)
    r1, r3, r4 = (float(END_RATE[stage]) for stage in (0, 2, 3))
    tiny = TINY[library.precision]

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

    return kick_of, impulse_of, force_rate_of


@built_once
def build_step_acceptance(library: KernelLibrary, on_mesh: bool):
    """Build a function -> (whether a step with this error is accepted, ratio of the next step's length to this).

    `bend` is the error by kinks on a mesh.
    """
    real = library.types.real
    bend_share = build_bends(library)[1]

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
        left = wp.max(limit - used, real(0.0))
        allowed = wp.max(real(STEP_SHARE) * left, limit * h * index / reach)
        if h <= real(NOISE_STEP) * h_cell:
            allowed = wp.max(allowed, rounding)
        whole = error
        if wp.static(on_mesh):
            whole += bend * wp.min(allowed / (limit * bend_share(allowed / limit)), real(1.0))
        ratio = real(4.0)
        if whole > real(0.0):
            ratio = wp.clamp(real(0.9) * wp.sqrt(wp.sqrt(allowed / whole)), real(0.2), real(4.0))
        return bool((whole <= allowed and wp.isfinite(whole)) or h <= h_least), ratio

    return step_acceptance
