"""Device functions: where straight lines cross the surface of the body, by exact formulas. In float64.

The formulas are in medium/bodies/crossings.py, the tree of boxes in medium/bodies/wall_tree.py. A line p + t d is a
struct WallLine, see `wall_line`; d need not be a unit vector.
"""

from types import SimpleNamespace

import warp as wp

from .....medium.bodies.crossings import LEAST_SIDE, PARALLEL
from ....scheme import GRAZING_SQUARE
from ..library import TYPES, Scene, built_once
from .box import slab

# These structs have no members of the kernels' precision, so both precisions share them.
WallLine, Crossings, WallMeeting = (TYPES["float64"].kinds[name] for name in ("WallLine", "Crossings", "WallMeeting"))
NEVER = 1e300  # stands for a distance that does not exist


@wp.func
def axes_across(line: WallLine):
    """Set a line's two unit vectors across its direction, right-handed with it."""
    one = wp.float64(1.0)
    e = line.toward / wp.sqrt(line.square)
    sign = one
    if e[2] < wp.float64(0.0):
        sign = -one
    a = -one / (sign + e[2])
    b = e[0] * e[1] * a
    line.right = wp.vec3d(one + sign * e[0] * e[0] * a, sign * b, -sign * e[0])
    line.up = wp.vec3d(b, sign + e[1] * e[1] * a, -e[1])
    return line


@wp.func
def passes_volume_box(
    line: WallLine, low: wp.vec3d, high: wp.vec3d, margin: wp.float64, first: wp.float64, last: wp.float64
):
    """Whether a line may pass a box between t = first and last. The box is enlarged by `margin` on every side."""
    span = wp.vec2d(first, last)
    for k in range(3):
        span = slab(low[k] - margin, high[k] + margin, line.point[k], line.toward[k], span)
    return span[0] <= span[1]


@wp.func
def corner_across(line: WallLine, corner: wp.vec3d):
    """Coordinates of a corner across a line (two) and along it."""
    offset = corner - line.point
    return wp.vec3d(wp.dot(line.right, offset), wp.dot(line.up, offset), wp.dot(line.toward, offset))


@wp.func
def edge_side(a: wp.vec3d, b: wp.vec3d):
    """Side of the edge from a to b on which the line is: positive on the left, never zero, opposite from b to a."""
    p = a
    q = b
    sign = wp.float64(1.0)
    if a[0] > b[0] or (a[0] == b[0] and a[1] > b[1]):
        p = b
        q = a
        sign = wp.float64(-1.0)
    side = p[0] * q[1] - p[1] * q[0]
    if not (side > wp.float64(0.0)):
        side = wp.min(side, wp.float64(-LEAST_SIDE))
    return sign * side


@wp.func
def triangle_crossing(line: WallLine, one: wp.vec3d, two: wp.vec3d, three: wp.vec3d):
    """Crossings of a line with a triangle."""
    none = wp.float64(0.0)
    out = Crossings()
    out.count = 0
    a = corner_across(line, one)
    b = corner_across(line, two)
    c = corner_across(line, three)
    ab = edge_side(a, b)
    bc = edge_side(b, c)
    ca = edge_side(c, a)
    if (ab > none) == (bc > none) and (bc > none) == (ca > none):
        out.count = 1
        out.enters = ab < none
        out.one = (bc * a[2] + ca * b[2] + ab * c[2]) / ((ab + bc + ca) * line.square)
    return out


@wp.func
def may_enter_triangle(
    line: WallLine,
    a: wp.vec3d,
    b: wp.vec3d,
    c: wp.vec3d,
    margin: wp.float64,
    t_enter: wp.float64,
    t_exit: wp.float64,
):
    """Whether a line may enter the body through a triangle between t_enter and t_exit if moved by `margin`.

    A triangle through which the line can only leave the body does not count; one that it grazes does.
    """
    normal = wp.cross(b - a, c - a)
    rising = wp.dot(normal, line.toward)
    grazing = wp.float64(GRAZING_SQUARE) * wp.dot(normal, normal) * line.square
    if rising > wp.float64(0.0) and rising * rising > grazing:
        return False
    return passes_volume_box(line, wp.min(a, wp.min(b, c)), wp.max(a, wp.max(b, c)), margin, t_enter, t_exit)


