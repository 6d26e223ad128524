// The body: how far its wall is, where a ray leaves it, and how far the way ahead is clear.
#ifndef WALL_H
#define WALL_H

#include "constants.h"
#include "types.h"

// Signed distance to the body at a point in x, y, z [m], negative inside it.
static inline real wall_distance(const Field *field, const Arrays *arrays, real3 p)
{
    const real across = GEOMETRY == AXISYMMETRIC ? sqrt(p.x * p.x + p.y * p.y) : p.y;
    const real row = (across - field->wall_origin[0]) * field->wall_rate[0];
    const real column = (p.z - field->wall_origin[1]) * field->wall_rate[1];
    // Towards zero is downwards here, and costs less than floor().
    const int i = min((int)greater(row, R(0.0)), field->wall_count[0] - 2);
    const int j = min((int)greater(column, R(0.0)), field->wall_count[1] - 2);
    const real u = bounded(row - (real)i, R(0.0), R(1.0));
    const real v = bounded(column - (real)j, R(0.0), R(1.0));
    __global const real *at = arrays->wall + i * field->wall_count[1] + j;
    __global const real *next = at + field->wall_count[1];
    const real near = (R(1.0) - v) * at[0] + v * at[1];
    const real far = (R(1.0) - v) * next[0] + v * next[1];
    return (R(1.0) - u) * near + u * far;
}

static inline real wall_beside(const Field *field, const Arrays *arrays, double3 p, double3 d, double along)
{
    return wall_distance(field, arrays, convert_real3(p + along * d));
}

// Distance at which a ray is out of the body; `solid` if it is not, up to `last`.
static inline double way_out(
    const Field *field, const Arrays *arrays, double3 p, double3 d, double first, double last, int *solid)
{
    const double least = 1.0e-4 / (double)field->wall_rate[1];
    double along = first;
    *solid = 1;
    for (int march = 0; *solid && march < WALL_MARCH_LIMIT && along <= last; march++) {
        const real gap = wall_beside(field, arrays, p, d, along);
        *solid = gap < R(0.0);
        if (*solid) {
            along += greater64(-(double)gap, least);
        }
    }
    return along;
}

// Whether a straight ray keeps away from the body between two distances, once it has left its wall.
static inline int stays_clear(
    const Field *field, const Arrays *arrays, double3 p, double3 d, double enter, double far)
{
    const double least = 1.0 / (double)greater(field->wall_rate[0], field->wall_rate[1]);
    double along = enter + 2.0 * least;
    // Only where the body may be.
    const double low = (double)field->wall_span[0], high = (double)field->wall_span[1];
    if (d.z != 0.0) {
        const double one = (low - p.z) / d.z, other = (high - p.z) / d.z;
        along = greater64(along, lesser64(one, other));
        far = lesser64(far, greater64(one, other));
    } else if (p.z < low || p.z > high) {
        far = along;
    }
    int clear = 1;
    for (int march = 0; clear && along < far; march++) {
        const double gap = (double)wall_beside(field, arrays, p, d, along);
        clear = gap > 0.1 * least && march < WALL_MARCH_LIMIT;
        along += gap;
    }
    return clear;
}

static inline real wall_at(const Field *field, const Arrays *arrays, const Bounds *bounds, int3 cell, real3 frac)
{
    const double3 place = convert_double3(cell) + convert_double3(frac);
    return wall_distance(field, arrays, convert_real3(VECTOR64(bounds->origin) + place * VECTOR64(bounds->spacing)));
}

// The step h, cut to where the parabola ahead is known to be free of the body.
static inline real clear_way(
    const Field *field,
    const Arrays *arrays,
    const Bounds *bounds,
    int3 cell,
    real3 frac,
    real3 rate,
    real3 total,
    real3 force,
    real gap,
    real h)
{
    const real speed = size3(total);
    // On the wall itself nothing is known: go one node of the distance's grid.
    const real least = R(1.0) / greater(field->wall_rate[0], field->wall_rate[1]);
    real clear = greater(gap, least) / speed;
    for (int march = 0; clear < h && march < CLEAR_MARCH_LIMIT; march++) {
        const real3 at = frac + (clear * total + (R(0.5) * clear * clear) * force) * rate;
        const real ahead = wall_at(field, arrays, bounds, cell, at);
        if (ahead < R(0.1) * least) {
            march = CLEAR_MARCH_LIMIT;
        }
        clear += greater(ahead, R(0.0)) / speed;
    }
    return lesser(h, clear);
}

#endif
