"""Device functions: the error of a step, as optical path, and what of it may be rounding.

A step's error is the embedded formula's in S, in position and in momentum, the latter two weighted by how much they can
matter further on. On a nearly straight ray the error of S is known better, from a rule of degree 7 that also uses the
slopes along the ray.
"""

import warp as wp

from ....scheme import (
    DIRECTION_NOISE,
    DIRECTION_SHARE,
    EVENT_LOCATION_NOISE,
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
from ....tableau import (
    B_ERROR,
    BT_ERROR,
    NEARLY_STRAIGHT,
    PATH_ERROR_SLOPE,
    PATH_ERROR_VALUE,
    C,
    has_consistent_gradient,
)
from ..library import KernelLibrary, built_once
from .box import FACE_COUNT
from .motion import build_contrast


@built_once
def build_step_error(library: KernelLibrary, geometry: str, interpolation: str, stop: str):
    """Functions: a step's error, angle, direction weight, displacement; its rounding; errors at faces and at a stop."""
    t = library.types
    real, vec3, vec4, Bounds, Control, StopGeometry = t.real, t.vec3, t.vec4, t.Bounds, t.Control, t.StopGeometry
    contrast = build_contrast(library)
    tiny = TINY[library.precision]
    consistent_gradient = has_consistent_gradient(interpolation)
    sharpened = interpolation in ("cubic", "linear")
    noise = NOISE[library.precision]
    direction_noise = DIRECTION_NOISE[library.precision]
    event_location_noise = EVENT_LOCATION_NOISE[library.precision]
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
    ):
        reach, lever_arm = to_stop.reach, to_stop.lever_arm
        # Where the ray has turned, the obliquity is another one, and the turn counts instead.
        obliquity = to_stop.obliquity * wp.max(real(1.0) - max_deflection / real(OBLIQUITY_KEPT), real(0.0))
        force2 = vec3(s2[1], s2[2], s2[3])
        force3 = vec3(s3[1], s3[2], s3[3])
        force4 = vec3(s4[1], s4[2], s4[3])
        off_s = h * (real(f1) * pot + real(f2) * s2[0] + real(f3) * s3[0] + real(f4) * s4[0])
        off_q = (h * h) * (real(e1) * force + real(e2) * force2 + real(e3) * force3 + real(e4) * force4)
        off_p = h * (real(f1) * force + real(f2) * force2 + real(f3) * force3 + real(f4) * force4)
        end_momentum = momentum + h * force4
        angle = wp.max(max_deflection, wp.length(end_momentum - wp.dot(end_momentum, d) * d) / ambient)
        error_ratio = real(1.0)
        if wp.static(sharpened):
            # On a nearly straight ray the path's error is known better, by a rule of higher order with the slopes
            # along the ray; the other errors are taken to be overestimated alike.
            slope1 = wp.dot(force, total)
            slope2 = wp.dot(force2, total + (real(0.5) * real(c2) * h) * (force + force2))
            slope3 = wp.dot(force3, total + (real(0.5) * real(c3) * h) * (force + force3))
            slope4 = wp.dot(force4, total + (real(0.5) * h) * (force + force4))
            fine = h * (real(g1) * pot + real(g2) * s2[0] + real(g3) * s3[0] + real(g4) * s4[0])
            fine += (h * h) * (real(k1) * slope1 + real(k2) * slope2 + real(k3) * slope3 + real(k4) * slope4)
            error_ratio = wp.abs(fine) / wp.max(wp.abs(off_s), real(tiny))
            least_ratio = real(LEAST_RATIO)
            if wp.static(interpolation == "linear" and geometry != "axisymmetric") or is_smooth:
                least_ratio = real(LEAST_RATIO_SMOOTH)
            error_ratio = wp.clamp(error_ratio, wp.min(least_ratio + real(RATIO_GROWTH) * angle, real(1.0)), real(1.0))
        off = real(4.0) * error_ratio * wp.abs(off_s)
        if wp.static(not consistent_gradient) or angle > real(NEARLY_STRAIGHT):
            # Along d, and in arc length.
            off_m = real(f1) * contrast(ambient, pot) + real(f2) * contrast(ambient, s2[0])
            off_m += real(f3) * contrast(ambient, s3[0]) + real(f4) * contrast(ambient, s4[0])
            off += ambient * (wp.abs(wp.dot(off_q, d)) + h * wp.abs(off_m))
        off_q -= wp.dot(off_q, d) * d
        off_p -= wp.dot(off_p, d) * d
        weight = angle + error_ratio * real(DIRECTION_SHARE)
        # The ray meets its stop at an angle (engines/warp/kernels/ends.py), `lever_arm` further on.
        tilt = error_ratio * obliquity
        if wp.static(interpolation == "linear"):
            tilt = wp.max(error_ratio, real(LEAST_RATIO)) * obliquity
        if lever_arm > real(2.0) * reach:
            # At far stops the ray's own deflection adds to the obliquity, and the error of a direction is not believed
            # to be overestimated as much as that of the path: it is no sum along the ray.
            tilt = wp.max(error_ratio, real(LEAST_RATIO)) * (
                obliquity + wp.where(angle < real(LEAPFROG_ANGLE), angle, real(0.0))
            )
        off_p_size = wp.length(real(MAGNIFIED) * off_p) / real(MAGNIFIED)
        off_q_size = wp.length(real(MAGNIFIED) * off_q) / real(MAGNIFIED)
        off += off_p_size * (weight * reach + tilt * lever_arm) + ambient * off_q_size * (weight + tilt)
        direction_weight = weight * (reach + ambient * h) + obliquity * (lever_arm + ambient * h)
        step_displacement = wp.max(error_ratio, real(LEAST_RATIO)) * (off_q_size + reach * off_p_size / ambient)
        return vec4(off, angle, direction_weight, step_displacement)

    @wp.func
    def step_rounding(
        control: Control,
        ambient: real,
        h: real,
        direction_weight: real,
        rate: vec3,
        frac: vec3,
        pot: real,
        force: vec3,
        s3: vec4,
    ):
        size = wp.max(wp.abs(pot), wp.abs(s3[0]))
        if wp.static(geometry == "axisymmetric"):
            # Places across the axis are kept from the axis on, and rounded like their distance from it.
            size += wp.length(force) * wp.length(vec3(frac[0], frac[1], real(0.0))) / rate[0]
        steep = wp.max(wp.length(force), size * wp.max(control.cell_rate))
        return real(noise) * h * (real(2.0) * size + steep * direction_weight)

    @wp.func
    def possible_gain(ambient: real, to_stop: StopGeometry, angle: real, pot: real, force: vec3, s3: vec4):
        """What a ray may gain behind a face per length of its step.

        Without another stop the face may be where it ends.
        """
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
        momentum: vec3,
        first_momentum: real,
        max_deflection: real,
        to_stop: StopGeometry,
        displacement: real,
    ):
        """The error of a ray at its stop: that of its steps, and the rounding of the direction in which it flies there.

        Rounded are its greatest momentum, what it had at first, along d, and the slopes between nodes. A plane may be
        met at a smaller angle than the obliquity allows for. A ray that is turned later on meets a far stop at that
        angle with the errors of direction of its first steps, too: `displacement`, beside its place, grows beyond.
        """
        size = wp.length(momentum) + first_momentum + ambient * max_deflection
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
        """The error of a ray that ended on surface `ends_on`, with what it lacks of it and at which cosine.

        A ray may end at a smaller angle, or on another surface, than the undisturbed one, for which `obliquity` is.
        Where the ray flies on from the surface, each metre beside its place changes the path by `opd_rate`. Its place
        across the surface is off by a share of a `cell` [m] for rounding and by `displacement` for its steps; along
        the ray by that over the cosine.
        """
        lack = real(wp.min(grazing[0], wp.float64(1.0e30)))
        cosine = real(wp.max(grazing[1], wp.float64(1.0e-15)))
        rounded = real(event_location_noise) * cell / cosine
        if wp.static(stop == "none"):
            if cosine < real(LEAST_COSINE):
                lack += rounded
            return wp.max(used * wp.max(real(1.0) / (cosine * (real(1.0) + obliquity)), real(1.0)), ambient * lack)
        if ends_on == plane:
            return wp.max(used, ambient * lack)
        if cosine < real(LEAST_COSINE):
            rounded += displacement / cosine
        return used + opd_rate * (lack + rounded)

    return step_error, step_rounding, possible_gain, stop_error, event_location_error
