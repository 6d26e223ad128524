"""Device functions of a step of the tracer: how long it is up to a face, the field at its stages, whether it counts."""

import functools

import warp as wp

from ....scheme import AT_FACE, HAIR, NOISE_STEP, SHIEST, STEP_SHARE
from ..types import types
from .reach import build_to_face


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
        shy = real(0.1 * HAIR)
        close = real(10.0) * shy
        if wp.static(linear):
            # How far before a face to stop: a share of the bend over a cell, whose change over the step the parabola
            # does not know.
            bend = real(0.15) * wp.length(pull) / wp.dot(pace, pace)
            shy = real(0.1 * HAIR) + wp.min(bend, real(SHIEST))
            close = real(at_face)
        face = to_face(cell, frac, pace, pull, close)
        return wp.max(face - shy / wp.length(pace), real(0.5) * face), shy

    @wp.func
    def rest_to_face(cell: wp.vec3i, frac: vec3, pace: vec3, pull: vec3, shy: real, h: real):
        """What is left to the face before which a step of length h stopped, `shy` cells; 0 if it stopped elsewhere."""
        rest = to_face(cell, frac, pace, pull, real(0.0))
        if rest <= h and rest * wp.length(pace) <= real(4.0) * shy:
            return rest
        return real(0.0)

    return before_face, rest_to_face


def build_look(precision: str, sample, straight: bool):
    """A function that looks the field up at a stage of a step."""
    t = types(precision)
    real, vec3, Field = t.real, t.vec3, t.Field

    @wp.func
    def look(
        field: Field,
        home: int,
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
            s = sample(field, cell, frac + h * wp.cw_mul(total, rate), home)
            s[0] += wp.dot(vec3(s[1], s[2], s[3]), q + h * momentum + kick)
            return s
        else:
            return sample(field, cell, frac + wp.cw_mul(h * total + kick, rate), home)

    return look


@functools.cache
def build_verdict(precision: str):
    """A function of a step's error and its rounding -> (whether the step counts, how many times longer to go on)."""
    t = types(precision)
    real, Control = t.real, t.Control

    @wp.func
    def verdict(
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
        left = wp.max(control.budget - used, real(0.0))
        allowed = wp.max(real(STEP_SHARE) * left, control.budget * h * index / reach)
        if h <= real(NOISE_STEP) * h_cell:
            allowed = wp.max(allowed, rounding)
        ratio = real(4.0)
        if off > real(0.0):
            ratio = wp.clamp(real(0.9) * wp.pow(allowed / off, real(0.25)), real(0.2), real(4.0))
        return bool((off <= allowed and wp.isfinite(off)) or h <= h_least), ratio

    return verdict
