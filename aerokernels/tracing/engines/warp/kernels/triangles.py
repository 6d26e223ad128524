"""Device functions: where straight lines cross the triangles of a body in a volume, watertight. In float64.

The formulas are in medium/bodies/triangle_crossings.py.
"""

import warp as wp

from aerokernels.medium.bodies.crossings import LEAST_SIDE

from ....scheme import GRAZING_SQUARE
from ..types import types

NEVER = 1e300  # stands for a distance that does not exist
WallLine, Crossings = (types("float64").kinds[name] for name in ("WallLine", "Crossings"))


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
def within_slab(place: wp.float64, along: wp.float64, low: wp.float64, high: wp.float64, span: wp.vec2d):
    """The part of `span` in which a coordinate of a line is between two bounds; reversed if there is none."""
    if along == wp.float64(0.0):
        if place < low or place > high:
            return wp.vec2d(wp.float64(NEVER), wp.float64(-NEVER))
        return span
    one = (low - place) / along
    other = (high - place) / along
    return wp.vec2d(wp.max(span[0], wp.min(one, other)), wp.min(span[1], wp.max(one, other)))


@wp.func
def passes_volume_box(
    line: WallLine, low: wp.vec3d, high: wp.vec3d, margin: wp.float64, first: wp.float64, last: wp.float64
):
    """Whether a line may pass a box between t = first and last. The box is enlarged by `margin` on every side."""
    span = wp.vec2d(first, last)
    for k in range(3):
        span = within_slab(line.point[k], line.toward[k], low[k] - margin, high[k] + margin, span)
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
