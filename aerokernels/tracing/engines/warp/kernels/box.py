"""Device functions: where a straight ray meets the field's box, and the box's faces as stop surfaces. In float64."""

from types import SimpleNamespace

import warp as wp

from ....scheme import GRAZING_TOLERANCE, LEAST_COSINE
from ..library import Scene, built_once

FACE_COUNT = {"volume": 6, "planar": 4, "axisymmetric": 3}
# How many axes, counted from z, have flat faces: these are the first surfaces, two per axis.
FLAT_AXES = {"volume": 3, "planar": 2, "axisymmetric": 1}


@wp.func
def slab(low: wp.float64, high: wp.float64, p: wp.float64, d: wp.float64, span: wp.vec2d):
    """The part of `span` in which a coordinate of a line is between two bounds; reversed if there is none."""
    if d == wp.float64(0.0):
        if p < low or p > high:
            return wp.vec2d(wp.float64(1.0), wp.float64(-1.0))
        return span
    near = (low - p) / d
    far = (high - p) / d
    return wp.vec2d(wp.max(span[0], wp.min(near, far)), wp.min(span[1], wp.max(near, far)))


@built_once("geometry")
def build_box(scene: Scene):
    """Build the functions about a field's box."""
    geometry = scene.geometry
    t = scene.types
    real, vec3, vec4, Control, Bounds = t.real, t.vec3, t.vec4, t.Control, t.Bounds
    faces = FACE_COUNT[geometry]

    @wp.func
    def cylinder(radius: wp.float64, p: wp.vec3d, d: wp.vec3d, span: wp.vec2d):
        a = d[0] * d[0] + d[1] * d[1]
        if a == wp.float64(0.0):
            if p[0] * p[0] + p[1] * p[1] > radius * radius:
                return wp.vec2d(wp.float64(1.0), wp.float64(-1.0))
            return span
        middle = -(p[0] * d[0] + p[1] * d[1]) / a
        x = p[0] + middle * d[0]
        y = p[1] + middle * d[1]
        rest = radius * radius - x * x - y * y
        if rest < wp.float64(0.0):
            return wp.vec2d(wp.float64(1.0), wp.float64(-1.0))
        half = wp.sqrt(rest / a)
        return wp.vec2d(wp.max(span[0], middle - half), wp.min(span[1], middle + half))

    @wp.func
    def crossing(low: wp.vec3d, high: wp.vec3d, radius: wp.float64, p: wp.vec3d, d: wp.vec3d):
        """Distances at which a straight ray enters and leaves a box.

        Entry > exit means a miss.
        """
        span = wp.vec2d(wp.float64(-1.0e300), wp.float64(1.0e300))
        span = slab(low[2], high[2], p[2], d[2], span)
        if wp.static(geometry == "axisymmetric"):
            span = cylinder(radius, p, d, span)
        else:
            span = slab(low[1], high[1], p[1], d[1], span)
        if wp.static(geometry == "volume"):
            span = slab(low[0], high[0], p[0], d[0], span)
        return span

    @wp.func
    def surface(control: Control, k: int, cell: wp.vec3i, frac: vec3):
        """Distance outside surface k, and its gradient per cell.

        Surfaces 0 and 1 are the z faces; then the cylinder, or the y faces, or the y and x faces; the last is the
        plane.
        """
        if k == faces:
            n = control.plane_normal
            place = real(cell[0]) * n[0] + real(cell[1]) * n[1] + real(cell[2]) * n[2] - control.plane_offset
            return vec4(place + wp.dot(n, frac), n[0], n[1], n[2])
        if wp.static(geometry == "axisymmetric"):
            if k == 2:
                radius = control.radius
                value = (frac[0] * frac[0] + frac[1] * frac[1] - radius * radius) / (real(2.0) * radius)
                return vec4(value, frac[0] / radius, frac[1] / radius, real(0.0))
        axis = 2 - k // 2
        grad = vec4(real(0.0), real(0.0), real(0.0), real(0.0))
        if k % 2 == 0:
            grad[0] = (control.face_low[axis] - real(cell[axis])) - frac[axis]
            grad[axis + 1] = real(-1.0)
        else:
            grad[0] = (real(cell[axis]) - control.face_high[axis]) + frac[axis]
            grad[axis + 1] = real(1.0)
        return grad

    @wp.func
    def surface_distance(bounds: Bounds, k: int, p: wp.vec3d):
        """Distance outside surface k [m], and the unit normal of the surface."""
        if k == faces:
            n = bounds.plane_normal
            return wp.vec4d(wp.dot(n, p - bounds.plane_point), n[0], n[1], n[2])
        if wp.static(geometry == "axisymmetric"):
            if k == 2:
                square = p[0] * p[0] + p[1] * p[1]
                inverse = wp.float64(1.0) / wp.sqrt(square)
                return wp.vec4d(square * inverse - bounds.radius, p[0] * inverse, p[1] * inverse, wp.float64(0.0))
        axis = 2 - k // 2
        out = wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
        if k % 2 == 0:
            out[0] = bounds.low[axis] - p[axis]
            out[axis + 1] = wp.float64(-1.0)
        else:
            out[0] = p[axis] - bounds.high[axis]
            out[axis + 1] = wp.float64(1.0)
        return out

    @wp.func
    def nearest_face(bounds: Bounds, p: wp.vec3d):
        """Number of the box's face nearest to a place."""
        nearest = int(0)
        least = wp.float64(1.0e300)
        for k in range(faces):
            miss = wp.abs(surface_distance(bounds, k, p)[0])
            if miss < least:
                least = miss
                nearest = k
        return nearest

    @wp.func
    def meeting(bounds: Bounds, k: int, p: wp.vec3d, d: wp.vec3d, guess: wp.float64):
        """Distance at which a line meets surface k.

        For a line that grazes the surface it returns the guess.
        """
        along = wp.float64(guess)
        trials = int(1)
        if wp.static(geometry == "axisymmetric"):
            if k == 2:
                trials = int(3)  # Newton's method; on flat faces one step is exact
        for _trial in range(trials):
            miss = surface_distance(bounds, k, p + along * d)
            cosine = wp.dot(wp.vec3d(miss[1], miss[2], miss[3]), d)
            if wp.abs(cosine) > wp.float64(LEAST_COSINE):
                along -= miss[0] / cosine
        return along

    @wp.func
    def grazing_correction(bounds: Bounds, control: Control, k: int, p: wp.vec3d, d: wp.vec3d, heading: wp.vec3d):
        """Correction for a ray that grazes surface k.

        Three numbers: the remaining length along the tangent `heading` to the surface [m]; 0 if that is more than the
        rounding of the ray's position explains, or if the line along d met the surface already (see `build_meeting`).
        The length left uncorrected because it is too long [m]. The cosine of the angle between tangent and normal.
        """
        miss = surface_distance(bounds, k, p)
        normal = wp.vec3d(miss[1], miss[2], miss[3])
        cosine = wp.dot(normal, heading)
        most = wp.float64(GRAZING_TOLERANCE) / wp.float64(wp.max(control.cell_rate))
        grazes = wp.abs(wp.dot(normal, d)) <= wp.float64(LEAST_COSINE) and wp.abs(miss[0]) < most * wp.abs(cosine)
        rest = wp.float64(0.0)
        shortfall = wp.float64(0.0)
        if grazes:
            rest = -miss[0] / cosine
        elif wp.abs(wp.dot(normal, d)) <= wp.float64(LEAST_COSINE):
            shortfall = wp.abs(miss[0]) / wp.max(wp.abs(cosine), wp.float64(1.0e-200))
        return wp.vec3d(rest, shortfall, wp.abs(cosine))

    @wp.func
    def detour(bounds: Bounds, k: int, p: wp.vec3d, d: wp.vec3d, q: wp.vec3d, leave: wp.float64, other: wp.float64):
        """Extra distance along d to face k for a line shifted by q.

        It is relative to the line itself, which leaves the box at `leave`. The function returns `other` if the line
        leaves by another face or at a grazing angle.
        """
        at = p + leave * d
        miss = surface_distance(bounds, k, at)
        normal = wp.vec3d(miss[1], miss[2], miss[3])
        cosine = wp.dot(normal, d)
        size = wp.length(bounds.high - bounds.low) + wp.length(p)
        if wp.abs(miss[0]) > wp.float64(1.0e-14) * size or wp.abs(cosine) < wp.float64(LEAST_COSINE):
            return other
        further = -wp.dot(normal, q) / cosine
        if wp.static(geometry == "axisymmetric"):
            if k == 2:
                # |c + (further d + q)|^2 = |c|^2 across the axis, c of length `radius`: the root that is 0 for q = 0
                a = d[0] * d[0] + d[1] * d[1]
                b = (at[0] + q[0]) * d[0] + (at[1] + q[1]) * d[1]
                c = (wp.float64(2.0) * at[0] + q[0]) * q[0] + (wp.float64(2.0) * at[1] + q[1]) * q[1]
                square = b * b - a * c
                if b <= wp.float64(0.0) or square < wp.float64(0.0):
                    return other
                further = -c / (b + wp.sqrt(square))
        return further

    return SimpleNamespace(**locals())
