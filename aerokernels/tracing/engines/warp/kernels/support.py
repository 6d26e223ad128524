"""Device functions about the field's support, the part of the box in which the air is not uniform, and paths out of it.

Outside the support a ray is a straight line, whose intersection with the faces of the box is computed exactly.
"""

import warp as wp

from ....scheme import FACE_TOLERANCE
from ..library import KernelLibrary, built_once
from .box import FACE_COUNT, build_crossing, build_surface_distance


@built_once
def build_overrun(library: KernelLibrary, geometry: str):
    """Build a function -> distance that a ray ending at p has run outside the box, beyond a face other than `ends_on`.

    Infinite if it is farther outside than FACE_TOLERANCE.
    """
    t = library.types
    Bounds, Control = t.Bounds, t.Control
    surface_distance = build_surface_distance(library, geometry)
    faces = wp.constant(FACE_COUNT[geometry])

    @wp.func
    def overrun(bounds: Bounds, control: Control, ends_on: int, p: wp.vec3d, heading: wp.vec3d):
        face_tolerance = wp.float64(FACE_TOLERANCE) / wp.float64(wp.max(control.cell_rate))
        excess = wp.float64(0.0)
        for k in range(faces):
            beyond = surface_distance(bounds, k, p)
            if k != ends_on and beyond[0] > wp.float64(0.0):
                slope = wp.abs(wp.dot(wp.vec3d(beyond[1], beyond[2], beyond[3]), heading))
                excess = wp.max(excess, beyond[0] / wp.max(slope, wp.float64(1.0e-9)))
                if beyond[0] > face_tolerance:
                    excess = wp.float64(wp.inf)
        return excess

    return overrun


@built_once
def build_may_have_left(library: KernelLibrary, geometry: str):
    """Build a function: whether a ray along a face, deflected by at most `angle`, may have left the box and come back.

    The undisturbed ray is of length `length` and ends at p.
    """
    Bounds = library.types.Bounds
    surface_distance = build_surface_distance(library, geometry)
    faces = wp.constant(FACE_COUNT[geometry])

    @wp.func
    def may_have_left(bounds: Bounds, p: wp.vec3d, d: wp.vec3d, length: wp.float64, angle: wp.float64):
        may = bool(False)
        for k in range(faces):
            is_far = bool(False)
            if wp.static(geometry == "axisymmetric"):
                if k == 2:
                    is_far = p[0] * p[0] + p[1] * p[1] <= wp.float64(0.25) * bounds.radius * bounds.radius
            if not is_far:
                beyond = surface_distance(bounds, k, p)
                slope = wp.abs(wp.dot(wp.vec3d(beyond[1], beyond[2], beyond[3]), d))
                may = may or (slope <= angle and beyond[0] > -length * angle)
        return may

    return may_have_left


@built_once
def build_keep_support(library: KernelLibrary, geometry: str):
    """Build a function (bounds, p, d, t_enter, t_exit) -> (whether a ray ends in uniform air, t_enter, t_exit).

    It shortens the interval in the box to the part in which the air is not uniform.
    """
    Bounds = library.types.Bounds
    crossing = build_crossing(library, geometry)

    @wp.func
    def keep_support(bounds: Bounds, p: wp.vec3d, d: wp.vec3d, t_enter: wp.float64, t_exit: wp.float64):
        span = crossing(bounds.support_low, bounds.support_high, bounds.support_radius, p, d)
        if span[0] > span[1]:
            return bool(True), t_enter, t_enter
        first = wp.min(wp.max(span[0], t_enter), t_exit)
        last = wp.max(wp.min(span[1], t_exit), first)
        return bool(last < t_exit), first, last

    return keep_support


@built_once
def build_leaves_support(library: KernelLibrary, geometry: str):
    """Build a function: whether the straight line from p along `heading` stays out of the field's support.

    It does if p is beyond a face of the support and the line does not approach that face. A support that ends within
    the box has a spare cell at each side (support.py).
    """
    Bounds = library.types.Bounds
    flat = {"volume": (0, 1, 2), "planar": (1, 2), "axisymmetric": (2,)}[geometry]
    first_axis = flat[0]

    @wp.func
    def leaves_support(bounds: Bounds, p: wp.vec3d, heading: wp.vec3d):
        none = wp.float64(0.0)
        leaves = bool(False)
        for axis in range(wp.static(first_axis), 3):
            below = wp.min(bounds.support_low[axis] - bounds.low[axis], bounds.spacing[axis])
            above = wp.min(bounds.high[axis] - bounds.support_high[axis], bounds.spacing[axis])
            if p[axis] <= bounds.support_low[axis] + below and heading[axis] <= none:
                leaves = bool(True)
            if p[axis] >= bounds.support_high[axis] - above and heading[axis] >= none:
                leaves = bool(True)
        if wp.static(geometry == "axisymmetric"):
            inner = bounds.support_radius - wp.min(bounds.radius - bounds.support_radius, bounds.spacing[0])
            outward = p[0] * heading[0] + p[1] * heading[1]
            if p[0] * p[0] + p[1] * p[1] >= inner * inner and outward >= none:
                leaves = bool(True)
        return leaves

    return leaves_support


@built_once
def build_exit(library: KernelLibrary, geometry: str):
    """Build a function (bounds, p, heading) -> (distance at which a line from p leaves the box, number of the face).

    The distance is in units of `heading`, and not a number if the line misses the box.
    """
    Bounds = library.types.Bounds
    crossing = build_crossing(library, geometry)
    surface_distance = build_surface_distance(library, geometry)
    faces = wp.constant(FACE_COUNT[geometry])

    @wp.func
    def exit_of(bounds: Bounds, p: wp.vec3d, heading: wp.vec3d):
        span = crossing(bounds.low, bounds.high, bounds.radius, p, heading)
        nearest = int(0)
        least = wp.float64(1.0e300)
        for k in range(faces):
            miss = wp.abs(surface_distance(bounds, k, p + span[1] * heading)[0])
            if miss < least:
                least = miss
                nearest = k
        leave = span[1]
        if span[0] > span[1]:
            leave = wp.float64(wp.nan)
        return leave, nearest

    return exit_of


@built_once
def build_line_to(library: KernelLibrary, geometry: str):
    """Build a function (bounds, k, p, heading) -> distance at which a line from p meets surface k going outward.

    The distance is in units of `heading`, and not a number if the line never does.
    """
    Bounds = library.types.Bounds
    surface_distance = build_surface_distance(library, geometry)

    @wp.func
    def line_to(bounds: Bounds, k: int, p: wp.vec3d, heading: wp.vec3d):
        if wp.static(geometry == "axisymmetric"):
            if k == 2:
                a = heading[0] * heading[0] + heading[1] * heading[1]
                b = p[0] * heading[0] + p[1] * heading[1]
                c = p[0] * p[0] + p[1] * p[1] - bounds.radius * bounds.radius
                root = wp.sqrt(b * b - a * c)
                if b > wp.float64(0.0):
                    return -c / (b + root)
                return (root - b) / a
        miss = surface_distance(bounds, k, p)
        return -miss[0] / wp.dot(wp.vec3d(miss[1], miss[2], miss[3]), heading)

    return line_to
