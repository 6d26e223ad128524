"""Device functions of the tracer: positions in cells, compensated sums, and the increments of a step.

The component of the deviation q along the direction d enters the path difference of a nearly straight ray in first
order. Summed twice from gradients, it would carry their error. It equals int (T . d - a) d sigma = M - B, with
B = int (n - T . d) d sigma of second order; M and B are sums of values by the quadrature of the optical path. So the
OPD of a ray through a shock is as accurate as the quadrature of S.
"""

from types import SimpleNamespace
from typing import Any

import warp as wp

from ....tableau import BT, STAGE_MOMENTUM
from ..library import Scene, built_once

# Axes along which a position is split into cell + fraction.
SHIFTED = {"volume": (0, 1, 2), "planar": (1, 2), "axisymmetric": (2,), "mesh": ()}


@wp.func
def advance(total: Any, carry: Any, term: Any):
    """Add a term to Kahan's compensated sum: (sum, carry, term) -> (sum, carry)."""
    y = term - carry
    s = total + y
    return s, (s - total) - y


@wp.func
def deflection(ambient: wp.float64, d: wp.vec3d, p: wp.vec3d):
    """Change of the unit tangent from d when the momentum is ambient d + p, without cancellation."""
    speed = wp.length(ambient * d + p)
    excess = (wp.float64(2.0) * ambient * wp.dot(d, p) + wp.dot(p, p)) / (speed + ambient)
    return (p - excess * d) / speed


@built_once()
def build_motion(scene: Scene):
    """Build the functions of a ray's contrast, sums and momentum."""
    t = scene.types
    real, vec3, vec4 = t.real, t.vec3, t.vec4
    v1, v2, v3, v4 = (float(v) for v in BT)
    p1, p2, p3, p4 = (float(v) for v in STAGE_MOMENTUM[1])
    r1, r2, r3, r4 = (float(v) for v in STAGE_MOMENTUM[2])

    @wp.func
    def contrast(ambient: real, potential: real):
        """Contrast from the potential, without cancellation."""
        square = wp.max(ambient * ambient + real(2.0) * potential, real(0.0))
        return real(2.0) * potential / (wp.sqrt(square) + ambient)

    @wp.func
    def longitudinal_deficit(ambient: real, d: vec3, momentum: vec3, potential: real):
        """Index minus the momentum along d, |T|^2 - (T . d)^2 over the sum of both: second order if nearly straight."""
        ahead = wp.dot(momentum, d)
        across = momentum - ahead * d
        return wp.dot(across, across) / (real(2.0) * ambient + contrast(ambient, potential) + ahead)

    @wp.func
    def longitudinal_deficit_sum(
        ambient: real, d: vec3, momentum: vec3, h: real, pot: real, force: vec3, s2: vec4, s3: vec4, s4: vec4
    ):
        force2 = vec3(s2[1], s2[2], s2[3])
        force3 = vec3(s3[1], s3[2], s3[3])
        force4 = vec3(s4[1], s4[2], s4[3])
        swung2 = momentum + h * (real(p1) * force + real(p2) * force2 + real(p3) * force3 + real(p4) * force4)
        swung3 = momentum + h * (real(r1) * force + real(r2) * force2 + real(r3) * force3 + real(r4) * force4)
        swung4 = momentum + h * (real(v1) * force + real(v2) * force2 + real(v3) * force3 + real(v4) * force4)
        total = real(v1) * longitudinal_deficit(ambient, d, momentum, pot) + real(v2) * longitudinal_deficit(
            ambient, d, swung2, s2[0]
        )
        return h * (
            total
            + real(v3) * longitudinal_deficit(ambient, d, swung3, s3[0])
            + real(v4) * longitudinal_deficit(ambient, d, swung4, s4[0])
        )

    @wp.func
    def step_sums(
        ambient: real, d: vec3, momentum: vec3, h: real, pot: real, force: vec3, s2: vec4, s3: vec4, s4: vec4
    ):
        """Increments over a step by the quadrature of the path; momentum, pot and force are those at its start."""
        return vec4(
            h,
            h * (real(v1) * pot + real(v2) * s2[0] + real(v3) * s3[0] + real(v4) * s4[0]),
            h
            * (
                real(v1) * contrast(ambient, pot)
                + real(v2) * contrast(ambient, s2[0])
                + real(v3) * contrast(ambient, s3[0])
                + real(v4) * contrast(ambient, s4[0])
            ),
            longitudinal_deficit_sum(ambient, d, momentum, h, pot, force, s2, s3, s4),
        )

    @wp.func
    def tangent_sums(ambient: real, d: vec3, momentum: vec3, back: real, pot: real, force: vec3):
        """Increments over a flight along the tangent."""
        half = real(0.5) * back * back
        climb = wp.dot(force, ambient * d + momentum)
        m = contrast(ambient, pot)
        return vec4(
            back,
            back * pot + half * climb,
            back * m + half * climb / (ambient + m),
            back * longitudinal_deficit(ambient, d, momentum, pot),
        )

    @wp.func
    def project_momentum(ambient: real, d: vec3, momentum: vec3, pot: real):
        """Correction along T that brings the momentum back onto |T| = n."""
        surplus = real(2.0) * pot - wp.dot(momentum, real(2.0) * ambient * d + momentum)
        tangent = ambient * d + momentum
        square = wp.dot(tangent, tangent)
        root = wp.sqrt(wp.max(square * (square + surplus), real(0.0)))
        return (surplus / (square + root)) * tangent

    return SimpleNamespace(**locals())


@built_once("geometry", "on_mesh")
def build_cells(scene: Scene):
    """Build functions that split a point into cells and fractions, and carry whole cells over."""
    t = scene.types
    real, vec3, Bounds = t.real, t.vec3, t.Bounds
    kind = "mesh" if scene.on_mesh else scene.geometry
    shift = wp.vec3i(*(int(axis in SHIFTED[kind]) for axis in range(3)))

    @wp.func
    def whole_cells(place: Any):
        """Whole cells of a position, zero along axes without cells of their own."""
        floors = wp.vec3i(int(wp.floor(place[0])), int(wp.floor(place[1])), int(wp.floor(place[2])))
        return wp.cw_mul(floors, shift)

    @wp.func
    def in_cells(bounds: Bounds, p: wp.vec3d):
        """Split a point into whole cells and fractions of a cell, in float64."""
        g = wp.cw_div(p - bounds.origin, bounds.spacing)
        cell = whole_cells(g)
        rest = g - wp.vec3d(wp.float64(cell[0]), wp.float64(cell[1]), wp.float64(cell[2]))
        return vec3(real(rest[0]), real(rest[1]), real(rest[2])), cell

    @wp.func
    def carry_over(cell: wp.vec3i, frac: vec3):
        """Move whole cells from the fraction into the cell, exactly."""
        moved = whole_cells(frac)
        return cell + moved, frac - vec3(real(moved[0]), real(moved[1]), real(moved[2]))

    return SimpleNamespace(**locals())
