"""Device functions: the rest to a face of a grid at which the slope jumps, and the slope behind a face or an edge."""

import warp as wp

from ....scheme import AT_FACE
from ..library import KernelLibrary, built_once
from . import grid, mesh
from .step_bound import build_to_face


@built_once
def build_slope_behind(library: KernelLibrary, geometry: str, interpolation: str, on_mesh: bool, straight: bool):
    """Build a function -> (potential at the ray, slope, where and for which potential they were looked up).

    On a grid they are looked up a little behind the face, and continued back to it; on a mesh in the cell behind the
    edge. On a straight line the potential is continued to the ray, q beside the line.
    """
    t = library.types
    real, vec3, Field = t.real, t.vec3, t.Field
    at_face = AT_FACE[library.precision]

    if on_mesh:
        sample_in = mesh.build_sample_in(library, geometry, interpolation)

        @wp.func
        def slope_behind(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int, bearing: vec3, q: vec3):
            beyond = sample_in(field, current_cell, frac)
            pot, force = beyond[0], vec3(beyond[1], beyond[2], beyond[3])
            if wp.static(straight):
                pot += wp.dot(force, q)
            return pot, force, frac, pot

    else:
        sample = grid.build_sample(library, geometry, interpolation)
        _, push_off_faces, before_push = build_to_face(library, geometry)

        @wp.func
        def slope_behind(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int, bearing: vec3, q: vec3):
            rate = field.inverse_spacing
            pace = wp.cw_mul(bearing, rate)
            over = real(at_face) / wp.length(pace)
            push = push_off_faces(frac, pace)
            probe = frac + over * pace + push
            beyond = sample(field, cell, probe, current_cell)
            force, probe_pot = vec3(beyond[1], beyond[2], beyond[3]), beyond[0]
            pot = before_push(probe_pot - over * wp.dot(force, bearing), force, push, rate)
            if wp.static(straight):
                pot, probe_pot = pot + wp.dot(force, q), probe_pot + wp.dot(force, q)
            return pot, force, probe, probe_pot

    return slope_behind


@built_once
def build_first_sample(library: KernelLibrary, geometry: str, sample, at_faces: bool):
    """Build a function -> (potential, slope) where a ray with the direction d starts.

    With `at_faces` the slope is that of the cell into which a ray flies that starts in a face.
    """
    t = library.types
    vec3, Field = t.vec3, t.Field
    _, push_off_faces, before_push = build_to_face(library, geometry) if at_faces else (None,) * 3

    @wp.func
    def first_sample(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int, d: vec3):
        probe = frac
        if wp.static(at_faces):
            push = push_off_faces(frac, wp.cw_mul(d, field.inverse_spacing))
            probe = frac + push
        s = sample(field, cell, probe, current_cell)
        pot, force = s[0], vec3(s[1], s[2], s[3])
        if wp.static(at_faces):
            pot = before_push(pot, force, push, field.inverse_spacing)
        return pot, force

    return first_sample


@built_once
def build_rest_to_face(library: KernelLibrary, geometry: str):
    """Build a function -> rest [sigma] to the face `stand_off` cells before which a step of length h stopped, or 0."""
    t = library.types
    real, vec3 = t.real, t.vec3
    to_face, _, _ = build_to_face(library, geometry)

    @wp.func
    def rest_to_face(frac: vec3, velocity: vec3, acceleration: vec3, stand_off: real, h: real):
        rest = to_face(frac, velocity, acceleration, real(0.0))
        if rest <= h and rest * wp.length(velocity) <= real(4.0) * stand_off:
            return rest
        return real(0.0)

    return rest_to_face
