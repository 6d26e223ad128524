"""The Warp kernel of collimated rays along z through a volume: one lookup a ray in projection_tables.py's."""

import functools

import warp as wp

from ....result import OUTPUT_BITS
from ....status import RayStatus
from ..types import types
from .grid import build_weights


@functools.cache
def build_projection_kernel(precision: str, with_ends: bool):
    """Build the kernel; `coefficients` holds, for each (x, y) of the splines, A, D and then EXTRAS.

    Without ends it makes no positions, arc lengths and errors, and looks up half as much.
    """
    t = types(precision)
    real = t.real
    value, slope = build_weights(precision, "cubic")
    vec2, vec8 = t.vec2, wp.types.vector(8, real)
    ok = int(RayStatus.OK)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_projection(
        coefficients: wp.array(dtype=real),
        cells_x: int,
        cells_y: int,
        origin_x: wp.float64,
        origin_y: wp.float64,
        rate_x: wp.float64,
        rate_y: wp.float64,
        ambient: wp.float64,
        sign: wp.float64,
        first_plane: wp.float64,
        length: wp.float64,
        flight: wp.float64,
        outputs: int,
        first_ray: int,
        position_in: wp.array(dtype=wp.vec3d),
        position_out: wp.array(dtype=wp.vec3d),
        direction_out: wp.array(dtype=wp.vec3d),
        optical_path_out: wp.array(dtype=wp.float64),
        opd_out: wp.array(dtype=wp.float64),
        arc_length_out: wp.array(dtype=wp.float64),
        step_error_out: wp.array(dtype=wp.float64),
        step_count_out: wp.array(dtype=wp.int32),
        evaluation_count_out: wp.array(dtype=wp.int32),
        status_out: wp.array(dtype=wp.int32),
    ):
        ray = wp.tid() + first_ray
        p = position_in[ray]
        place_x = (p[0] - origin_x) * rate_x
        place_y = (p[1] - origin_y) * rate_y
        i = wp.clamp(int(place_x), 0, cells_x - 1)
        j = wp.clamp(int(place_y), 0, cells_y - 1)
        u = real(place_x - wp.float64(i))
        v = real(place_y - wp.float64(j))
        wx = value(u)
        sx = slope(u)
        wy = value(v)
        sy = slope(v)

        first = vec2(real(0.0), real(0.0))  # A and D
        first_x = vec2(real(0.0), real(0.0))  # their slopes per cell
        first_y = vec2(real(0.0), real(0.0))
        extra = vec8()
        for a in range(4):
            row = 10 * ((i + a) * (cells_y + 3) + j)
            sheet = vec2(real(0.0), real(0.0))
            bend = vec2(real(0.0), real(0.0))
            more = vec8()
            for b in range(4):
                pair = vec2(coefficients[row + 10 * b], coefficients[row + 10 * b + 1])
                sheet += wy[b] * pair
                bend += sy[b] * pair
                for k in range(8):
                    more[k] = more[k] + wy[b] * coefficients[row + 10 * b + 2 + k]
            first += wx[a] * sheet
            first_x += sx[a] * sheet
            first_y += wx[a] * bend
            extra += wx[a] * more

        # EXTRAS: optical path, arc, momentum, shift, potential, error
        opd_box = wp.float64(first[0]) + wp.float64(extra[0])
        px = wp.float64(first_x[0]) * rate_x + wp.float64(extra[2])
        py = wp.float64(first_y[0]) * rate_y + wp.float64(extra[3])
        across = px * px + py * py
        square = ambient * ambient + wp.float64(2.0) * wp.float64(extra[6])
        index = wp.sqrt(square)
        w = wp.sqrt(square - across)
        obliquity = flight * across / (w * (index + w))  # how much further it is to fly than along z
        before = (first_plane - p[2]) * sign
        straight = before + length + flight
        opd = opd_box + ambient * obliquity
        if wp.static(with_ends):
            if (outputs & wp.static(OUTPUT_BITS["position"])) != 0:
                qx = wp.float64(first_x[1]) * rate_x + wp.float64(extra[4])
                qy = wp.float64(first_y[1]) * rate_y + wp.float64(extra[5])
                position_out[ray] = wp.vec3d(
                    p[0] + qx + flight * px / w, p[1] + qy + flight * py / w, first_plane + sign * (length + flight)
                )
        if (outputs & wp.static(OUTPUT_BITS["direction"])) != 0:
            direction_out[ray] = wp.vec3d(px / index, py / index, sign * w / index)
        if (outputs & wp.static(OUTPUT_BITS["optical_path"])) != 0:
            optical_path_out[ray] = ambient * straight + opd
        if (outputs & wp.static(OUTPUT_BITS["opd"])) != 0:
            opd_out[ray] = opd
        if wp.static(with_ends):
            if (outputs & wp.static(OUTPUT_BITS["arc_length"])) != 0:
                arc_length_out[ray] = straight + wp.float64(extra[1]) + obliquity
        if wp.static(with_ends):
            if (outputs & wp.static(OUTPUT_BITS["step_error"])) != 0:
                step_error_out[ray] = wp.abs(wp.float64(extra[7]))
        if (outputs & wp.static(OUTPUT_BITS["step_count"])) != 0:
            step_count_out[ray] = 1
        if (outputs & wp.static(OUTPUT_BITS["evaluation_count"])) != 0:
            evaluation_count_out[ray] = 1
        status_out[ray] = ok

    return trace_projection