@built_once("geometry")
def build_crossings(scene: Scene):
    """Build the functions about straight lines and the body's surface."""
    geometry = scene.geometry
    t = scene.types
    Field = t.Field

    if geometry == "volume":

        @wp.func
        def wall_line(p: wp.vec3d, d: wp.vec3d):
            """WallLine of a line."""
            line = WallLine()
            line.along = d[2]
            line.z = p[2]
            line.square = wp.dot(d, d)
            line.point = p
            line.toward = d
            return axes_across(line)

    else:

        @wp.func
        def wall_line(p: wp.vec3d, d: wp.vec3d):
            line = WallLine()
            line.along = d[2]
            line.z = p[2]
            if wp.static(geometry == "axisymmetric"):
                a = d[0] * d[0] + d[1] * d[1]
                if a < wp.float64(PARALLEL) * (a + d[2] * d[2]):
                    line.across = wp.float64(0.0)
                    line.nearest = wp.float64(0.0)
                    line.first = p[0] * p[0] + p[1] * p[1]
                else:
                    moment = p[0] * d[1] - p[1] * d[0]
                    line.across = a
                    line.nearest = -(p[0] * d[0] + p[1] * d[1]) / a
                    line.first = moment * moment / a
                line.height = p[2] + line.nearest * d[2]
                line.square = wp.float64(0.0)
            else:
                line.across = d[1]
                line.nearest = wp.float64(0.0)
                line.first = p[1]
                line.height = p[2]
                line.square = d[1] * d[1] + d[2] * d[2]
            return line

    @wp.func
    def passes_box(line: WallLine, box: wp.vec4d, margin: wp.float64, first: wp.float64, last: wp.float64):
        """Whether a line may pass a box between t = first and last.

        The box, lowest and greatest (r, z), is enlarged by `margin` on every side.
        """
        none = wp.float64(0.0)
        near = wp.float64(first)
        far = wp.float64(last)
        if line.along == none:
            if line.z < box[1] - margin or line.z > box[3] + margin:
                return False
        else:
            one = (box[1] - margin - line.z) / line.along
            other = (box[3] + margin - line.z) / line.along
            near = wp.max(near, wp.min(one, other))
            far = wp.min(far, wp.max(one, other))
        if near > far:
            return False
        low = box[0] - margin
        high = box[2] + margin
        if wp.static(geometry == "axisymmetric"):
            n = near - line.nearest
            f = far - line.nearest
            closest = wp.max(n, none) + wp.min(f, none)
            least = line.first + line.across * closest * closest
            most = line.first + line.across * wp.max(n * n, f * f)
            return least <= high * high and (low <= none or not (most < low * low))
        if line.across == none:
            return line.first >= low and line.first <= high
        one = (low - line.first) / line.across
        other = (high - line.first) / line.across
        return wp.max(near, wp.min(one, other)) <= wp.min(far, wp.max(one, other))

    @wp.func
    def corner_side(line: WallLine, place: wp.float64, height: wp.float64):
        """Axisymmetric: positive if a corner is outside the surface that the line sweeps about the axis.

        Planar: the side of the line on which a corner is.
        """
        if wp.static(geometry == "axisymmetric"):
            return line.along * line.along * (place * place - line.first) - line.across * height * height
        return line.across * (height - line.z) - line.along * (place - line.first)

    if geometry == "axisymmetric":

        @wp.func
        def segment_crossings(line: WallLine, segment: wp.vec4d, entries_only: bool):
            """Crossings of a line with a segment.

            With `entries_only`, a single crossing that leads out of the body is skipped, which saves a root and a
            division.
            """
            none = wp.float64(0.0)
            out = Crossings()
            out.count = 0
            dr = segment[2] - segment[0]
            dz = segment[3] - segment[1]
            d = line.along
            h1 = segment[1] - line.height
            h2 = segment[3] - line.height
            w1 = corner_side(line, segment[0], h1)
            w2 = corner_side(line, segment[2], h2)
            from_outside = w1 > none
            once = from_outside != (w2 > none)
            if from_outside and not once:
                return out
            if once:
                out.enters = d > none
                if from_outside:
                    out.enters = d < none
                if entries_only and not out.enters:
                    return out
                out.count = 1
            steepness = line.across * dz * dz - d * d * dr * dr
            if steepness > none:
                # Less steep than the line: find the roots of the cone's equation.
                k = segment[0] * dz - h1 * dr
                mean = k * dr * d
                rest = line.first * dz * dz - k * k
                square = mean * mean - steepness * rest
                root = wp.sqrt(wp.max(square, none))
                larger = mean - root
                if mean >= none:
                    larger = mean + root
                other = wp.float64(0.0)
                if larger != none:
                    other = rest / larger
                low = wp.min(larger / steepness, other)
                high = wp.max(larger / steepness, other)
                if once:
                    toward = -dz * d
                    if from_outside:
                        toward = dz * d
                    out.one = line.nearest + low
                    if toward > none:
                        out.one = line.nearest + high
                else:
                    middle = line.height + d * (mean / steepness)
                    if square > none and (segment[1] > middle) != (segment[3] > middle):
                        out.count = 2
                        out.enters = dz > none
                        out.one = line.nearest + low
                        out.two = line.nearest + high
            elif once:
                # As steep as the line or steeper: solve for the place along the segment.
                slope = d * d * segment[0] * dr - line.across * h1 * dz
                root = wp.sqrt(wp.max(slope * slope + steepness * w1, none))
                share = wp.float64(0.0)
                if from_outside:
                    share = w1 / (root - slope)
                elif slope > none:
                    share = -w1 / (slope + root)
                else:
                    share = (root - slope) / -steepness
                out.one = (segment[1] + wp.min(wp.max(share, none), wp.float64(1.0)) * dz - line.z) / d
            return out

    else:

        @wp.func
        def segment_crossings(line: WallLine, segment: wp.vec4d, entries_only: bool):
            out = Crossings()
            out.count = 0
            side = corner_side(line, segment[0], segment[1])
            other = corner_side(line, segment[2], segment[3])
            if (side > wp.float64(0.0)) != (other > wp.float64(0.0)) and (side > other or not entries_only):
                share = side / (side - other)
                y = segment[0] + share * (segment[2] - segment[0]) - line.first
                z = segment[1] + share * (segment[3] - segment[1]) - line.z
                out.count = 1
                out.enters = side > other
                out.one = (y * line.across + z * line.along) / line.square
            return out

    if geometry == "volume":

        @wp.func
        def passes_node(
            field: Field, line: WallLine, node: int, margin: wp.float64, first: wp.float64, last: wp.float64
        ):
            """Whether a line may pass the box of a node of the tree.

            The box is enlarged by `margin`; only the line between t = first and last counts.
            """
            low = field.wall_boxes[2 * node]
            high = field.wall_boxes[2 * node + 1]
            return passes_volume_box(
                line, wp.vec3d(low[0], low[1], low[2]), wp.vec3d(high[0], high[1], high[2]), margin, first, last
            )

    else:

        @wp.func
        def passes_node(
            field: Field, line: WallLine, node: int, margin: wp.float64, first: wp.float64, last: wp.float64
        ):
            return passes_box(line, field.wall_boxes[node], margin, first, last)

    @wp.func
    def triangle_at(field: Field, piece: int, corner: int):
        """A corner of a triangle of the surface."""
        row = field.wall[3 * piece + corner]
        return wp.vec3d(row[0], row[1], row[2])

    if geometry == "volume":

        @wp.func
        def piece_crossings(field: Field, line: WallLine, piece: int):
            """Crossings of a line with a piece of the surface."""
            return triangle_crossing(
                line, triangle_at(field, piece, 0), triangle_at(field, piece, 1), triangle_at(field, piece, 2)
            )

    else:

        @wp.func
        def piece_crossings(field: Field, line: WallLine, piece: int):
            return segment_crossings(line, field.wall[piece], bool(False))

    @wp.func
    def meet_wall(field: Field, line: WallLine, first: wp.float64, last: wp.float64):
        """WallMeeting of a line with the body between t = first and last."""
        found = WallMeeting()
        found.entry = wp.float64(NEVER)
        found.exit = wp.float64(NEVER)
        found.odd = False
        node = int(0)
        while node < field.wall_count:
            links = field.wall_links[node]
            onward = links[0]
            if passes_node(field, line, node, wp.float64(0.0), first, last):
                onward = node + 1
                for k in range(links[1], links[2]):
                    at = piece_crossings(field, line, k)
                    for j in range(at.count):
                        t = at.one
                        enters = at.enters
                        if j == 1:
                            t = at.two
                            enters = not at.enters
                        if t >= first and t <= last:
                            found.odd = not found.odd
                            if enters:
                                found.entry = wp.min(found.entry, t)
                            else:
                                if t < found.exit:
                                    found.exit = t
                                    found.piece = k
            node = onward
        return found

    return SimpleNamespace(**locals())
