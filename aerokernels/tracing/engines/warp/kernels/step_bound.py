"""Device functions about the length of a step on a uniform grid: the table of step bounds, and the faces of cells."""

from types import SimpleNamespace

import numpy as np
import warp as wp

from .....medium.grid import AXIS_CORE
from ....scheme import AT_FACE, RADIUS_NOISE
from ....step_bound import CONE_SINES, CONES
from ..library import Scene, built_once


@built_once("geometry", "on_mesh")
def build_step_bound(scene: Scene):
    """Build the functions of the table of step bounds and of the faces of cells."""
    geometry, on_mesh = scene.geometry, scene.on_mesh
    t = scene.types
    real, vec3, Control = t.real, t.vec3, t.Control
    narrow_square, wide_square = (float(sine) ** 2 for sine in CONE_SINES)
    narrow, wide = (float(np.cos(cone.spread)) for cone in CONES[1:3])
    last_axis = 2 if geometry == "volume" else 1
    axes = {"volume": (0, 1, 2), "planar": (1, 2), "axisymmetric": (2,)}[geometry]
    none = 1e30
    radius_noise, at_face = RADIUS_NOISE[scene.precision], AT_FACE[scene.precision]

    @wp.func
    def cone_of(d: wp.vec3d):
        """Number of the direction's cone in step_bound.CONES."""
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
        if square > wp.float64(wide_square):
            return int(0)
        number = 1 + 4 * axis
        if d[axis] < wp.float64(0.0):
            number += 2
        if square > wp.float64(narrow_square):
            number += 1
        return number

    @wp.func
    def step_bound_block(control: Control, axis: int, cell: int, place: real):
        return wp.clamp((cell + int(wp.floor(place))) // control.block, 0, control.block_count[axis] - 1)

    @wp.func
    def entry(control: Control, cell: wp.vec3i, frac: vec3):
        c = step_bound_block(control, last_axis, cell[2], frac[2])
        if wp.static(geometry == "volume"):
            a = step_bound_block(control, 0, cell[0], frac[0])
            b = step_bound_block(control, 1, cell[1], frac[1])
            return (a * control.block_count[1] + b) * control.block_count[2] + c
        elif wp.static(geometry == "planar"):
            return step_bound_block(control, 0, cell[1], frac[1]) * control.block_count[1] + c
        else:
            radius = wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1])
            return step_bound_block(control, 0, 0, radius) * control.block_count[1] + c

    @wp.func
    def step_bound_of(control: Control, cone: int, cell: wp.vec3i, frac: vec3, total: vec3):
        """Step bound at a point [sigma].

        Zero where there is none: on a mesh, and for a ray that has turned out of the cone in which it started.
        """
        if wp.static(on_mesh):
            return real(0.0)
        else:
            start = control.step_bound_start[cone]
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
            return control.step_bound[start + entry(control, cell, frac)] / speed

    @wp.func
    def meet_face(gap: real, speed: real, acceleration: real):
        """First t > 0 with speed t + acceleration t^2 / 2 = gap, for gap > 0."""
        disc = speed * speed + real(2.0) * acceleration * gap
        if disc < real(0.0):
            return real(none)
        toward = speed + wp.sqrt(disc)
        if toward <= real(0.0):
            return real(none)
        return real(2.0) * gap / toward

    @wp.func
    def flat_face(place: real, speed: real, acceleration: real, face_tolerance: real):
        """Step to the next face along an axis with faces at whole numbers."""
        ahead = place - wp.floor(place)
        behind = ahead
        ahead = real(1.0) - ahead
        if ahead < face_tolerance:
            ahead += real(1.0)
        if behind < face_tolerance:
            behind += real(1.0)
        return wp.min(meet_face(ahead, speed, acceleration), meet_face(behind, -speed, -acceleration))

    @wp.func
    def round_face(frac: vec3, velocity: vec3, acceleration: vec3, face_tolerance: real):
        """Step to the next cylinder of whole radius R: (r^2 - R^2) / 2 along the parabola without the quartic term."""
        square = frac[0] * frac[0] + frac[1] * frac[1]
        b = frac[0] * velocity[0] + frac[1] * velocity[1]
        a = velocity[0] * velocity[0] + velocity[1] * velocity[1]
        c = a + frac[0] * acceleration[0] + frac[1] * acceleration[1]
        radius = wp.sqrt(square)
        close = face_tolerance + real(radius_noise) * radius
        inner = wp.floor(radius)
        if radius - inner < close:
            inner -= real(1.0)
        outer = wp.floor(radius + close) + real(1.0)
        step = meet_face(real(0.5) * (outer - radius) * (outer + radius), b, c)
        if inner > real(0.0):
            step = wp.min(step, meet_face(real(0.5) * (radius - inner) * (radius + inner), -b, -c))
        elif radius > real(AXIS_CORE) and b < real(-AXIS_CORE) * wp.sqrt(a):
            step = wp.min(step, -b / a)  # to where the ray is nearest to the axis: a kink if it meets the axis
        return step

    @wp.func
    def push_off_flat_face(place: real, speed: real):
        """Along one axis, the push [cells] that brings a ray in a face to the side to which it flies."""
        push = real(0.0)
        if wp.abs(place - wp.floor(place + real(0.5))) < real(at_face):
            push = real(2.0) * real(at_face)
            if speed < real(0.0):
                push = -push
        return push

    @wp.func
    def push_off_round_face(frac: vec3, velocity: vec3):
        """The push off a cylindrical face of an axisymmetric grid."""
        radius = wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1])
        close = real(at_face) + real(radius_noise) * radius
        push = vec3(real(0.0), real(0.0), real(0.0))
        if wp.abs(radius - wp.floor(radius + real(0.5))) < close and radius > real(AXIS_CORE):
            sense = real(1.0)
            if frac[0] * velocity[0] + frac[1] * velocity[1] < real(0.0):
                sense = real(-1.0)
            push = (sense * real(2.0) * close / radius) * vec3(frac[0], frac[1], real(0.0))
        return push

    @wp.func
    def push_off_faces(frac: vec3, velocity: vec3):
        """The push to the other side of all faces in which a ray is.

        A small step along a ray that grazes a face would not bring it there.
        """
        push = vec3(real(0.0), real(0.0), real(0.0))
        if wp.static(geometry == "axisymmetric"):
            push = push_off_round_face(frac, velocity)
        else:
            push[1] = push_off_flat_face(frac[1], velocity[1])
        if wp.static(geometry == "volume"):
            push[0] = push_off_flat_face(frac[0], velocity[0])
        push[2] = push_off_flat_face(frac[2], velocity[2])
        return push

    @wp.func
    def to_face(frac: vec3, velocity: vec3, acceleration: vec3, face_tolerance: real):
        """Step to the next face of a cell farther than face_tolerance; velocity and its derivative are in cells."""
        step = real(none)
        if wp.static(0 in axes):
            step = wp.min(step, flat_face(frac[0], velocity[0], acceleration[0], face_tolerance))
        if wp.static(1 in axes):
            step = wp.min(step, flat_face(frac[1], velocity[1], acceleration[1], face_tolerance))
        if wp.static(2 in axes):
            step = wp.min(step, flat_face(frac[2], velocity[2], acceleration[2], face_tolerance))
        if wp.static(geometry == "axisymmetric"):
            step = wp.min(step, round_face(frac, velocity, acceleration, face_tolerance))
        return step

    @wp.func
    def before_push(pot: real, force: vec3, push: vec3, rate: vec3):
        """The potential at a ray, from the potential and the slope that are looked up a push beside it."""
        back = pot - (push[1] * force[1] / rate[1] + push[2] * force[2] / rate[2])
        if wp.static(geometry != "planar"):
            back -= push[0] * force[0] / rate[0]
        return back

    return SimpleNamespace(**locals())
