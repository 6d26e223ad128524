"""Device functions of a step of the tracer: how long it is up to a face, the field at its stages, whether it counts."""

import functools

import warp as wp

from ....scheme import AT_FACE, FACE_TOLERANCE, GREATEST_STAND_OFF, NOISE_STEP, STEP_SHARE
from ..types import types
from .step_bound import build_to_face


@functools.cache
def build_before_face(precision: str, geometry: str, interpolation: str):
    """Functions: the step to short of the next face, and by how much short; what is left to that face."""
    t = types(precision)
    real, vec3 = t.real, t.vec3
    to_face = build_to_face(precision, geometry)
    linear = interpolation == "linear"
    at_face = AT_FACE[precision]

    @wp.func
    def before_face(cell: wp.vec3i, frac: vec3, rate: vec3, total: vec3, force: vec3):
        """On a linear grid the rest is flown along the tangent; elsewhere a face that near counts as reached."""
        pace = wp.cw_mul(total, rate)
        pull = wp.cw_mul(force, rate)
        stand_off = real(0.1 * FACE_TOLERANCE)
        close = real(10.0) * stand_off
        if wp.static(linear):
            # How far before a face to stop: a share of the bend over a cell, whose change over the step the parabola
            # does not know.
            bend = real(0.15) * wp.length(pull) / wp.dot(pace, pace)
            stand_off = real(0.1 * FACE_TOLERANCE) + wp.min(bend, real(GREATEST_STAND_OFF))
            close = real(at_face)
        face = to_face(cell, frac, pace, pull, close)
        return wp.max(face - stand_off / wp.length(pace), real(0.5) * face), stand_off

    @wp.func
    def rest_to_face(cell: wp.vec3i, frac: vec3, pace: vec3, pull: vec3, stand_off: real, h: real):
        """What is left to the face before which a step of length h stopped, `stand_off` cells; 0 if elsewhere."""
        rest = to_face(cell, frac, pace, pull, real(0.0))
        if rest <= h and rest * wp.length(pace) <= real(4.0) * stand_off:
            return rest
        return real(0.0)

    return before_face, rest_to_face


def build_sample_at_stage(precision: str, sample, straight: bool):
    """A function that looks the field up at a stage of a step."""
    t = types(precision)
    real, vec3, Field = t.real, t.vec3, t.Field

    @wp.func
    def sample_at_stage(
        field: Field,
        current_cell: int,
        cell: wp.vec3i,
        frac: vec3,
        rate: vec3,
        h: real,
        total: vec3,
        momentum: vec3,
        q: vec3,
        kick: vec3,
    ):
        """The field at a stage; on a straight line the contrast beside it is first order in the deviation."""
        if wp.static(straight):
            s = sample(field, cell, frac + h * wp.cw_mul(total, rate), current_cell)
            s[0] += wp.dot(vec3(s[1], s[2], s[3]), q + h * momentum + kick)
            return s
        else:
            return sample(field, cell, frac + wp.cw_mul(h * total + kick, rate), current_cell)

    return sample_at_stage


@functools.cache
def build_step_acceptance(precision: str):
    """A function of a step's error and its rounding -> (whether the step counts, how many times longer to go on)."""
    t = types(precision)
    real, Control = t.real, t.Control

    @wp.func
    def step_acceptance(
        control: Control,
        off: real,
        rounding: real,
        used: real,
        h: real,
        h_cell: real,
        h_least: real,
        index: real,
        reach: real,
    ):
        left = wp.max(control.tolerance - used, real(0.0))
        allowed = wp.max(real(STEP_SHARE) * left, control.tolerance * h * index / reach)
        if h <= real(NOISE_STEP) * h_cell:
            allowed = wp.max(allowed, rounding)
        ratio = real(4.0)
        if off > real(0.0):
            ratio = wp.clamp(real(0.9) * wp.pow(allowed / off, real(0.25)), real(0.2), real(4.0))
        return bool((off <= allowed and wp.isfinite(off)) or h <= h_least), ratio

    return step_acceptance
