// Collimated rays along z through a volume, by the tables of aerokernels/tracing/projection_tables.py: one lookup a
// ray.
//
// coefficients: for each (x, y) of the splines eight reals, EXTRAS, after two, A and D. first_plane and length [m]: where
// along z the tables begin and how far they reach; flight [m]: from there to the stop. Outputs that are not
// wanted are left alone.

#include "arguments.h"
#include "grid.h"
#include "outputs.h"
#include "ray_status.h"

__kernel void trace_projection(TRACE_PROJECTION_ARGUMENTS)
{
    const int ray = (int)get_global_id(0) + first_ray;
    if (ray >= ray_count) {
        return;
    }
    const RayOutputs outputs = RAY_OUTPUTS;
    const double3 p = vload3(ray, position_in);
    const double place_x = (p.x - origin_x) * rate_x;
    const double place_y = (p.y - origin_y) * rate_y;
    const int i = clamp((int)place_x, 0, cells_x - 1);
    const int j = clamp((int)place_y, 0, cells_y - 1);
    const real u = (real)(place_x - (double)i);
    const real v = (real)(place_y - (double)j);
    const row_t wx = value_weights(u), sx = slope_weights(u), wy = value_weights(v), sy = slope_weights(v);

    real2 first = (real2)R(0.0), first_x = first, first_y = first;  // A and D, and their slopes per cell
    real8 extra = (real8)R(0.0);
#pragma unroll
    for (int a = 0; a < 4; a++) {
        __global const real *row = coefficients + 10 * ((i + a) * (cells_y + 3) + j);
        real2 sheet = (real2)R(0.0), bend = sheet;
        real8 more = (real8)R(0.0);
#pragma unroll
        for (int b = 0; b < 4; b++) {
            const real2 pair = vload2(0, row + 10 * b);
            sheet += ROW_ENTRY(wy, b) * pair;
            bend += ROW_ENTRY(sy, b) * pair;
            more += ROW_ENTRY(wy, b) * vload8(0, row + 10 * b + 2);
        }
        first += ROW_ENTRY(wx, a) * sheet;
        first_x += ROW_ENTRY(sx, a) * sheet;
        first_y += ROW_ENTRY(wx, a) * bend;
        extra += ROW_ENTRY(wx, a) * more;
    }

    // EXTRAS: optical path, arc, momentum, shift, potential, error
    const double opd_box = (double)first.s0 + (double)extra.s0;
    const double px = (double)first_x.s0 * rate_x + (double)extra.s2;
    const double py = (double)first_y.s0 * rate_y + (double)extra.s3;
    const double across = px * px + py * py;
    const double square = ambient * ambient + 2.0 * (double)extra.s6;
    const double index = sqrt(square);
    const double w = sqrt(square - across);
    const double obliquity = flight * across / (w * (index + w));  // how much further it is to fly than along z
    const double before = (first_plane - p.z) * sign;
    const double straight = before + length + flight;
    const double opd = opd_box + ambient * obliquity;
    Arrival arrival = {0};
    arrival.direction = (double3)(px / index, py / index, sign * w / index);
    arrival.optical_path = ambient * straight + opd;
    arrival.opd = opd;
    arrival.status = RAY_OK;
#if WITH_ENDS
    const double x = p.x + ((double)first_x.s1 * rate_x + (double)extra.s4) + flight * px / w;
    const double y = p.y + ((double)first_y.s1 * rate_y + (double)extra.s5) + flight * py / w;
    arrival.position = (double3)(x, y, first_plane + sign * (length + flight));
    arrival.arc_length = straight + (double)extra.s1 + obliquity;
#endif
    write_outputs(&outputs, wanted, ray, &arrival, WITH_ENDS ? fabs((double)extra.s7) : 0.0, 1, 1);
}
