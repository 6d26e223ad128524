"""Device functions: the rest to a face of a grid at which the slope jumps, and the slope behind a face or an edge.

The OpenCL twin is in kernels/trace.cl.
"""

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
        push_off_faces = build_to_face(library, geometry)[1]

        @wp.func
        def slope_behind(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int, bearing: vec3, q: vec3):
            rate = field.inverse_spacing
            pace = wp.cw_mul(bearing, rate)
            over = real(at_face) / wp.length(pace)
            push = push_off_faces(frac, pace)
            probe = frac + over * pace + push
            beyond = sample(field, cell, probe, current_cell)
            force, probe_pot = vec3(beyond[1], beyond[2], beyond[3]), beyond[0]
            pot = probe_pot - over * wp.dot(force, bearing)
            pot -= push[1] * force[1] / rate[1] + push[2] * force[2] / rate[2]
            if wp.static(geometry != "planar"):
                pot -= push[0] * force[0] / rate[0]
            if wp.static(straight):
                pot, probe_pot = pot + wp.dot(force, q), probe_pot + wp.dot(force, q)
            return pot, force, probe, probe_pot

    return slope_behind


@built_once
def build_rest_to_face(library: KernelLibrary, geometry: str):
    """Build a function -> rest [sigma] to the face `stand_off` cells before which a step of length h stopped, or 0."""
    t = library.types
    real, vec3 = t.real, t.vec3
    to_face, _ = build_to_face(library, geometry)

    @wp.func
    def rest_to_face(frac: vec3, velocity: vec3, acceleration: vec3, stand_off: real, h: real):
        rest = to_face(frac, velocity, acceleration, real(0.0))
        if rest <= h and rest * wp.length(velocity) <= real(4.0) * stand_off:
            return rest
        return real(0.0)

    return rest_to_face
