"""Device functions: the error of a step and of a ray, as optical path, and the share that may be rounding.

The error of a step is that of the embedded formula in S, in position and in momentum; the latter two are weighted by
their effect further along the ray. On a nearly straight ray a quadrature of degree 7 that also uses the slopes along
the ray gives a sharper error of S.
"""

from types import SimpleNamespace

import warp as wp

from .....medium.mesh_samples import MESH_INTERPOLATIONS
from ....scheme import (
    BEND_SPREAD,
    DIRECTION_NOISE,
    DIRECTION_SHARE,
    EVENT_LOCATION_NOISE,
    KINK_PATH,
    KINK_SHARE,
    LEAPFROG_ANGLE,
    LEAST_COSINE,
    LEAST_RATIO,
    LEAST_RATIO_SMOOTH,
    MAGNIFIED,
    NOISE,
    OBLIQUITY_KEPT,
    RATIO_GROWTH,
    SLOPE_NOISE,
    STEEPEST_COSINE,
    TINY,
)
from ....stop import RayStatus
from ....tableau import (
    B_ERROR,
    BT_ERROR,
    NEARLY_STRAIGHT,
    PATH_ERROR_SLOPE,
    PATH_ERROR_VALUE,
    C,
    has_consistent_gradient,
)
from ..library import Scene, built_once
from .box import FACE_COUNT
from .motion import build_motion


@built_once()
def build_bends(scene: Scene):
    """Build the functions of errors by kinks of a mesh, and of what becomes of a ray by its error."""
    t = scene.types
    real, vec2, vec3, Bends, StopGeometry = t.real, t.vec2, t.vec3, t.Bends, t.StopGeometry
    ok, tolerance_not_met, max_steps = int(RayStatus.OK), int(RayStatus.TOLERANCE_NOT_MET), int(RayStatus.MAX_STEPS)

    @wp.func
    def bend_arm(to_stop: StopGeometry, max_deflection: real):
        """Weight of an error of the direction of a ray on a mesh [m], as in step_error."""
        obliquity = to_stop.obliquity * wp.max(real(1.0) - max_deflection / real(OBLIQUITY_KEPT), real(0.0))
        if to_stop.lever_arm > real(2.0) * to_stop.reach and max_deflection < real(LEAPFROG_ANGLE):
            obliquity += max_deflection
        return (max_deflection + real(DIRECTION_SHARE)) * to_stop.reach + obliquity * to_stop.lever_arm

    @wp.func
    def bend_share(part: real):
        """Share of the tolerance for the error of a step by kinks, if smooth errors may have the share `part`."""
        return wp.sqrt(part) / real(BEND_SPREAD + 2.0)

    @wp.func
    def with_bend(bends: Bends, bend: vec3, size: real):
        """The errors by kinks with that of another step, of a size [m]."""
        out = Bends()
        out.x = bends.x + bend[0]
        out.y = bends.y + bend[1]
        out.z = bends.z + bend[2]
        whole = vec3(out.x, out.y, out.z)
        out.greatest = wp.max(bends.greatest, wp.length(real(MAGNIFIED) * whole) / real(MAGNIFIED))
        out.root = wp.length(real(MAGNIFIED) * vec2(bends.root, size)) / real(MAGNIFIED)
        out.sizes = bends.sizes + size
        return out

    @wp.func
    def bend_error(bends: Bends):
        """Error of a ray by the kinks that its steps crossed [m]."""
        return wp.min(bends.sizes, bends.greatest + real(BEND_SPREAD) * bends.root)

    @wp.func
    def judged_status(status: int, tolerance: real, used: real):
        """Status of a ray, by its error `used`: TOLERANCE_NOT_MET where it is to be traced again, see launch.py.

        So is a ray whose steps float32 exhausted, with an infinite error: rounding may have kept them short, or refused
        them, so that float64 decides.
        """
        judged, error = status, used
        if wp.static(scene.precision == "float32"):
            if status == max_steps and wp.isfinite(used):
                judged, error = int(tolerance_not_met), real(wp.inf)
        if status == ok and not (used <= tolerance):
            judged = int(tolerance_not_met)
        return judged, error

    return SimpleNamespace(**locals())


