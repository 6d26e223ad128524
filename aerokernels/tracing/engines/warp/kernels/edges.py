"""Device functions: steps through a mesh and the edges between its cells, where the slope of the potential jumps.

A step ends at an edge whose jump is too great for the tolerance, and the next one begins with the slope behind it. It
crosses edges of small jumps, as far as their errors are allowed: a jump K [1/m] somewhere in a step of length h makes
an error of the momentum of at most 0.23 h K. The jumps are known beforehand (mesh_samples.py), so none between two
samples is missed. Their errors have either sign, and add up by chance (error.py).

In the plane of the mesh the ray is a parabola. With an axis its radius is a root of a quadratic, and where it crosses
a conical edge c + b t = e r(t) is solved for a straight ray, then corrected for its bend.
"""

from types import SimpleNamespace

import warp as wp

from ....scheme import EDGE_ROUNDING, EDGE_STAND_OFF, EDGES_PASSED, KINK_PATH, KINK_SHARE, STEP_SHARE, TINY
from ..library import Scene, built_once
from .error import build_bends

# Stands for a time that does not exist.
NO_EDGE = 1e30
# The rest to an edge that is flown along the tangent, as a share of the step; how far a step goes beyond the mesh, or
# where no edge is found, as a share of the longest step in a gap.
REST, BEYOND = 0.1, 0.05


