"""Device functions about the body: where a ray leaves it, whether a ray stays clear of it, where a step enters it.

Inside the body the index is the ambient index, so a ray that starts there is refracted where it leaves the body: by
Snell's law the momentum T = n dr/ds gains k N along the normal N. With c = d . N and T = a d before, |T| = n behind it,

    k = sqrt(a^2 c^2 + 2 s) - a c = 2 s / (a c + sqrt(a^2 c^2 + 2 s)),    s = (n^2 - a^2) / 2

All use the crossings of straight lines with the body's surface, see crossings.py.
"""

from types import SimpleNamespace

import warp as wp

from ....scheme import ENTRY_ROUNDING, GRAZING_SQUARE, WALL_SAG
from ..library import Scene, built_once
from .crossings import NEVER, WallLine, build_crossings, may_enter_triangle
from .motion import build_motion


@built_once("geometry")
def build_wall(scene: Scene):
    """Build the functions about rays and the body."""
    geometry = scene.geometry
    t = scene.types
    real, vec3, vec4, Field, Interval, Control = t.real, t.vec3, t.vec4, t.Field, t.Interval, t.Control
    crossings = build_crossings(scene)
    motion = build_motion(scene)
    least = 0.0 if geometry == "axisymmetric" else -NEVER

    @wp.func
    def body_exit(field: Field, p: wp.vec3d, d: wp.vec3d, first: wp.float64):
        """WallMeeting whose exit is where a ray that starts in the body leaves it.

        The exit is NEVER if it does not leave, and `first` for rays that start outside the body, which are not `odd`.
        """
        none = wp.float64(0.0)
        toward = d
        begin = wp.float64(first)
        along_x = bool(False)
        if wp.static(geometry == "planar"):
            if d[1] == none and d[2] == none:
                # Along x the ray stays in the body or beside it: a line in any other direction shows which.
                toward = wp.vec3d(none, none, wp.float64(1.0))
                begin = none
                along_x = bool(True)
        met = crossings.meet_wall(field, crossings.wall_line(p, toward), begin, wp.float64(NEVER))
        if not met.odd:
            met.exit = first
        elif along_x:
            met.exit = wp.float64(NEVER)
        return met

    if geometry == "volume":

        @wp.func
        def outward_normal(field: Field, piece: int, p: wp.vec3d):
            """Outward unit normal of the body at a point of a piece of its surface."""
            a = crossings.triangle_at(field, piece, 0)
            first = crossings.triangle_at(field, piece, 1) - a
            second = crossings.triangle_at(field, piece, 2) - a
            area = wp.cross(first, second)
            # Shares of the corners: those of the second and the third are areas within the triangle.
            shares = wp.vec2d(wp.dot(wp.cross(p - a, second), area), wp.dot(wp.cross(first, p - a), area))
            shares = shares / wp.dot(area, area)
            sum = (wp.float64(1.0) - shares[0] - shares[1]) * field.wall_normals[3 * piece]
            sum += shares[0] * field.wall_normals[3 * piece + 1] + shares[1] * field.wall_normals[3 * piece + 2]
            return wp.normalize(wp.vec3d(sum[0], sum[1], sum[2]))

    else:

        @wp.func
        def outward_normal(field: Field, piece: int, p: wp.vec3d):
            s = field.wall[piece]
            at_ends = field.wall_normals[piece]
            place = p[1]
            across = wp.vec2d(wp.float64(0.0), wp.float64(1.0))
            if wp.static(geometry == "axisymmetric"):
                across = wp.vec2d(p[0], p[1])
                place = wp.length(across)
                across = across / wp.max(place, wp.float64(1.0e-300))
            step = wp.vec2d(s[2] - s[0], s[3] - s[1])
            share = wp.dot(wp.vec2d(place - s[0], p[2] - s[1]), step) / wp.dot(step, step)
            r = at_ends[0] + share * (at_ends[2] - at_ends[0])
            return wp.normalize(wp.vec3d(r * across[0], r * across[1], at_ends[1] + share * (at_ends[3] - at_ends[1])))

    @wp.func
    def starting_momentum(ambient: real, pot: real, d: vec3, normal: wp.vec3d):
        """Deviation of the momentum where a ray begins.

        A ray that leaves the body, where `normal` is not zero, is refracted there; other rays keep their direction. A
        ray that would be reflected within the body runs along its surface.
        """
        outward = vec3(real(normal[0]), real(normal[1]), real(normal[2]))
        before = ambient * wp.dot(d, outward)
        if before <= real(0.0):
            return motion.contrast(ambient, pot) * d
        root = wp.sqrt(wp.max(before * before + real(2.0) * pot, real(0.0)))
        return wp.max(real(2.0) * pot / (before + root), -before) * outward

    @wp.func
    def body_entry(field: Field, p: wp.vec3d, d: wp.vec3d, last: wp.float64):
        """Distance at which a ray enters the body before it reaches the box.

        It reaches the box at `last`. NEVER if it does not enter.
        """
        none = wp.float64(0.0)
        along_x = bool(False)
        if wp.static(geometry == "planar"):
            along_x = d[1] == none and d[2] == none
        found = wp.float64(NEVER)
        if last > none and not along_x:
            found = crossings.meet_wall(
                field, crossings.wall_line(p, d), none, wp.float64(1.0 + ENTRY_ROUNDING) * last
            ).entry
        return found

    if geometry == "volume":

        @wp.func
        def may_enter(
            field: Field, line: WallLine, piece: int, margin: wp.float64, t_enter: wp.float64, t_exit: wp.float64
        ):
            """Whether a ray may enter the body through a piece.

            Either where the ray is, or if moved by `margin`: up and down in r and in z, or in a volume in any
            direction.
            """
            a = crossings.triangle_at(field, piece, 0)
            b = crossings.triangle_at(field, piece, 1)
            return may_enter_triangle(line, a, b, crossings.triangle_at(field, piece, 2), margin, t_enter, t_exit)

    else:

        @wp.func
        def moved_segment(s: wp.vec4d, r: wp.float64, z: wp.float64):
            """A segment moved in r and z; in an axisymmetric field it does not cross the axis."""
            return wp.vec4d(
                wp.max(s[0] + r, wp.float64(least)), s[1] + z, wp.max(s[2] + r, wp.float64(least)), s[3] + z
            )

        @wp.func
        def only_leaves(line: WallLine, s: wp.vec4d):
            """Whether a line, however it is shifted, can only leave the body through a segment, without grazing it.

            In an axisymmetric field, the side of the cone that leans most toward the line counts.
            """
            # (r, z) is the normal, out of the body.
            r = s[3] - s[1]
            z = s[0] - s[2]
            rising = z * line.along
            least = wp.float64(GRAZING_SQUARE) * (r * r + z * z)
            if wp.static(geometry == "axisymmetric"):
                least = wp.float64(2.0) * (r * r * line.across + least)
            else:
                rising = r * line.across + rising
                least = least * line.square
            return rising > wp.float64(0.0) and rising * rising > least

        @wp.func
        def may_enter(
            field: Field, line: WallLine, piece: int, margin: wp.float64, t_enter: wp.float64, t_exit: wp.float64
        ):
            found = bool(False)
            s = field.wall[piece]
            box = wp.vec4d(wp.min(s[0], s[2]), wp.min(s[1], s[3]), wp.max(s[0], s[2]), wp.max(s[1], s[3]))
            if not only_leaves(line, s) and crossings.passes_box(line, box, margin, t_enter, t_exit):
                for side in range(5):
                    r = wp.float64(0.0)
                    z = wp.float64(0.0)
                    if side == 1:
                        r = margin
                    if side == 2:
                        r = -margin
                    if side == 3:
                        z = margin
                    if side == 4:
                        z = -margin
                    at = crossings.segment_crossings(line, moved_segment(s, r, z), bool(True))
                    t = at.two
                    there = at.count > 1
                    if at.enters:
                        t = at.one
                        there = at.count > 0
                    if there and t > t_enter and t < t_exit:
                        found = bool(True)
            return found

    @wp.func
    def has_clearance(
        field: Field, p: wp.vec3d, d: wp.vec3d, t_enter: wp.float64, t_exit: wp.float64, margin: wp.float64
    ):
        """Whether a straight ray stays out of the body.

        It must do so between two distances, and so must the rays moved across the surface by `margin` [m]. Places where
        they leave the body do not matter, so a ray may begin on the wall.
        """
        line = crossings.wall_line(p, d)
        clear = bool(True)
        node = int(0)
        while node < field.wall_count and clear:
            links = field.wall_links[node]
            onward = links[0]
            if crossings.passes_node(field, line, node, margin, t_enter, t_exit):
                onward = node + 1
                for k in range(links[1], links[2]):
                    if clear and may_enter(field, line, k, margin, t_enter, t_exit):
                        clear = bool(False)
            node = onward
        return clear

    if geometry == "volume":

        @wp.func
        def comes_near(field: Field, here: wp.vec3d, within: wp.float64):
            """Whether a point is within `within` [m] of the box around the whole body.

            The distance is taken along each axis.
            """
            near = bool(True)
            low = field.wall_boxes[0]
            high = field.wall_boxes[1]
            for k in range(3):
                if here[k] - within > high[k] or here[k] + within < low[k]:
                    near = bool(False)
            return near

    else:

        @wp.func
        def comes_near(field: Field, here: wp.vec3d, within: wp.float64):
            whole = field.wall_boxes[0]
            beside = here[1]
            if wp.static(geometry == "axisymmetric"):
                beside = wp.sqrt(here[0] * here[0] + here[1] * here[1])
            is_beyond = here[2] - within > whole[3] or here[2] + within < whole[1]
            return not (is_beyond or beside - within > whole[2] or beside + within < whole[0])

    @wp.func
    def place_of(
        p: wp.vec3d,
        d: wp.vec3d,
        interval: Interval,
        ambient: wp.float64,
        q: vec3,
        q_carry: vec3,
        sums: vec4,
        sums_carry: vec4,
    ):
        """Position of a ray, from the sums of its steps so far."""
        sigma = wp.float64(sums[0]) - wp.float64(sums_carry[0])
        beside = wp.vec3d(
            wp.float64(q[0]) - wp.float64(q_carry[0]),
            wp.float64(q[1]) - wp.float64(q_carry[1]),
            wp.float64(q[2]) - wp.float64(q_carry[2]),
        )
        return p + (interval.t_enter + ambient * sigma) * d + beside

    @wp.func
    def behind_wall(
        field: Field, control: Control, here: wp.vec3d, tangent: vec3, kick: vec3, h: real, allowance: real
    ):
        """How much of a step of length h is behind its entry into the body; -1 if it does not enter.

        The step goes from `here` along its first tangent, with the bend `kick` [m]; it is replaced by chords that stay
        within WALL_SAG cells of it. `allowance`: how far before the step's start a wall counts, in the unit of h.
        """
        one = wp.float64(1.0)
        sag = wp.length(wp.cw_mul(kick, control.cell_rate)) / (real(4.0) * real(WALL_SAG))
        pieces = int(1)
        if sag > real(1.0):
            pieces = 1 + int(wp.min(wp.sqrt(sag), real(15.0)))
        flown = h * tangent
        straight = wp.vec3d(wp.float64(flown[0]), wp.float64(flown[1]), wp.float64(flown[2]))
        bend = wp.vec3d(wp.float64(kick[0]), wp.float64(kick[1]), wp.float64(kick[2]))
        begin = here
        found = real(-1.0)
        first = -wp.float64(pieces) * wp.float64(allowance / h)
        # Most steps are far from the box around the whole body: they need no line.
        within = wp.float64(h + allowance) * wp.float64(wp.length(tangent)) + wp.float64(wp.length(kick))
        k = int(0)
        if not comes_near(field, here, within):
            k = pieces
        while k < pieces:
            share = wp.float64(k + 1) / wp.float64(pieces)
            end = here + share * straight + (share * share) * bend
            met = crossings.meet_wall(field, crossings.wall_line(begin, end - begin), first, one)
            if met.entry <= one:
                found = real(one - (wp.float64(k) + met.entry) / wp.float64(pieces)) * h
                k = pieces
            begin = end
            first = wp.float64(-1.0e-9)
            k += 1
        return found

    return SimpleNamespace(**locals())