@built_once("geometry", "interpolation", "stop")
def build_error(scene: Scene):
    """Build the functions of errors."""
    geometry, interpolation, stop = scene.geometry, scene.interpolation, scene.stop
    t = scene.types
    real, vec3, vec4, Bounds, Control, StopGeometry = t.real, t.vec3, t.vec4, t.Bounds, t.Control, t.StopGeometry
    motion = build_motion(scene)
    tiny = TINY[scene.precision]
    consistent_gradient = has_consistent_gradient(interpolation)
    sharpened = interpolation in ("cubic", "linear")
    on_mesh = interpolation in MESH_INTERPOLATIONS
    noise = NOISE[scene.precision]
    direction_noise = DIRECTION_NOISE[scene.precision]
    event_location_noise = EVENT_LOCATION_NOISE[scene.precision]
    plane = wp.constant(FACE_COUNT[geometry])
    c2, c3 = (float(v) for v in C[1:3])
    e1, e2, e3, e4 = (float(v) for v in B_ERROR)
    f1, f2, f3, f4 = (float(v) for v in BT_ERROR)
    g1, g2, g3, g4 = (float(v) for v in PATH_ERROR_VALUE)
    k1, k2, k3, k4 = (float(v) for v in PATH_ERROR_SLOPE)

    @wp.func
    def step_error(
        ambient: real,
        d: vec3,
        total: vec3,
        momentum: vec3,
        h: real,
        is_smooth: bool,
        max_deflection: real,
        to_stop: StopGeometry,
        pot: real,
        force: vec3,
        s2: vec4,
        s3: vec4,
        s4: vec4,
        kinks: real,
    ):
        """The error [m], the greatest angle with d so far, the weight of a direction, the displacement, and the bend.

        The bend is the error by `kinks` that the step crosses on a mesh, as a vector (see Bends). The weight is
        the length by which an error of the direction is multiplied. The displacement is how far sideways
        the step may put the ray where it leaves the field. The ray meets its stop at an `obliquity` (ends.py),
        `lever_arm` further on.
        """
        reach, lever_arm = to_stop.reach, to_stop.lever_arm
        # After the ray has turned, the initial obliquity does not apply; the angle of the turn counts instead.
        obliquity = to_stop.obliquity * wp.max(real(1.0) - max_deflection / real(OBLIQUITY_KEPT), real(0.0))
        force2 = vec3(s2[1], s2[2], s2[3])
        force3 = vec3(s3[1], s3[2], s3[3])
        force4 = vec3(s4[1], s4[2], s4[3])
        error_s = h * (real(f1) * pot + real(f2) * s2[0] + real(f3) * s3[0] + real(f4) * s4[0])
        error_q = (h * h) * (real(e1) * force + real(e2) * force2 + real(e3) * force3 + real(e4) * force4)
        error_p = h * (real(f1) * force + real(f2) * force2 + real(f3) * force3 + real(f4) * force4)
        end_momentum = momentum + h * force4
        angle = wp.max(max_deflection, wp.length(end_momentum - wp.dot(end_momentum, d) * d) / ambient)
        error_ratio = real(1.0)
        if wp.static(sharpened):
            # On a nearly straight ray a quadrature of higher order with the slopes along the ray gives a sharper error
            # of the path; the other errors are assumed to be overestimated in the same ratio.
            slope1 = wp.dot(force, total)
            slope2 = wp.dot(force2, total + (real(0.5) * real(c2) * h) * (force + force2))
            slope3 = wp.dot(force3, total + (real(0.5) * real(c3) * h) * (force + force3))
            slope4 = wp.dot(force4, total + (real(0.5) * h) * (force + force4))
            fine = h * (real(g1) * pot + real(g2) * s2[0] + real(g3) * s3[0] + real(g4) * s4[0])
            fine += (h * h) * (real(k1) * slope1 + real(k2) * slope2 + real(k3) * slope3 + real(k4) * slope4)
            error_ratio = wp.abs(fine) / wp.max(wp.abs(error_s), real(tiny))
            least_ratio = real(LEAST_RATIO)
            if wp.static(interpolation == "linear" and geometry != "axisymmetric") or is_smooth:
                least_ratio = real(LEAST_RATIO_SMOOTH)
            error_ratio = wp.clamp(error_ratio, wp.min(least_ratio + real(RATIO_GROWTH) * angle, real(1.0)), real(1.0))
        error = real(4.0) * error_ratio * wp.abs(error_s)
        if wp.static(not consistent_gradient) or angle > real(NEARLY_STRAIGHT):
            # The errors along d and in arc length.
            error_m = real(f1) * motion.contrast(ambient, pot) + real(f2) * motion.contrast(ambient, s2[0])
            error_m += real(f3) * motion.contrast(ambient, s3[0]) + real(f4) * motion.contrast(ambient, s4[0])
            error += ambient * (wp.abs(wp.dot(error_q, d)) + h * wp.abs(error_m))
        error_q -= wp.dot(error_q, d) * d
        error_p -= wp.dot(error_p, d) * d
        weight = angle + error_ratio * real(DIRECTION_SHARE)
        tilt = error_ratio * obliquity
        if wp.static(interpolation == "linear"):
            tilt = wp.max(error_ratio, real(LEAST_RATIO)) * obliquity
        if lever_arm > real(2.0) * reach:
            # At far stops the ray's own deflection adds to the obliquity. The error of a direction is assumed to be
            # overestimated less than that of the path, because it is not a sum along the ray.
            tilt = wp.max(error_ratio, real(LEAST_RATIO)) * (
                obliquity + wp.where(angle < real(LEAPFROG_ANGLE), angle, real(0.0))
            )
        error_p_size = wp.length(real(MAGNIFIED) * error_p) / real(MAGNIFIED)
        error_q_size = wp.length(real(MAGNIFIED) * error_q) / real(MAGNIFIED)
        arm = weight * reach + tilt * lever_arm
        bend = vec3(real(0.0), real(0.0), real(0.0))
        by_kinks = bool(False)
        if wp.static(on_mesh):
            by_kinks = kinks > real(0.0)
        if by_kinks:
            bend = arm * error_p + (ambient * (weight + tilt)) * error_q + (real(4.0) * error_s) * d
            size = wp.length(real(MAGNIFIED) * bend) / real(MAGNIFIED)
            least = h * kinks * (real(KINK_SHARE) * arm + real(KINK_PATH) * h * ambient)
            if size < least:
                if size > real(0.0):
                    bend = (least / size) * bend
                else:
                    bend = least * d
            error -= real(4.0) * wp.abs(error_s)
        else:
            error += error_p_size * arm + ambient * error_q_size * (weight + tilt)
        direction_weight = weight * (reach + ambient * h) + obliquity * (lever_arm + ambient * h)
        step_displacement = wp.max(error_ratio, real(LEAST_RATIO)) * (error_q_size + reach * error_p_size / ambient)
        return error, angle, direction_weight, step_displacement, bend

    @wp.func
    def step_rounding(
        control: Control,
        h: real,
        direction_weight: real,
        rate: vec3,
        frac: vec3,
        pot: real,
        force: vec3,
        s3: vec4,
    ):
        """Rounding error of a step [m]."""
        size = wp.max(wp.abs(pot), wp.abs(s3[0]))
        if wp.static(geometry == "axisymmetric"):
            # Coordinates across the axis are measured from the axis, and rounded relative to the distance from it.
            size += wp.length(force) * wp.length(vec3(frac[0], frac[1], real(0.0))) / rate[0]
        steep = wp.max(wp.length(force), size * wp.max(control.cell_rate))
        return real(noise) * h * (real(2.0) * size + steep * direction_weight)

    @wp.func
    def attainable_error(control: Control, ambient: real, to_stop: StopGeometry, angle: real):
        """The error [m] to which steps are controlled: the tolerance, or what rounding of a deflection `angle` makes.

        Far stops that are almost parallel to the ray magnify rounding beyond any tolerance: shorter steps are in vain.
        """
        rounding = to_stop.resolution * ambient * angle * to_stop.obliquity * to_stop.lever_arm
        return wp.max(control.tolerance, rounding)

    @wp.func
    def possible_gain(ambient: real, to_stop: StopGeometry, angle: real, pot: real, force: vec3, s3: vec4):
        """Optical path that a ray may gain behind a face per length of its step; without a stop it may end there."""
        gain = ambient * ambient
        if wp.static(stop != "none"):
            steep = wp.max(wp.length(force), wp.length(vec3(s3[1], s3[2], s3[3])))
            gain = wp.max(wp.abs(pot), wp.abs(s3[0])) + steep * (to_stop.obliquity + angle) * to_stop.lever_arm
        return gain

    @wp.func
    def stop_error(
        used: real,
        bounds: Bounds,
        control: Control,
        direction: wp.vec3d,
        ambient: real,
        greatest_momentum: real,
        max_deflection: real,
        to_stop: StopGeometry,
        displacement: real,
    ):
        """Error of a ray at its stop: the errors of its steps, and the rounding of the direction of its flight there.

        Rounding affects the momentum, whose part along d is the contrast, and the slopes between nodes: differences of
        coefficients as great as the greatest contrast that the ray flew through, however even it is. The ray may meet
        a plane at a smaller angle than the obliquity allows for. If the ray is turned late, the errors of direction of
        its first steps also meet a far stop at that angle: the sideways `displacement` grows beyond the field.
        """
        size = greatest_momentum + ambient * max_deflection
        size *= real(1.0) + real(SLOPE_NOISE) * to_stop.reach * wp.max(control.cell_rate)
        error = used + real(direction_noise) * size * (to_stop.obliquity + max_deflection) * to_stop.lever_arm
        met_at = wp.where(max_deflection < real(LEAPFROG_ANGLE), max_deflection, real(0.0))
        beyond = to_stop.lever_arm - to_stop.reach
        error += ambient * met_at * beyond * (displacement / wp.max(to_stop.reach, real(tiny)))
        if wp.static(stop == "plane"):
            cosine = wp.abs(wp.dot(bounds.plane_normal, direction))
            steepest = wp.float64(STEEPEST_COSINE)
            error *= real(steepest / wp.clamp(cosine, wp.float64(1.0e-9), steepest))
        return error

    @wp.func
    def event_location_error(
        used: real,
        ambient: real,
        cell: real,
        ends_on: int,
        grazing: wp.vec2d,
        obliquity: real,
        opd_rate: real,
        displacement: real,
    ):
        """Error of a ray that ended on surface `ends_on`; `grazing` has the length left to the surface and the cosine.

        `obliquity` is that of the undisturbed ray; the ray may end at a smaller angle, or on another surface. If the
        ray flies on from the surface, a shift of one metre along the ray changes the path by `opd_rate`. Normal to the
        surface, the position is wrong by a share of a `cell` [m] by rounding and by `displacement` from the steps;
        along the ray, by these over the cosine.
        """
        shortfall = real(wp.min(grazing[0], wp.float64(1.0e30)))
        cosine = real(wp.max(grazing[1], wp.float64(1.0e-15)))
        rounded = real(event_location_noise) * cell / cosine
        if wp.static(stop == "none"):
            if cosine < real(LEAST_COSINE):
                shortfall += rounded
            return wp.max(used * wp.max(real(1.0) / (cosine * (real(1.0) + obliquity)), real(1.0)), ambient * shortfall)
        if ends_on == plane:
            return wp.max(used, ambient * shortfall)
        if cosine < real(LEAST_COSINE):
            rounded += displacement / cosine
        return used + opd_rate * (shortfall + rounded)

    return SimpleNamespace(**locals())
