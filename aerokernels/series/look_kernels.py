"""Warp kernels of look_batch.py: rays of many look directions in one launch, and their sums over the pupil."""

from typing import Any

GAUSS = 0.2886751345948129  # of a step, from its middle: the two Gauss points, exact for cubics


def build_kernels() -> tuple[Any, Any, Any]:
    """Return the kernels `look_rays`, `look_moments` and `look_phasors`."""
    import warp as wp

    gauss = wp.constant(GAUSS)

    @wp.func
    def basis(u: float):
        v = 1.0 - u
        return wp.vec4(
            v * v * v / 6.0,
            (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
            (3.0 * v * v * v - 6.0 * v * v + 4.0) / 6.0,
            u * u * u / 6.0,
        )

    @wp.func
    def slopes(u: float):
        v = 1.0 - u
        return wp.vec4(-0.5 * v * v, 0.5 * (3.0 * u * u - 4.0 * u), 0.5 * (4.0 * v - 3.0 * v * v), 0.5 * u * u)

    @wp.func
    def potential(coefficient: wp.array(dtype=float), count: wp.vec3i, place: wp.vec3):
        """Return the potential of the cubic spline and its slopes [1/cell] at a place [cells]."""
        i = wp.clamp(int(wp.floor(place[0])), 0, count[0] - 2)
        j = wp.clamp(int(wp.floor(place[1])), 0, count[1] - 2)
        k = wp.clamp(int(wp.floor(place[2])), 0, count[2] - 2)
        u = place[0] - float(i)
        v = place[1] - float(j)
        w = place[2] - float(k)
        bu, bv, bw = basis(u), basis(v), basis(w)
        su, sv, sw = slopes(u), slopes(v), slopes(w)
        found = wp.vec4(0.0, 0.0, 0.0, 0.0)
        for a in range(4):
            row = wp.vec3(0.0, 0.0, 0.0)
            for b in range(4):
                at = ((i + a) * (count[1] + 2) + j + b) * (count[2] + 2) + k
                c = wp.vec4(coefficient[at], coefficient[at + 1], coefficient[at + 2], coefficient[at + 3])
                value = wp.dot(c, bw)
                row += wp.vec3(bv[b] * value, sv[b] * value, bv[b] * wp.dot(c, sw))
            found += wp.vec4(bu[a] * row[0], su[a] * row[0], bu[a] * row[1], bu[a] * row[2])
        return found

    @wp.kernel(module="unique", enable_backward=False)
    def look_rays(
        coefficient_in: wp.array(dtype=float),
        count: wp.vec3i,
        start: wp.vec3,
        inverse_spacing: wp.vec3,
        ambient: float,
        point_in: wp.array(dtype=wp.vec2),
        look_in: wp.array(dtype=wp.vec3),
        first_in: wp.array(dtype=wp.vec3),
        second_in: wp.array(dtype=wp.vec3),
        reach_in: wp.array(dtype=float),
        first_ray: int,
        opd_out: wp.array(dtype=float),
    ):
        """Compute the optical path difference of a ray: along a straight line, plus bending to second order."""
        ray = wp.tid() + first_ray
        points = point_in.shape[0]
        d = ray // points
        p = point_in[ray % points]
        u = look_in[d]
        away = p[0] * first_in[d] + p[1] * second_in[d]
        q = start + wp.cw_mul(away, inverse_spacing)  # in cells from the first node
        pace = wp.cw_mul(u, inverse_spacing)
        enter = float(0.0)
        leave = float(1.0e30)
        face = int(0)
        for axis in range(3):
            last = float(count[axis] - 1)
            if wp.abs(pace[axis]) > 1.0e-12 * wp.length(pace):
                near = -q[axis] / pace[axis]
                far = (last - q[axis]) / pace[axis]
                enter = wp.max(enter, wp.min(near, far))
                if wp.max(near, far) < leave:
                    leave = wp.max(near, far)
                    face = axis
            elif q[axis] < 0.0 or q[axis] > last:
                leave = -1.0
        total = float(0.0)
        if leave > enter:
            steps = int(wp.ceil((leave - enter) * wp.length(pace)))
            h = (leave - enter) / float(steps)
            tilt = wp.vec3(0.0, 0.0, 0.0)
            shift = wp.vec3(0.0, 0.0, 0.0)
            bent = float(0.0)
            m = float(0.0)
            for step in range(steps):
                for side in range(2):
                    t = enter + (float(step) + 0.5 + gauss * (2.0 * float(side) - 1.0)) * h
                    s = potential(coefficient_in, count, q + t * pace)
                    m = s[0] / ambient * (1.0 - 0.5 * s[0] / (ambient * ambient))
                    g = wp.cw_mul(wp.vec3(s[1], s[2], s[3]), inverse_spacing) / ambient
                    g -= wp.dot(g, u) * u
                    w = 0.5 * h
                    middle = tilt + 0.5 * w * g
                    there = shift + 0.5 * w * middle
                    total += w * m
                    bent += w * (wp.dot(g, there) + 0.5 * wp.dot(middle, middle))
                    shift += w * middle
                    tilt += w * g
            bent += 0.5 * wp.dot(tilt, tilt) * wp.max(reach_in[d] - leave, 0.0)
            bent -= m * shift[face] / u[face]
            total += bent
        opd_out[ray] = total

    @wp.kernel(module="unique", enable_backward=False)
    def look_moments(
        opd_in: wp.array(dtype=float),
        point_in: wp.array(dtype=wp.vec2),
        each: int,
        first_group: int,
        moment_out: wp.array(dtype=wp.vec4d),
    ):
        """Compute the sums of o, o^2, x o and y o over a group of `each` rays of a direction."""
        group = wp.tid() + first_group
        first = group * each
        found = wp.vec4d()
        for k in range(each):
            o = wp.float64(opd_in[first + k])
            p = point_in[(first + k) % point_in.shape[0]]
            found += wp.vec4d(o, o * o, wp.float64(p[0]) * o, wp.float64(p[1]) * o)
        moment_out[group] = found

    @wp.kernel(module="unique", enable_backward=False)
    def look_phasors(
        opd_in: wp.array(dtype=float),
        point_in: wp.array(dtype=wp.vec2),
        each: int,
        groups: int,
        removed_in: wp.array(dtype=wp.vec3d),
        wavenumber: wp.float64,
        first_group: int,
        phasor_out: wp.array(dtype=wp.vec2d),
    ):
        """Compute the sums of exp(i k o) over a group, after removing a piston and a tilt of the direction."""
        group = wp.tid() + first_group
        first = group * each
        less = removed_in[group // groups]
        found = wp.vec2d()
        for k in range(each):
            p = point_in[(first + k) % point_in.shape[0]]
            o = wp.float64(opd_in[first + k]) - less[0] - less[1] * wp.float64(p[0]) - less[2] * wp.float64(p[1])
            phase = float(wavenumber * o)
            found += wp.vec2d(wp.float64(wp.cos(phase)), wp.float64(wp.sin(phase)))
        phasor_out[group] = found

    return look_rays, look_moments, look_phasors
