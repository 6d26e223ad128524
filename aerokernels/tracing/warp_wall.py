"""Device functions about the body: how far its wall is, where a ray leaves it, and how far the way ahead is clear."""

import functools

import warp as wp

from .scheme import CLEAR_MARCH_LIMIT, WALL_MARCH_LIMIT
from .warp_types import types


@functools.cache
def build_wall_distance(precision: str, geometry: str):
    """A function (field, point in x, y, z [m]) -> signed distance to the body [m], negative inside it."""
    t = types(precision)
    real, vec2, vec3, Field = t.real, t.vec2, t.vec3, t.Field

    @wp.func
    def wall_distance(field: Field, p: vec3):
        first = p[1]
        if wp.static(geometry == "axisymmetric"):
            first = wp.sqrt(p[0] * p[0] + p[1] * p[1])
        place = wp.cw_mul(vec2(first, p[2]) - field.wall_origin, field.wall_rate)
        i = wp.clamp(int(wp.floor(place[0])), 0, field.wall_count[0] - 2)
        j = wp.clamp(int(wp.floor(place[1])), 0, field.wall_count[1] - 2)
        u = wp.clamp(place[0] - real(i), real(0.0), real(1.0))
        v = wp.clamp(place[1] - real(j), real(0.0), real(1.0))
        near = (real(1.0) - v) * field.wall[i, j] + v * field.wall[i, j + 1]
        far = (real(1.0) - v) * field.wall[i + 1, j] + v * field.wall[i + 1, j + 1]
        return (real(1.0) - u) * near + u * far

    return wall_distance


@functools.cache
def build_way_out(precision: str, geometry: str):
    """A function (field, position, direction, from, to) -> (distance at which a ray is out, whether it is not)."""
    t = types(precision)
    real, vec3, Field = t.real, t.vec3, t.Field
    wall_distance = build_wall_distance(precision, geometry)

    @wp.func
    def way_out(field: Field, p: wp.vec3d, d: wp.vec3d, first: wp.float64, last: wp.float64):
        least = wp.float64(1.0e-4) / wp.float64(field.wall_rate[1])
        along = wp.float64(first)
        march = int(0)
        solid = bool(True)
        while solid and march < wp.static(WALL_MARCH_LIMIT) and along <= last:
            at = p + along * d
            gap = wall_distance(field, vec3(real(at[0]), real(at[1]), real(at[2])))
            solid = bool(gap < real(0.0))
            if solid:
                along += wp.max(-wp.float64(gap), least)
            march += 1
        return along, solid

    return way_out


@functools.cache
def build_stays_clear(precision: str, geometry: str):
    """A function (field, position, direction, enter, far): whether a straight ray keeps away from the body there."""
    t = types(precision)
    real, vec3, Field = t.real, t.vec3, t.Field
    wall_distance = build_wall_distance(precision, geometry)

    @wp.func
    def stays_clear(field: Field, p: wp.vec3d, d: wp.vec3d, enter: wp.float64, far: wp.float64):
        # Once it has left its wall.
        least = wp.float64(1.0) / wp.float64(wp.max(field.wall_rate))
        along = enter + wp.float64(2.0) * least
        # Only where the body may be.
        low, high = wp.float64(field.wall_span[0]), wp.float64(field.wall_span[1])
        stop = wp.float64(far)
        if d[2] != wp.float64(0.0):
            one = (low - p[2]) / d[2]
            other = (high - p[2]) / d[2]
            along = wp.max(along, wp.min(one, other))
            stop = wp.min(stop, wp.max(one, other))
        elif p[2] < low or p[2] > high:
            stop = along
        march = int(0)
        clear = bool(True)
        while clear and along < stop:
            at = p + along * d
            gap = wp.float64(wall_distance(field, vec3(real(at[0]), real(at[1]), real(at[2]))))
            clear = bool(gap > wp.float64(0.1) * least and march < wp.static(WALL_MARCH_LIMIT))
            along += gap
            march += 1
        return clear

    return stays_clear


@functools.cache
def build_clear_way(precision: str, geometry: str):
    """Functions (field, bounds, cell, frac) -> distance to the wall, and the longest step that is clear of it."""
    t = types(precision)
    real, vec3, Field, Bounds = t.real, t.vec3, t.Field, t.Bounds
    wall_distance = build_wall_distance(precision, geometry)

    @wp.func
    def wall_at(field: Field, bounds: Bounds, cell: wp.vec3i, frac: vec3):
        place = wp.vec3d(
            wp.float64(cell[0]) + wp.float64(frac[0]),
            wp.float64(cell[1]) + wp.float64(frac[1]),
            wp.float64(cell[2]) + wp.float64(frac[2]),
        )
        there = bounds.origin + wp.cw_mul(place, bounds.spacing)
        return wall_distance(field, vec3(real(there[0]), real(there[1]), real(there[2])))

    @wp.func
    def clear_way(
        field: Field,
        bounds: Bounds,
        cell: wp.vec3i,
        frac: vec3,
        rate: vec3,
        total: vec3,
        force: vec3,
        gap: real,
        h: real,
    ):
        """The step h, cut to where the parabola ahead is known to be free of the body."""
        speed = wp.length(total)
        # On the wall itself nothing is known: go one node of the distance's grid.
        least = real(1.0) / wp.max(field.wall_rate)
        clear = wp.max(gap, least) / speed
        march = int(0)
        while clear < h and march < wp.static(CLEAR_MARCH_LIMIT):
            at = frac + wp.cw_mul(clear * total + (real(0.5) * clear * clear) * force, rate)
            ahead = wall_at(field, bounds, cell, at)
            if ahead < real(0.1) * least:
                march = wp.static(CLEAR_MARCH_LIMIT)
            clear += wp.max(ahead, real(0.0)) / speed
            march += 1
        return wp.min(h, clear)

    return wall_at, clear_way
