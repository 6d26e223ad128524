// Interpolation in one cell of a uniform cubic grid, for all lanes of a packet.
#ifndef CELL_H
#define CELL_H

#include "lanes.h"
#include "types.h"

// Potential and slopes per cell along the local axes.
typedef struct {
    reals value;
    reals first;
    reals second;
    reals third;
#if CUBES
    reals off, off_slope;  // bounds of the errors of the value, and of a slope [1/m], against the spline
#endif
} Local;

// The four weights of the coefficients and of their slopes at fractions u of a cell.
typedef struct {
    reals value[4];
    reals slope[4];
} Weights;

static inline Weights weights_of(reals u)
{
    const reals v = R(1.0) - u;
    const real sixth = R(1.0 / 6.0);
    const reals uu = u * u, vv = v * v;
    Weights w;
    w.value[0] = sixth * v * vv;
    w.value[1] = sixth * (R(4.0) + uu * (R(3.0) * u - R(6.0)));
    w.value[2] = sixth * (R(4.0) + vv * (R(3.0) * v - R(6.0)));
    w.value[3] = sixth * u * uu;
    w.slope[0] = R(-0.5) * vv;
    w.slope[1] = u * (R(1.5) * u - R(2.0));
    w.slope[2] = -v * (R(1.5) * v - R(2.0));
    w.slope[3] = R(0.5) * uu;
    return w;
}

// The weights at the position of each lane in its cell, along the local axes.
typedef struct {
    Weights u, v, w;
} Fraction;

static inline Fraction fraction_of(reals u, reals v, reals w)
{
    const Fraction at = {weights_of(u), weights_of(v), weights_of(w)};
    return at;
}

#if GEOMETRY == VOLUME

// Potential and slopes from the coefficients around one cell, at every lane's fractions.
static inline Local in_cell(__global const real *coefficients, int node, const Field *field, const Fraction *at)
{
    Local out = {(reals)R(0.0), (reals)R(0.0), (reals)R(0.0), (reals)R(0.0)};
#pragma unroll
    for (int i = 0; i < 4; i++) {
        reals sheet = (reals)R(0.0), bend = (reals)R(0.0), tilt = (reals)R(0.0);
#pragma unroll
        for (int j = 0; j < 4; j++) {
            const real4 row = vload4(0, coefficients + node + i * field->pitch[0] + j * field->pitch[1]);
            const real c0 = row.x, c1 = row.y, c2 = row.z, c3 = row.w;
            const reals along = at->w.value[0] * c0 + at->w.value[1] * c1 + at->w.value[2] * c2 + at->w.value[3] * c3;
            const reals climb = at->w.slope[0] * c0 + at->w.slope[1] * c1 + at->w.slope[2] * c2 + at->w.slope[3] * c3;
            sheet += at->v.value[j] * along;
            bend += at->v.slope[j] * along;
            tilt += at->v.value[j] * climb;
        }
        out.value += at->u.value[i] * sheet;
        out.first += at->u.slope[i] * sheet;
        out.second += at->u.value[i] * bend;
        out.third += at->u.value[i] * tilt;
    }
    return out;
}

#else

static inline Local in_cell(__global const real *coefficients, int node, const Field *field, const Fraction *at)
{
    Local out = {(reals)R(0.0), (reals)R(0.0), (reals)R(0.0), (reals)R(0.0)};
#pragma unroll
    for (int i = 0; i < 4; i++) {
        const real4 row = vload4(0, coefficients + node + i * field->pitch[0]);
        const real c0 = row.x, c1 = row.y, c2 = row.z, c3 = row.w;
        const reals along = at->v.value[0] * c0 + at->v.value[1] * c1 + at->v.value[2] * c2 + at->v.value[3] * c3;
        const reals climb = at->v.slope[0] * c0 + at->v.slope[1] * c1 + at->v.slope[2] * c2 + at->v.slope[3] * c3;
        out.value += at->u.value[i] * along;
        out.first += at->u.slope[i] * along;
        out.second += at->u.value[i] * climb;
    }
    return out;
}

#endif

// The cell and the fraction in it. On a GPU an addition rounds to whole numbers, because conversions are slow there.
#define ROUNDING 12582912.0f  // 1.5 * 2^23: a float next to it has no fraction

static inline ints cells_of(reals place, int last, reals *fraction)
{
#if LANES == 1 && !REAL_IS_DOUBLE
    const float whole = fmin(fmax((place - 0.5f + ROUNDING) - ROUNDING, 0.0f), (float)last);
    *fraction = place - whole;
    return as_int(whole + ROUNDING) - as_int(ROUNDING);
#else
    const ints cell = clamp(TO_INTS(floor(place)), (ints)0, (ints)last);
    *fraction = place - TO_REALS(cell);
    return cell;
#endif
}

#endif