@built_once("geometry", "interpolation")
def build_edges(scene: Scene):
    """Build the functions of a mesh's edges."""
    geometry, interpolation = scene.geometry, scene.interpolation
    t = scene.types
    real, vec2, vec3, Field, Control, StopGeometry = t.real, t.vec2, t.vec3, t.Field, t.Control, t.StopGeometry
    Stride = t.Stride
    tiny = TINY[scene.precision]
    bends = build_bends(scene)
    # The jumps of other interpolants are not all of their kinks: steps end at every edge.
    kinks_passed = interpolation == "bilinear"
    twice_kink_share = 2.0 * KINK_SHARE

    @wp.func
    def edge_end(field: Field, edge: int):
        """The second corner of an edge; the first has the edge's number."""
        if edge % 4 < 3:
            return field.corners[edge + 1]
        return field.corners[edge - 3]

    @wp.func
    def edge_time(field: Field, edge: int, frac: vec3, velocity: vec3, force: vec3, first: real, stand_off: real):
        """Time [sigma], not before `first`, at which a ray comes within `stand_off` [m] of an edge from inside."""
        a = field.corners[edge]
        side = edge_end(field, edge) - a
        inside = stand_off * wp.length(side)
        best = real(NO_EDGE)
        if wp.static(geometry == "planar"):
            left = side[0] * (frac[2] - a[1]) - side[1] * (frac[1] - a[0]) - inside
            rise = side[0] * velocity[2] - side[1] * velocity[1]
            bend = real(0.5) * (side[0] * force[2] - side[1] * force[1])
            square = rise * rise - real(4.0) * bend * left
            if left + first * (rise + first * bend) < real(0.0) and rise + real(2.0) * first * bend < real(0.0):
                best = first  # it is just behind the edge
            elif square >= real(0.0):
                time = real(NO_EDGE)
                if rise < real(0.0):
                    time = left / (real(0.5) * (wp.sqrt(square) - rise))
                elif bend < real(0.0):
                    time = real(-0.5) * (rise + wp.sqrt(square)) / bend
                if time >= first:
                    best = time
        else:
            r = wp.length(vec2(frac[0], frac[1]))
            e = side[1]
            c = side[0] * (frac[2] - a[1]) + e * a[0] - inside
            b = side[0] * velocity[2]
            s1 = frac[0] * velocity[0] + frac[1] * velocity[1]
            s2 = velocity[0] * velocity[0] + velocity[1] * velocity[1]
            q0 = (c - e * r) * (c + e * r)
            q1 = c * b - e * e * s1
            q2 = b * b - e * e * s2
            spin = e * (frac[0] * velocity[1] - frac[1] * velocity[0])
            apart = vec2(b * frac[0] - c * velocity[0], b * frac[1] - c * velocity[1])
            square = wp.dot(apart, apart) - spin * spin
            r_first = wp.sqrt(wp.max(r * r + first * (real(2.0) * s1 + first * s2), real(0.0)))
            # The difference of the squares has the same rounding as their roots below.
            apart_first = (q0 + first * (real(2.0) * q1 + first * q2)) * (c + b * first + e * r_first)
            if apart_first < real(0.0) and b * r_first < e * (s1 + s2 * first):
                best = first  # it is just behind the edge
            elif square >= real(0.0):
                sign = real(1.0)
                if q1 < real(0.0):
                    sign = real(-1.0)
                w = -(q1 + sign * wp.abs(e) * wp.sqrt(square))
                for k in range(2):
                    above, below = w, q2
                    if k == 1:
                        above, below = q0, w
                    if below != real(0.0):
                        time = above / below
                        there = wp.sqrt(wp.max(r * r + time * (real(2.0) * s1 + time * s2), real(0.0)))
                        outward = e * (s1 + s2 * time) / wp.max(there, real(tiny))
                        if (c + b * time) * e >= real(0.0) and b < outward and time >= first and time < best:
                            best = time
        return best

    @wp.func
    def step_to_edge(
        field: Field,
        control: Control,
        current_cell: int,
        frac: vec3,
        total: vec3,
        force: vec3,
        index: real,
        longest: real,
        gap: real,
        to_stop: StopGeometry,
        max_deflection: real,
        used: real,
    ):
        """The next step: up to the last edge that it may end at, at most `longest` [sigma].

        Beyond the mesh it goes on by a share of `gap`, and error control finds the mesh's boundary.
        """
        out = Stride()
        out.edge = int(-1)
        arm = bends.bend_arm(to_stop, max_deflection)
        share = real(STEP_SHARE) * wp.max(real(1.0) - used / control.tolerance, real(0.0))
        near = field.edge_tolerance / wp.length(total)
        cell = int(current_cell)
        now, kinks = real(0.0), real(0.0)
        count = int(0)
        while count < wp.static(EDGES_PASSED) and cell >= 0:
            leaves = real(NO_EDGE)
            edge = int(-1)
            for k in range(4):
                found = edge_time(field, 4 * cell + k, frac, total, force, now - near, real(0.0))
                if found < leaves:
                    leaves = found
                    edge = 4 * cell + k
            beyond = int(-1)
            if edge >= 0:
                beyond = field.neighbors[edge]
                leaves = wp.max(leaves, now)
            else:
                leaves = now
            h = leaves
            if beyond < 0:
                # Just beyond the mesh, so that the next step begins in the gap: a longer one might fly over a hole.
                h += real(BEYOND) * gap
            h = wp.min(h, longest)
            if count > 0:
                allowed = control.tolerance * bends.bend_share(wp.max(share, h * index / to_stop.reach))
                bend = real(twice_kink_share) * h * kinks * arm + real(KINK_PATH) * h * h * kinks * field.ambient
                if wp.static(not kinks_passed) or bend > allowed:
                    break
            out.h = h
            out.kinks = kinks
            out.edge = int(-1)
            cell = int(-1)
            if beyond >= 0 and leaves <= longest:
                out.edge = edge
                cell = beyond
            now = leaves
            if edge >= 0:
                kinks = wp.length(vec2(kinks, field.kinks[edge]))
            count += 1
        if out.edge >= 0:
            # On the parabola, as far before the edge as it leaves out that the force changes over the step.
            stand_off = real(EDGE_STAND_OFF) * wp.length(force) * out.h * out.h
            bent = total
            if wp.static(geometry == "axisymmetric"):
                bent = total + (real(0.5) * out.h) * force
            h = edge_time(field, out.edge, frac, bent, force, real(0.5) * out.h, stand_off)
            if h < real(1.5) * out.h:
                out.h = wp.min(h, longest)
        return out

    @wp.func
    def rest_to_edge(field: Field, edge: int, frac: vec3, velocity: vec3, force: vec3, h: real):
        """Rest [sigma] to the edge before which a step of length h stopped; -1 if it is too long for this force."""
        near = field.edge_tolerance / wp.length(velocity)
        rest = edge_time(field, edge, frac, velocity, force, -near, real(0.0))
        if wp.static(geometry == "axisymmetric"):
            if rest <= h:
                rest = edge_time(field, edge, frac, velocity + (real(0.5) * rest) * force, force, -near, real(0.0))
        if rest <= real(REST) * h + near:
            return wp.max(rest, real(0.0))
        return real(-1.0)

    @wp.func
    def edge_rounding(field: Field, edge: int, frac: vec3, velocity: vec3, h: real):
        """Momentum that a ray may gain because the place of its crossing is rounded; at most over a length h."""
        side = edge_end(field, edge) - field.corners[edge]
        along = vec2(velocity[1], velocity[2])
        if wp.static(geometry == "axisymmetric"):
            outward = frac[0] * velocity[0] + frac[1] * velocity[1]
            along = vec2(outward / wp.max(wp.length(vec2(frac[0], frac[1])), real(tiny)), velocity[2])
        pace = wp.abs(side[0] * along[1] - side[1] * along[0]) / wp.length(side)
        late = real(EDGE_ROUNDING) * field.edge_tolerance
        if late < h * pace:
            return field.kinks[edge] * (late / pace)
        return field.kinks[edge] * h

    return SimpleNamespace(**locals())
