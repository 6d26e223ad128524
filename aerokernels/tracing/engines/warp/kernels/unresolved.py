"""Device functions: a bound of the error from features between a ray's leapfrog samples.

It is a table summed along the ray's path, and one looked up at its ends (see tracing/leapfrog/unresolved.py).
"""

import warp as wp

from ....scheme import LEAST_COSINE, LOOKUP_STRIDE, MISSED_SLOPE
from ..library import KernelLibrary, built_once


@built_once
def build_unresolved(library: KernelLibrary, geometry: str):
    """Build a function (field, control, start, d, length, beside) -> a bound of the error of a ray's path [m].

    The ray starts at `start`, in cells from the grid's first node (x, y from the axis), runs along the unit vector d
    for `length` metres, and ends `beside` [m] beside that line. 0 without a table, infinite if the samples are further
    apart than the table is valid for.
    """
    t = library.types
    real, vec3, Field, Control = t.real, t.vec3, t.Field, t.Control

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

    return unresolved_of


@built_once
def build_with_lever_arm(library: KernelLibrary):
    """Build a function (field, missed, onward, cosine) -> error of the path [m] including that from the direction.

    The ray meets its stop `onward` metres further on at this cosine with the stop's normal.
    """
    t = library.types
    real, Field = t.real, t.Field

    @wp.func
    def with_lever_arm(field: Field, missed: real, onward: real, cosine: real):
        tangent = wp.sqrt(wp.max(real(1.0) - cosine * cosine, real(0.0))) / wp.max(cosine, real(LEAST_COSINE))
        return missed * (real(1.0) + real(MISSED_SLOPE) * wp.max(field.inverse_spacing) * onward * tangent)

    return with_lever_arm
