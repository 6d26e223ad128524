"""The Warp kernel of collimated rays along z through a volume: one lookup a ray in projection_tables.py's."""

import warp as wp

from ....status import RayStatus
from ..library import KernelLibrary, built_once
from ..types import takes
from .grid import build_weights
from .outputs import build_write_outputs


@built_once
def build_projection_kernel(library: KernelLibrary, with_ends: bool):
    """Build the kernel; `coefficients` holds, for each (x, y) of the splines, A, D and then EXTRAS.

    Without ends it makes no positions, arc lengths and errors, and looks up half as much.
    """
    t = library.types
    real, Arrival = t.real, t.Arrival
    value_weights, slope_weights = build_weights(library, "cubic")
    vec2, vec8 = t.vec2, wp.types.vector(8, real)
    write_outputs = build_write_outputs(library)
    ok = int(RayStatus.OK)

    @wp.kernel(module="unique", enable_backward=False)
    @takes("trace_projection", library.precision)
    def trace_projection(
        coefficients,
        cells_x,
        cells_y,
        origin_x,
        origin_y,
        rate_x,
        rate_y,
        ambient,
        sign,
        first_plane,
        length,
        flight,
        wanted,
        first_ray,
        position_in,
        outputs,
    ):
        ray = wp.tid() + first_ray
        p = position_in[ray]
        place_x = (p[0] - origin_x) * rate_x
        place_y = (p[1] - origin_y) * rate_y
        i = wp.clamp(int(place_x), 0, cells_x - 1)
        j = wp.clamp(int(place_y), 0, cells_y - 1)
        u = real(place_x - wp.float64(i))
        v = real(place_y - wp.float64(j))
        wx = value_weights(u)
        sx = slope_weights(u)
        wy = value_weights(v)
        sy = slope_weights(v)

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
        arrival = Arrival()
        arrival.direction = wp.vec3d(px / index, py / index, sign * w / index)
        arrival.optical_path = ambient * straight + opd
        arrival.opd = opd
        arrival.status = int(ok)
        error = wp.float64(0.0)
        if wp.static(with_ends):
            x = p[0] + (wp.float64(first_x[1]) * rate_x + wp.float64(extra[4])) + flight * px / w
            y = p[1] + (wp.float64(first_y[1]) * rate_y + wp.float64(extra[5])) + flight * py / w
            arrival.position = wp.vec3d(x, y, first_plane + sign * (length + flight))
            arrival.arc_length = straight + wp.float64(extra[1]) + obliquity
            error = wp.abs(wp.float64(extra[7]))
        write_outputs(outputs, wanted, ray, arrival, error, 1, 1)

    return trace_projection
