"""Device functions about the field's support, the part of the box in which the air is not uniform, and paths out of it.

Outside the support a ray is a straight line, whose intersection with the faces of the box is computed exactly. Within
it the error from features between samples is looked up in a table (tracing/tasks/unresolved.py).
"""

from types import SimpleNamespace

import warp as wp

from ....scheme import FACE_TOLERANCE, LEAST_COSINE, LOOKUP_STRIDE, MISSED_SLOPE
from ..library import Scene, built_once
from .box import FACE_COUNT, build_box


@built_once("geometry")
def build_support(scene: Scene):
    """Build the functions about a field's support, and about structure between samples."""
    geometry = scene.geometry
    t = scene.types
    real, vec3, Bounds, Control, Field = t.real, t.vec3, t.Bounds, t.Control, t.Field
    box = build_box(scene)
    faces = wp.constant(FACE_COUNT[geometry])
    flat = {"volume": (0, 1, 2), "planar": (1, 2), "axisymmetric": (2,)}[geometry]
    first_axis = flat[0]

    @wp.func
    def overrun(bounds: Bounds, control: Control, ends_on: int, p: wp.vec3d, heading: wp.vec3d):
        """Distance that a ray ending at p has run outside the box, beyond a face other than `ends_on`.

        Infinite if it is farther outside than FACE_TOLERANCE.
        """
        face_tolerance = wp.float64(FACE_TOLERANCE) / wp.float64(wp.max(control.cell_rate))
        excess = wp.float64(0.0)
        for k in range(faces):
            beyond = box.surface_distance(bounds, k, p)
            if k != ends_on and beyond[0] > wp.float64(0.0):
                slope = wp.abs(wp.dot(wp.vec3d(beyond[1], beyond[2], beyond[3]), heading))
                excess = wp.max(excess, beyond[0] / wp.max(slope, wp.float64(1.0e-9)))
                if beyond[0] > face_tolerance:
                    excess = wp.float64(wp.inf)
        return excess

    @wp.func
    def may_have_left(bounds: Bounds, p: wp.vec3d, d: wp.vec3d, length: wp.float64, angle: wp.float64):
        """Whether a ray along a face, deflected by at most `angle`, may have left the box and come back.

        The undisturbed ray is of length `length` and ends at p.
        """
        may = bool(False)
        for k in range(faces):
            is_far = bool(False)
            if wp.static(geometry == "axisymmetric"):
                if k == 2:
                    is_far = p[0] * p[0] + p[1] * p[1] <= wp.float64(0.25) * bounds.radius * bounds.radius
            if not is_far:
                beyond = box.surface_distance(bounds, k, p)
                slope = wp.abs(wp.dot(wp.vec3d(beyond[1], beyond[2], beyond[3]), d))
                may = may or (slope <= angle and beyond[0] > -length * angle)
        return may

    @wp.func
    def keep_support(bounds: Bounds, p: wp.vec3d, d: wp.vec3d, t_enter: wp.float64, t_exit: wp.float64):
        """Whether a ray ends in uniform air, t_enter, t_exit.

        It shortens the interval in the box to the part in which the air is not uniform.
        """
        span = box.crossing(bounds.support_low, bounds.support_high, bounds.support_radius, p, d)
        if span[0] > span[1]:
            return bool(True), t_enter, t_enter
        first = wp.min(wp.max(span[0], t_enter), t_exit)
        last = wp.max(wp.min(span[1], t_exit), first)
        return bool(last < t_exit), first, last

    @wp.func
    def leaves_support(bounds: Bounds, p: wp.vec3d, heading: wp.vec3d):
        """Whether the straight line from p along `heading` stays out of the field's support.

        It does if p is beyond a face of the support and the line does not approach that face. A support that ends
        within the box has a spare cell at each side (support.py).
        """
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

    @wp.func
    def exit_of(bounds: Bounds, p: wp.vec3d, heading: wp.vec3d):
        """Distance at which a line from p leaves the box, number of the face.

        The distance is in units of `heading`, and not a number if the line misses the box.
        """
        span = box.crossing(bounds.low, bounds.high, bounds.radius, p, heading)
        nearest = box.nearest_face(bounds, p + span[1] * heading)
        leave = span[1]
        if span[0] > span[1]:
            leave = wp.float64(wp.nan)
        return leave, nearest

    @wp.func
    def line_to(bounds: Bounds, k: int, p: wp.vec3d, heading: wp.vec3d):
        """Distance at which a line from p meets surface k going outward.

        The distance is in units of `heading`, and not a number if the line never does.
        """
        if wp.static(geometry == "axisymmetric"):
            if k == 2:
                a = heading[0] * heading[0] + heading[1] * heading[1]
                b = p[0] * heading[0] + p[1] * heading[1]
                c = p[0] * p[0] + p[1] * p[1] - bounds.radius * bounds.radius
                root = wp.sqrt(b * b - a * c)
                if b > wp.float64(0.0):
                    return -c / (b + root)
                return (root - b) / a
        miss = box.surface_distance(bounds, k, p)
        return -miss[0] / wp.dot(wp.vec3d(miss[1], miss[2], miss[3]), heading)

    @wp.func
    def block_of(control: Control, axis: int, place: real):
        """Block of the table along one of its axes; places are in cells."""
        return wp.clamp(int(wp.floor(place / real(control.block))), 0, control.block_count[axis] - 1)

    @wp.func
    def entry_at(control: Control, p: vec3):
        """Entry of the table at a place in cells."""
        entry = int(0)
        if wp.static(geometry == "volume"):
            entry = block_of(control, 0, p[0]) * control.block_count[1] + block_of(control, 1, p[1])
            entry = entry * control.block_count[2] + block_of(control, 2, p[2])
        elif wp.static(geometry == "planar"):
            entry = block_of(control, 0, p[1]) * control.block_count[1] + block_of(control, 1, p[2])
        else:
            entry = block_of(control, 0, wp.sqrt(p[0] * p[0] + p[1] * p[1])) * control.block_count[1]
            entry += block_of(control, 1, p[2])
        return entry

    @wp.func
    def unresolved_of(field: Field, control: Control, start: vec3, d: vec3, length: real, beside: vec3):
        """A bound of the error of a ray's path [m].

        The ray starts at `start`, in cells from the grid's first node (x, y from the axis), runs along the unit vector
        d for `length` metres, and ends `beside` [m] beside that line. 0 without a table, infinite if the samples are
        further apart than the table is valid for.
        """
        if control.step_bound_start[0] < 0:
            return real(0.0)
        rate = field.inverse_spacing
        if length > real(1.001) * control.step * real(control.sample_count):
            return real(wp.inf)
        ahead = wp.max(wp.abs(d[1]) * rate[1], wp.abs(d[2]) * rate[2]) * length
        if wp.static(geometry != "planar"):
            ahead = wp.max(ahead, wp.abs(d[0]) * rate[0] * length)
        count = wp.max(int(wp.ceil(ahead / (real(LOOKUP_STRIDE) * real(control.block)))), 1)
        total = real(0.0)
        for k in range(count):
            share = (real(k) + real(0.5)) / real(count)
            p = start + wp.cw_mul(share * length * d + share * share * beside, rate)
            total += control.step_bound[entry_at(control, p)]
        missed = total * length / real(count)
        at_ends = control.step_bound_start[1]
        if at_ends >= 0:
            end = start + wp.cw_mul(length * d + beside, rate)
            missed += control.step_bound[at_ends + entry_at(control, start)]
            missed += control.step_bound[at_ends + entry_at(control, end)]
        return missed

    @wp.func
    def with_lever_arm(field: Field, missed: real, onward: real, cosine: real):
        """Error of the path [m] including that from the direction.

        The ray meets its stop `onward` metres further on at this cosine with the stop's normal.
        """
        tangent = wp.sqrt(wp.max(real(1.0) - cosine * cosine, real(0.0))) / wp.max(cosine, real(LEAST_COSINE))
        return missed * (real(1.0) + real(MISSED_SLOPE) * wp.max(field.inverse_spacing) * onward * tangent)

    return SimpleNamespace(**locals())
