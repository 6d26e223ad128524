"""Device functions: both ends of a ray, before its first step and after its last one. In float64."""

from types import SimpleNamespace

import warp as wp

from ....scheme import (
    ARC_SURFACE,
    DIRECTION_NOISE,
    ENTRY_ROUNDING,
    INCIDENCE_NOISE,
    LEAST_COSINE,
    LEAST_SLOPE,
    STEEPEST_COSINE,
)
from ....stop import RayStatus
from ....tableau import NEARLY_STRAIGHT, has_consistent_gradient
from ..library import Scene, built_once
from .box import FACE_COUNT, build_box
from .crossings import NEVER
from .motion import deflection
from .wall import build_wall


@built_once("geometry", "interpolation", "method", "stop", "has_body")
def build_ends(scene: Scene):
    """Build the functions of both ends of a ray."""
    geometry, interpolation, method = scene.geometry, scene.interpolation, scene.method
    stop, has_body = scene.stop, scene.has_body
    t = scene.types
    real, vec3, vec4, Field, Bounds, Interval = t.real, t.vec3, t.vec4, t.Field, t.Bounds, t.Interval
    StopGeometry, Control, Arrival = t.StopGeometry, t.Control, t.Arrival
    box, wall = build_box(scene), build_wall(scene)
    inside_body, hit_body = int(RayStatus.INSIDE_BODY), int(RayStatus.HIT_BODY)
    faces = wp.constant(FACE_COUNT[geometry])
    direction_noise = DIRECTION_NOISE[scene.precision]
    consistent_gradient = has_consistent_gradient(interpolation)
    ok, missed_field, not_reached = int(RayStatus.OK), int(RayStatus.MISSED_FIELD), int(RayStatus.STOP_NOT_REACHED)

    @wp.func
    def start_of(field: Field, bounds: Bounds, p: wp.vec3d, d: wp.vec3d):
        """Initial status of a ray, and Interval of the undisturbed ray."""
        none = wp.float64(0.0)
        status = int(ok)

        # Where the undisturbed ray stops, and whether it meets the box before.
        span = box.crossing(bounds.low, bounds.high, bounds.radius, p, d)
        enter = wp.max(span[0], none)
        meets = span[0] <= span[1] and span[1] >= none
        stop_distance = span[1]
        has_stop = bool(True)
        side = real(1.0)
        if wp.static(stop == "plane"):
            height = wp.dot(bounds.plane_normal, p - bounds.plane_point)
            slope = wp.dot(bounds.plane_normal, d)
            stop_distance = none
            if height != none:
                has_stop = bool(height * slope < none and wp.abs(slope) > wp.float64(LEAST_SLOPE))
                if has_stop:
                    stop_distance = -height / slope
            if height > none:
                side = real(-1.0)
        if wp.static(stop == "arc"):
            stop_distance = bounds.length
        if meets and has_stop and wp.static(stop != "none"):
            meets = stop_distance > enter
        if wp.static(stop == "none"):
            if meets and span[1] > wp.float64(1.0e299):
                status = int(not_reached)  # along x in a planar field, which has no end there

        # A ray that starts inside the body begins where it leaves the body. If the body extends beyond the box, a ray
        # may hit the body before it reaches the box.
        normal = wp.vec3d(none, none, none)
        if wp.static(has_body):
            if meets:
                exit = wall.body_exit(field, p, d, enter)
                leaves = exit.exit
                hits = wall.body_entry(field, p, d, enter)
                if hits < wp.float64(NEVER):
                    status = int(hit_body)
                    enter = hits
                elif has_stop and wp.static(stop != "none") and stop_distance <= wp.min(leaves, span[1]):
                    meets = bool(False)
                elif (leaves > enter and leaves >= wp.float64(1.0 - ENTRY_ROUNDING) * span[1]) or leaves >= wp.float64(
                    NEVER
                ):
                    status = int(inside_body)  # it comes out where the box ends, if at all
                else:
                    enter = leaves
                    if exit.odd:
                        normal = wall.outward_normal(field, exit.piece, p + leaves * d)

        t_exit = span[1]
        if has_stop and wp.static(stop != "none"):
            t_exit = wp.min(t_exit, stop_distance)

        interval = Interval()
        interval.t_enter = enter
        interval.t_exit = t_exit
        interval.stop_distance = stop_distance
        interval.has_stop = has_stop
        interval.meets = meets
        interval.normal = normal
        interval.side = side
        return status, interval

    @wp.func
    def surface_of(bounds: Bounds, interval: Interval, p: wp.vec3d, d: wp.vec3d):
        """Number of the surface on which the undisturbed ray ends."""
        nearest = box.nearest_face(bounds, p + interval.t_exit * d)
        if wp.static(stop == "plane"):
            if interval.has_stop and interval.t_exit == interval.stop_distance:
                nearest = faces
        return nearest

    @wp.func
    def obliquity_of(bounds: Bounds, interval: Interval, p: wp.vec3d, d: wp.vec3d):
        """Shift of the stop along d per sideways shift of the ray.

        This is the tangent of the angle of incidence on the stop, at most the tangent that STEEPEST_COSINE allows.
        """
        obliquity = real(0.0)
        if wp.static(stop != "arc"):
            if interval.has_stop:
                normal = bounds.plane_normal
                if wp.static(stop == "none"):
                    miss = box.surface_distance(bounds, surface_of(bounds, interval, p, d), p + interval.t_exit * d)
                    normal = wp.vec3d(miss[1], miss[2], miss[3])
                cosine = wp.dot(normal, d)
                obliquity = real(wp.length(normal - cosine * d) / wp.max(wp.abs(cosine), wp.float64(STEEPEST_COSINE)))
        return obliquity

    @wp.func
    def stop_geometry_of(bounds: Bounds, control: Control, interval: Interval, p: wp.vec3d, d: wp.vec3d):
        """StopGeometry."""
        reach = control.extent  # along x a planar box has no end
        if interval.t_exit - interval.t_enter < wp.float64(1.0e30):
            reach = real(interval.t_exit - interval.t_enter)
        obliquity = real(0.0)
        if wp.static(method in ("adaptive", "straight")):
            obliquity = obliquity_of(bounds, interval, p, d)
        beyond = real(0.0)
        resolution = real(direction_noise)
        if wp.static(stop == "plane"):
            cosine = wp.max(wp.abs(wp.dot(bounds.plane_normal, d)), wp.float64(LEAST_SLOPE))
            resolution += real(wp.float64(INCIDENCE_NOISE) / cosine)
            beyond = real(wp.max(interval.stop_distance - interval.t_exit, wp.float64(0.0)))
        derating = real(1.0)
        if beyond > real(0.0):
            square = wp.sqrt(real(1.0) + real(0.25) * obliquity * beyond * wp.max(control.cell_rate))
            derating = real(1.0) / wp.sqrt(square)
        return StopGeometry(obliquity, reach + beyond, reach, derating, resolution)

    @wp.func
    def end_of(
        bounds: Bounds,
        control: Control,
        p: wp.vec3d,
        d: wp.vec3d,
        interval: Interval,
        status: int,
        ends_on: int,
        q: vec3,
        q_carry: vec3,
        momentum: vec3,
        sums: vec4,
        sums_carry: vec4,
        max_deflection: real,
    ):
        """Arrival, the ray at its stop.

        It adds the sums of the steps, (sigma, S, M, B), to the straight ray and flies on to a stop outside the box. p
        and d are the ray's start and direction, `interval` and `status` are those of `build_start`. `ends_on` is the
        number of the surface on which the ray ended, or -1. `max_deflection` is the greatest angle between the ray and
        d.
        """
        ambient = bounds.ambient
        none = wp.float64(0.0)
        status = int(status)
        q64 = wp.vec3d(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2])) - wp.vec3d(
            wp.float64(q_carry[0]), wp.float64(q_carry[1]), wp.float64(q_carry[2])
        )
        p64 = wp.vec3d(wp.float64(momentum[0]), wp.float64(momentum[1]), wp.float64(momentum[2]))
        sigma = wp.float64(sums[0]) - wp.float64(sums_carry[0])
        work = wp.float64(2.0) * (wp.float64(sums[1]) - wp.float64(sums_carry[1]))
        stretch = wp.float64(sums[2]) - wp.float64(sums_carry[2])
        if wp.static(consistent_gradient) and max_deflection <= real(NEARLY_STRAIGHT):
            # Along d the deviation is int (T . d - a) d sigma = M - B: sums of the same values as the path (motion.py).
            lagging = wp.float64(sums[3]) - wp.float64(sums_carry[3])
            q64 += (stretch - lagging - wp.dot(q64, d)) * d
        tangent_change = deflection(ambient, d, p64)
        heading = d + tangent_change
        along = interval.t_enter + ambient * sigma  # distance along the straight ray
        grazing = wp.vec2d(none, wp.float64(1.0))
        if ends_on >= 0 and ends_on < wp.static(ARC_SURFACE):
            along = box.meeting(bounds, ends_on, p + q64, d, along)
            rest = box.grazing_correction(bounds, control, ends_on, p + along * d + q64, d, heading)
            along += rest[0]
            q64 += rest[0] * tangent_change
            grazing = wp.vec2d(rest[1], rest[2])
        stop_distance = interval.stop_distance
        if not interval.meets:
            along = none
            if wp.static(stop == "none"):
                status = int(missed_field)
                stop_distance = none

        flight = none
        if status == ok:
            if wp.static(stop == "plane"):
                if not interval.meets or (ends_on >= 0 and ends_on != faces):
                    here = p + along * d + q64
                    height = wp.dot(bounds.plane_normal, here - bounds.plane_point)
                    slope = wp.dot(bounds.plane_normal, heading)
                    # If the plane is on a face of the box, rounding may put the ray behind the plane.
                    face_tolerance = wp.float64(1.0e-3) / wp.float64(wp.max(control.cell_rate))
                    # The undisturbed ray of a parallel ray never meets the plane: there is no path to compare with.
                    least = wp.min(wp.abs(slope), wp.abs(wp.dot(bounds.plane_normal, d)))
                    toward = height * slope < none and least > wp.float64(LEAST_SLOPE)
                    if toward or (interval.meets and wp.abs(height) < face_tolerance * wp.abs(slope)):
                        flight = -height / slope
                    elif height != none:
                        status = int(not_reached)
            elif wp.static(stop == "arc"):
                flight = bounds.length - (along + stretch)
        deviation = q64 + flight * tangent_change
        along += flight

        opd = wp.float64(0.0)
        if status == ok and interval.has_stop and wp.static(stop != "arc"):
            # How much further along d than the undisturbed ray the ray meets the stop: computed from the deviation
            # where that is exact, because the difference of two distances would lose its last digits.
            further = along - stop_distance
            if wp.static(stop == "plane"):
                descent = wp.dot(bounds.plane_normal, d)
                if wp.abs(descent) > wp.float64(LEAST_COSINE):
                    further = -wp.dot(bounds.plane_normal, deviation) / descent
            elif ends_on >= 0:
                further = box.detour(bounds, ends_on, p, d, deviation, stop_distance, further)
            opd = work + ambient * further
        else:
            opd = work - ambient * stretch

        arrival = Arrival()
        arrival.position = p + along * d + deviation
        arrival.direction = heading / wp.length(heading)
        arrival.optical_path = wp.max(ambient * along + work, none)
        arrival.opd = opd
        arrival.arc_length = wp.max(along + stretch, none)  # rounding may make it negative if a ray leaves at its start
        arrival.flight = flight
        arrival.grazing = grazing
        arrival.status = status
        return arrival

    return SimpleNamespace(**locals())
