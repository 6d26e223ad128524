"""Device functions that end a ray on a face of its box, on a plane, or at an arc length.

The step is shortened to where its parabola first meets a surface, by the root of the quadratic. The rest, of third
order in the step, is flown along the parabola at the step's end. A ray that grazes a surface may be close to it and
still far from the place where it meets it: the rest must be short compared with the step, or as small as rounding
errors.
"""

from types import SimpleNamespace

import warp as wp

from ....scheme import (
    ARC_SURFACE,
    EVENT_LOCATION_NOISE,
    EVENT_LOCATION_SHARE,
    LEAST_COSINE,
    LEAST_RISE,
    SURFACE_TOLERANCE,
    TOLERANCE_COUNTED,
)
from ....tableau import BT
from ..library import Scene, built_once
from .box import FACE_COUNT, FLAT_AXES, build_box
from .motion import build_motion


@built_once("geometry", "stop")
def build_event_location(scene: Scene):
    """Build the functions about the surfaces and the arc length on which a ray can end."""
    geometry, stop = scene.geometry, scene.stop
    t = scene.types
    real, vec3, vec4, Control = t.real, t.vec3, t.vec4, t.Control
    box = build_box(scene)
    face_count = wp.constant(FACE_COUNT[geometry])
    surface_count = wp.constant(FACE_COUNT[geometry] + (1 if stop == "plane" else 0))
    single = scene.precision == "float32"
    surface_tolerance = SURFACE_TOLERANCE[scene.precision]
    event_location_noise = EVENT_LOCATION_NOISE[scene.precision]
    least_rise = LEAST_RISE[scene.precision]
    flat_count = wp.constant(2 * FLAT_AXES[geometry])
    clear_by = max(surface_tolerance, event_location_noise)
    most_behind = 2.5 * EVENT_LOCATION_SHARE  # a product inside a kernel would be computed in float32
    none = 1e30
    motion = build_motion(scene)
    arc_surface = wp.constant(ARC_SURFACE)
    v1, v2, v3, v4 = (float(b) for b in BT)

    @wp.func
    def oriented(control: Control, k: int, side: real, cell: wp.vec3i, frac: vec3):
        """As `surface`, with the plane's normal turned away from the ray's start."""
        s = box.surface(control, k, cell, frac)
        if k == face_count:
            s = side * s
        return s

    @wp.func
    def surface_unit(control: Control, k: int):
        """Size of a cell in the unit of surface k: distances to faces are in cells, to the plane in metres."""
        if k == face_count:
            return real(1.0) / wp.max(control.cell_rate)
        return real(1.0)

    @wp.func
    def rising_root(v0: real, v1: real, v2: real):
        """The first positive h at which v0 + v1 h + v2 h^2 rises through zero; 0 if it is positive and stays so."""
        disc = v1 * v1 - real(4.0) * v2 * v0
        if v0 > real(0.0):
            if v1 >= real(0.0) or disc < real(0.0):
                return real(0.0)
        elif disc < real(0.0):
            return real(none)
        root = wp.sqrt(disc)
        if v1 >= real(0.0):
            if v1 + root <= real(0.0):
                return real(none)
            return real(-2.0) * v0 / (v1 + root)
        if v2 <= real(0.0):
            return real(none)
        return (root - v1) / (real(2.0) * v2)

    @wp.func
    def half_curve(control: Control, k: int, normal: vec3, along: vec3, bend: vec3):
        """Half the second derivative, by the step, of a ray's distance outside surface k, whose normal is given."""
        curve = wp.dot(normal, bend)
        if wp.static(geometry == "axisymmetric"):
            if k == 2:
                curve += (along[0] * along[0] + along[1] * along[1]) / control.radius
        return real(0.5) * curve

    @wp.func
    def grazes(control: Control, k: int, outside: real, rise: real, along: vec3):
        """Whether a ray that rises with `rise` is in surface k or outside it and runs almost parallel to it."""
        grazing = real(1.0e-4) * wp.length(along) * surface_unit(control, k)
        return rise >= real(0.0) and rise <= grazing and outside >= -real(surface_tolerance) * surface_unit(control, k)

    @wp.func
    def stays_within_noise(outside: real, rise: real, curved: real, h: real):
        """Whether rounding decides on which side of a face a step of length h begins and ends; never in float64.

        In float64, SURFACE_TOLERANCE decides.
        """
        within = bool(False)
        if wp.static(single):
            there = outside + (rise + curved * h) * h
            within = wp.max(wp.abs(outside), wp.abs(there)) <= real(event_location_noise)
        return within

    @wp.func
    def outside_flat_faces(control: Control, cell: wp.vec3i, frac: vec3):
        """Distance of a place outside the flat faces along each axis [cells]."""
        whole = vec3(real(cell[0]), real(cell[1]), real(cell[2]))
        outside = wp.max((control.face_low - whole) - frac, (whole - control.face_high) + frac)
        for axis in range(wp.static(3 - FLAT_AXES[geometry])):
            outside[axis] = real(-none)
        return outside

    @wp.func
    def clears_flat_faces(control: Control, cell: wp.vec3i, frac: vec3, along: vec3, bend: vec3, h: real):
        """Whether a step of length h, whatever its direction, stays farther from every flat face than rounding errors.

        Then none of the checks of single faces below can be true, rounding errors included.
        """
        rising = wp.abs(along) + (real(0.5) * wp.abs(bend)) * h
        farthest = wp.max(outside_flat_faces(control, cell, frac) + rising * h)
        return farthest < real(-clear_by)

    @wp.func
    def is_out_of_reach(control: Control, k: int):
        """Whether surface k is a plane that no ray in the box can meet."""
        return k == face_count and control.plane_in_box == 0

    @wp.func
    def event_location(
        control: Control, rate: vec3, side: real, cell: wp.vec3i, frac: vec3, momentum: vec3, force: vec3, h: real
    ):
        """The step, at most h, that ends where the parabola first meets a surface; that surface or -1; whether it runs.

        A ray runs in a face if it is so near the face that rounding decides on which side it is.
        """
        best = h
        which = int(-1)
        runs = bool(False)
        along = wp.cw_mul(momentum, rate)
        bend = wp.cw_mul(force, rate)
        is_clear = clears_flat_faces(control, cell, frac, along, bend, h)
        for k in range(surface_count):
            passed_by = is_out_of_reach(control, k)
            if k < flat_count:
                passed_by = is_clear
            if not passed_by:
                s = oriented(control, k, side, cell, frac)
                normal = vec3(s[1], s[2], s[3])
                curved = half_curve(control, k, normal, along, bend)
                rise = wp.dot(normal, along)
                # Rounding must not end a ray that runs in a face.
                tolerance = real(surface_tolerance) * surface_unit(control, k)
                outside = s[0]
                if grazes(control, k, outside, rise, along):
                    outside -= tolerance
                    runs = runs or k < face_count
                if k < face_count:
                    runs = runs or stays_within_noise(outside, rise, curved, best)
                # Most surfaces are out of reach: skip the root.
                rising = wp.max(rise, real(0.0)) + wp.max(curved, real(0.0)) * best
                if outside + rising * best >= real(0.0):
                    root = rising_root(outside, rise, curved)
                    if root <= best:
                        best = root
                        which = k
        return best, which, runs

    @wp.func
    def time_beyond_face(
        control: Control, rate: vec3, side: real, cell: wp.vec3i, frac: vec3, momentum: vec3, force: vec3, h: real
    ):
        """How much of a step of length h may be behind a face in which the ray runs. Few rays need this."""
        first = h
        along = wp.cw_mul(momentum, rate)
        bend = wp.cw_mul(force, rate)
        for k in range(face_count):
            s = oriented(control, k, side, cell, frac)
            normal = vec3(s[1], s[2], s[3])
            curved = half_curve(control, k, normal, along, bend)
            rise = wp.dot(normal, along)
            outside = s[0]
            if grazes(control, k, outside, rise, along):
                first = wp.min(
                    first, rising_root(outside - real(TOLERANCE_COUNTED) * real(surface_tolerance), rise, curved)
                )
                outside -= real(surface_tolerance)
            if stays_within_noise(outside, rise, curved, h):
                first = real(0.0)
        return wp.max(h - first, real(0.0))

    @wp.func
    def leaves_by_rounding(
        control: Control, event: int, rate: vec3, side: real, cell: wp.vec3i, frac: vec3, momentum: vec3
    ):
        """Whether a ray that leaves by face `event` rises so little that rounding alone decides where, or whether."""
        if event < 0 or event >= face_count:
            return bool(False)
        s = oriented(control, event, side, cell, frac)
        velocity = wp.cw_mul(momentum, rate)
        rise = wp.dot(vec3(s[1], s[2], s[3]), velocity)
        return s[0] >= real(-event_location_noise) and wp.abs(rise) < real(least_rise) * wp.length(velocity)

    @wp.func
    def rounding_of(control: Control, k: int):
        """Rounding error of a place's distance from surface k, in the unit of the surface."""
        allowance = real(event_location_noise) * surface_unit(control, k)
        if k == face_count:
            allowance += real(event_location_noise) * wp.abs(control.plane_offset)
        if wp.static(geometry == "axisymmetric"):
            if k == 2:
                allowance *= real(1.0) + control.radius
        return wp.min(allowance, real(1.0e-5) * surface_unit(control, k))

    @wp.func
    def overshoots(
        control: Control, k: int, side: real, cell: wp.vec3i, frac: vec3, velocity: vec3, h: real, close: real
    ):
        """Whether a step of length h ends further behind surface k than `close` cells, or than a share of the step."""
        ahead = oriented(control, k, side, cell, frac)
        speed = wp.max(wp.dot(vec3(ahead[1], ahead[2], ahead[3]), velocity), real(0.0))
        # A ray that runs in a face ends its step by the tolerance behind it.
        least = rounding_of(control, k) + real(surface_tolerance) * surface_unit(control, k)
        is_far = ahead[0] > wp.max(real(most_behind) * speed * h, least)
        return is_far or ahead[0] > close * surface_unit(control, k)

    @wp.func
    def passed_surface(control: Control, side: real, cell: wp.vec3i, frac: vec3, event: int):
        """Whether a place is behind a surface other than `event` by more than rounding; distance to the next face."""
        is_behind = bool(False)
        nearest = real(none)
        farthest = wp.max(outside_flat_faces(control, cell, frac))
        is_inside = farthest < real(0.0)
        if is_inside:
            nearest = -farthest
        for k in range(surface_count):
            passed_by = is_out_of_reach(control, k)
            if k < flat_count:
                passed_by = is_inside
            if not passed_by:
                allowance = rounding_of(control, k) + real(2.0) * real(surface_tolerance) * surface_unit(control, k)
                outside = oriented(control, k, side, cell, frac)[0]
                is_behind = is_behind or (outside > allowance and k != event)
                if k < face_count:
                    nearest = wp.min(nearest, wp.abs(outside))
        return is_behind, nearest

    @wp.func
    def face_margin(control: Control, displacement: real):
        """Distance from a face within which a ray counts as in it [cells]; the ray may be shifted by `displacement`."""
        return (
            real(event_location_noise) + real(2.0) * real(surface_tolerance) + displacement * wp.max(control.cell_rate)
        )

    @wp.func
    def in_face(control: Control, side: real, cell: wp.vec3i, frac: vec3, velocity: vec3, allowance: real):
        """Whether a ray runs along a face within `allowance` cells, so that its error may put it on the other side.

        A ray that crosses the face does not count: its error only shifts the crossing a little. Neither does a ray that
        stays exactly in the face: it is on no side.
        """
        is_in = bool(False)
        for k in range(face_count):
            s = oriented(control, k, side, cell, frac)
            near = wp.abs(s[0])
            rise = wp.abs(wp.dot(vec3(s[1], s[2], s[3]), velocity))
            runs = rise <= real(LEAST_COSINE) * wp.length(velocity)
            is_in = is_in or (runs and near <= allowance and near > real(TOLERANCE_COUNTED) * real(surface_tolerance))
        return is_in

    @wp.func
    def surface_intersection(
        control: Control,
        k: int,
        side: real,
        cell: wp.vec3i,
        frac: vec3,
        velocity: vec3,
        acceleration: vec3,
        h: real,
        h_cell: real,
    ):
        """After a step to surface k: (sigma still to go along the parabola, negative to go back; whether the ray ends).

        The velocity and its derivative are in cells. A ray that is neither behind the surface nor close to it takes
        another step toward it.
        """
        now = oriented(control, k, side, cell, frac)
        speed = wp.dot(vec3(now[1], now[2], now[3]), velocity)
        # Behind the surface, or close enough to fly the rest along the parabola.
        unit = surface_unit(control, k)
        if speed > real(0.0) and now[0] >= real(-EVENT_LOCATION_SHARE) * speed * h - rounding_of(control, k):
            curve = wp.dot(vec3(now[1], now[2], now[3]), acceleration)
            root = wp.sqrt(wp.max(speed * speed - real(2.0) * curve * now[0], real(0.0)))
            # A ray that only rounding moves goes back no further than its step.
            back = wp.max(real(-2.0) * now[0] / (speed + root), -h)
            # The rest may cross another surface first.
            there = frac + back * velocity + (real(0.5) * back * back) * acceleration
            behind, _ = passed_surface(control, side, cell, there, k)
            if back > real(0.0) and behind:
                return real(0.0), bool(False)
            return back, bool(True)
        # Outside, and coming back or not moving relative to the surface.
        return real(0.0), bool(h <= real(1.0e-9) * h_cell or now[0] > real(1.0e-3) * unit)

    @wp.func
    def arc_event_location(rest: real, index: real, total: vec3, force: vec3, h: real, event: int):
        """The step over `rest` of arc, if it is no longer than h; the index changes along it."""
        bend = wp.dot(force, total) / index
        if h * (index + real(0.5) * bend * h) >= rest:
            h_arc = wp.min(rest / index, h)
            return wp.clamp(rest / (index + real(0.5) * bend * h_arc), real(0.0), h), int(arc_surface)
        return h, int(event)

    @wp.func
    def passes_arc(rest: real, ambient: real, pot: real, s2: vec4, s3: vec4, s4: vec4, h: real):
        """Whether a step of length h with `rest` of arc before it ends further behind the arc than a share of it."""
        m = real(v1) * motion.contrast(ambient, pot) + real(v2) * motion.contrast(ambient, s2[0])
        m += real(v3) * motion.contrast(ambient, s3[0]) + real(v4) * motion.contrast(ambient, s4[0])
        return h * (ambient + m) - rest > real(most_behind) * ambient * h

    @wp.func
    def arc_surface_intersection(rest: real, index: real, total: vec3, force: vec3, arc_left: real, h: real):
        """After a step to the arc length: (sigma to go along the parabola, negative to go back; whether it ends)."""
        if rest <= real(1.0e-4) * h * index + real(1.0e-6) * arc_left:
            root = wp.sqrt(wp.max(index * index + real(2.0) * wp.dot(force, total) / index * rest, real(0.0)))
            return wp.max(real(2.0) * rest / (index + root), -h), bool(True)
        return real(0.0), bool(False)

    return SimpleNamespace(**locals())
