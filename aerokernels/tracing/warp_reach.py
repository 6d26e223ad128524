"""Device functions about the length of a step on a uniform grid: the table of safe steps, and the faces of cells."""

import functools

import numpy as np
import warp as wp

from .quiet import CONE_SINES, CONES
from .warp_types import types

# Cell faces that a ray has passed but for rounding, or is about to pass in so little, in cells: not worth a step.
HAIR = 1e-4


@functools.cache
def build_cone(geometry: str):
    """A function (direction) -> number of its cone in quiet.CONES."""
    narrow, wide = (float(sine) ** 2 for sine in CONE_SINES)

    @wp.func
    def cone(d: wp.vec3d):
        axis = int(0)
        if wp.abs(d[1]) > wp.abs(d[0]):
            axis = int(1)
        if wp.abs(d[2]) > wp.max(wp.abs(d[0]), wp.abs(d[1])):
            axis = int(2)
        if wp.static(geometry == "axisymmetric"):
            if axis < 2:
                return int(0)
        elif wp.static(geometry != "volume"):
            if axis < 1:
                return int(0)
        square = wp.dot(d, d) - d[axis] * d[axis]
        if square > wp.float64(wide):
            return int(0)
        number = 1 + 4 * axis
        if d[axis] < wp.float64(0.0):
            number += 2
        if square > wp.float64(narrow):
            number += 1
        return number

    return cone


@functools.cache
def build_reach(precision: str, geometry: str):
    """A function (control, cone, cell, frac, total) -> safe step where the point lies [sigma].

    Zero where none is known: on a mesh, and for a ray that turned out of the cone that it started in.
    """
    t = types(precision)
    real, vec3, Control = t.real, t.vec3, t.Control
    cosines = tuple(float(np.cos(cone.spread)) for cone in CONES[1:3])
    narrow, wide = cosines

    @wp.func
    def block(control: Control, axis: int, cell: int, place: real):
        return wp.clamp((cell + int(wp.floor(place))) // control.block, 0, control.block_count[axis] - 1)

    @wp.func
    def entry(control: Control, cell: wp.vec3i, frac: vec3):
        if wp.static(geometry == "volume"):
            row = block(control, 0, cell[0], frac[0]) * control.block_count[1] + block(control, 1, cell[1], frac[1])
            return row * control.block_count[2] + block(control, 2, cell[2], frac[2])
        elif wp.static(geometry == "planar"):
            return block(control, 0, cell[1], frac[1]) * control.block_count[1] + block(control, 1, cell[2], frac[2])
        else:
            row = block(control, 0, 0, wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1]))
            return row * control.block_count[1] + block(control, 1, cell[2], frac[2])

    @wp.func
    def reach(control: Control, cone: int, cell: wp.vec3i, frac: vec3, total: vec3):
        if wp.static(geometry == "mesh"):
            return real(0.0)
        else:
            start = control.reach_start[cone]
            if start < 0:
                return real(0.0)
            speed = wp.length(total)
            if cone > 0:
                ahead = total[(cone - 1) // 4]
                if ((cone - 1) // 2) % 2 == 1:
                    ahead = -ahead
                cosine = real(narrow)
                if (cone - 1) % 2 == 1:
                    cosine = real(wide)
                if ahead < cosine * speed:
                    return real(0.0)
            return control.reach[start + entry(control, cell, frac)] / speed

    return reach


@functools.cache
def build_to_face(precision: str, geometry: str):
    """A function (cell, frac, velocity in cells) -> step to the next face of a cell; one closer than HAIR is behind."""
    t = types(precision)
    real, vec3 = t.real, t.vec3
    axes = {"volume": (0, 1, 2), "planar": (1, 2), "axisymmetric": (2,)}[geometry]
    none = 1e30

    @wp.func
    def flat(place: real, speed: real):
        """Along an axis with faces at whole numbers."""
        inside = place - wp.floor(place)
        if speed > real(0.0):
            gap = real(1.0) - inside
            if gap < real(HAIR):
                gap += real(1.0)
            return gap / speed
        if speed < real(0.0):
            if inside < real(HAIR):
                inside += real(1.0)
            return -inside / speed
        return real(none)

    @wp.func
    def round_face(frac: vec3, velocity: vec3):
        """To the next cylinder of whole radius."""
        a = velocity[0] * velocity[0] + velocity[1] * velocity[1]
        if a == real(0.0):
            return real(none)
        b = frac[0] * velocity[0] + frac[1] * velocity[1]
        square = frac[0] * frac[0] + frac[1] * frac[1]
        radius = wp.sqrt(square)
        inner = wp.floor(radius)
        if radius - inner < real(HAIR):
            inner -= real(1.0)
        if b < real(0.0) and inner > real(0.0):
            disc = b * b - a * (square - inner * inner)
            if disc > real(0.0):
                return (square - inner * inner) / (wp.sqrt(disc) - b)
        elif radius > real(HAIR) and b < real(-HAIR) * wp.sqrt(a):
            return -b / a  # to where the ray is nearest to the axis, a kink if it meets it
        outer = wp.floor(radius + real(HAIR)) + real(1.0)
        return (wp.sqrt(wp.max(b * b - a * (square - outer * outer), real(0.0))) - b) / a

    @wp.func
    def to_face(cell: wp.vec3i, frac: vec3, velocity: vec3):
        step = real(none)
        if wp.static(0 in axes):
            step = wp.min(step, flat(frac[0], velocity[0]))
        if wp.static(1 in axes):
            step = wp.min(step, flat(frac[1], velocity[1]))
        if wp.static(2 in axes):
            step = wp.min(step, flat(frac[2], velocity[2]))
        if wp.static(geometry == "axisymmetric"):
            step = wp.min(step, round_face(frac, velocity))
        return step

    return to_face
