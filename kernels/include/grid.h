// The optical potential on a uniform grid. The interpolants are those of medium/spline.py.
//
// Each row of coefficients along the last axis is one vector load, and all sums are of vectors until the end: a single
// lookup fills the lanes of a CPU, however far apart the rays of a work-group are.
#ifndef GRID_H
#define GRID_H

#include "constants.h"
#include "types.h"

#if INTERPOLATION == LINEAR
#define SUPPORT 2
#define STRIDE 1
typedef real2 row_t;
static inline row_t load_row(size_t at, __global const real *p) { return vload2(0, p + at); }
#else
#define SUPPORT 4
#define STRIDE (INTERPOLATION == MONOTONE ? 2 : 1)
typedef real4 row_t;
static inline row_t load_row(size_t at, __global const real *p) { return vload4(0, p + at); }
#endif

#define ROW_ENTRY(row, k) (((const real *)&(row))[k])

// Weights of the coefficients at fraction u of a cell.
static inline row_t value_weights(real u)
{
    const real v = R(1.0) - u;
#if INTERPOLATION == LINEAR
    return (row_t)(v, u);
#elif INTERPOLATION == MONOTONE
    return (row_t)((R(1.0) + R(2.0) * u) * v * v, u * v * v, u * u * (R(3.0) - R(2.0) * u), -u * u * v);
#else
    const real sixth = R(1.0 / 6.0);
    return (row_t)(
        sixth * v * v * v,
        sixth * (R(4.0) + u * u * (R(3.0) * u - R(6.0))),
        sixth * (R(4.0) + v * v * (R(3.0) * v - R(6.0))),
        sixth * u * u * u);
#endif
}

// Slopes of these weights.
static inline row_t slope_weights(real u)
{
    const real v = R(1.0) - u;
#if INTERPOLATION == LINEAR
    return (row_t)(R(-1.0), R(1.0));
#elif INTERPOLATION == MONOTONE
    return (row_t)(
        R(-6.0) * u * v, v * (R(1.0) - R(3.0) * u), R(6.0) * u * v, u * (R(3.0) * u - R(2.0)));
#else
    return (row_t)(R(-0.5) * v * v, u * (R(1.5) * u - R(2.0)), -v * (R(1.5) * v - R(2.0)), R(0.5) * u * u);
#endif
}

// Clamped cell along one axis, and the fraction in it, which may leave [0, 1] at the box's edge.
static inline int split(real place, int base, int last, real *fraction)
{
    const int whole = (int)place;
    const int shift = whole - (place < (real)whole);  // the floor; the function floor takes several times as long
    const int cell = clamp(base + shift, 0, last);
    *fraction = place - (real)(cell - base);
    return cell;
}

static inline real radius_of(real3 frac)
{
    return sqrt(frac.x * frac.x + frac.y * frac.y);
}

#if GEOMETRY == VOLUME

// Value and slopes per cell at fraction (u, v, w) of a cell.
static inline real4 volume_sample(const Field *field, const Arrays *arrays, int3 cell, real u, real v, real w)
{
    const row_t wa = value_weights(u), sa = slope_weights(u);
    const row_t wb = value_weights(v), sb = slope_weights(v);
    const row_t wc = value_weights(w), sc = slope_weights(w);
    const int start = (cell.x * field->pitch[0] + cell.y * field->pitch[1] + cell.z) * STRIDE;
    row_t total = (row_t)R(0.0), first = (row_t)R(0.0), second = (row_t)R(0.0);
#pragma unroll
    for (int i = 0; i < SUPPORT; i++) {
        row_t sheet = (row_t)R(0.0), bend = (row_t)R(0.0);
#pragma unroll
        for (int j = 0; j < SUPPORT; j++) {
            const row_t row = load_row(start + i * field->pitch[0] + j * field->pitch[1], arrays->coefficients);
            sheet += ROW_ENTRY(wb, j) * row;
            bend += ROW_ENTRY(sb, j) * row;
        }
        total += ROW_ENTRY(wa, i) * sheet;
        first += ROW_ENTRY(sa, i) * sheet;
        second += ROW_ENTRY(wa, i) * bend;
    }
    return (real4)(dot(wc, total), dot(wc, first), dot(wc, second), dot(sc, total));
}

// Potential s = (n^2 - a^2) / 2 and its gradient [1/m].
static real4 sample(const Field *field, const Arrays *arrays, int3 cell, real3 frac, int current_cell)
{
    real u, v, w;
    const int a = split(frac.x, cell.x, field->row[0], &u);
    const int b = split(frac.y, cell.y, field->row[1], &v);
    const int c = split(frac.z, cell.z, field->row[2], &w);
    const real4 s = volume_sample(field, arrays, (int3)(a, b, c), u, v, w);
    const real3 rate = VECTOR(field->inverse_spacing);
    return (real4)(s.x, s.yzw * rate);
}

static inline int table_entry(const Field *field, int3 cell, real3 frac)
{
    real rest;
    const int a = split(frac.x, cell.x, field->row[0], &rest);
    const int b = split(frac.y, cell.y, field->row[1], &rest);
    const int c = split(frac.z, cell.z, field->row[2], &rest);
    return (a * (field->row[1] + 1) + b) * (field->row[2] + 1) + c;
}

#else

// Value and slopes per cell at fraction (u, v) of cell (a, b) of a two-axis grid.
static inline real3 plane_sample(const Field *field, const Arrays *arrays, int a, real u, int b, real v)
{
    const row_t wa = value_weights(u), sa = slope_weights(u);
    const row_t wb = value_weights(v), sb = slope_weights(v);
    const int start = (a * field->pitch[0] + b) * STRIDE;
    row_t total = (row_t)R(0.0), first = (row_t)R(0.0);
#pragma unroll
    for (int i = 0; i < SUPPORT; i++) {
        const row_t row = load_row(start + i * field->pitch[0], arrays->coefficients);
        total += ROW_ENTRY(wa, i) * row;
        first += ROW_ENTRY(sa, i) * row;
    }
    return (real3)(dot(wb, total), dot(wb, first), dot(sb, total));
}

// Potential s = (n^2 - a^2) / 2 and its gradient [1/m].
static real4 sample(const Field *field, const Arrays *arrays, int3 cell, real3 frac, int current_cell)
{
    real u, v;
#if GEOMETRY == PLANAR
    const int a = split(frac.y, cell.y, field->row[0], &u);
    const int b = split(frac.z, cell.z, field->row[1], &v);
    const real3 s = plane_sample(field, arrays, a, u, b, v);
    return (real4)(s.x, R(0.0), s.y * field->inverse_spacing[1], s.z * field->inverse_spacing[2]);
#else
    const real radius = radius_of(frac);
    const int a = split(radius, 0, field->row[0], &u);
    const int b = split(frac.z, cell.z, field->row[1], &v);
    const real3 s = plane_sample(field, arrays, a, u, b, v);
    real outward = R(0.0);
    if (INTERPOLATION == LINEAR) {
        outward = s.y * field->inverse_spacing[0] / greater(radius, AXIS_CORE);
    } else if (radius > R(0.0)) {
        outward = s.y * field->inverse_spacing[0] / radius;
    }
    return (real4)(s.x, outward * frac.x, outward * frac.y, s.z * field->inverse_spacing[2]);
#endif
}

static inline int table_entry(const Field *field, int3 cell, real3 frac)
{
    real rest;
#if GEOMETRY == PLANAR
    const int a = split(frac.y, cell.y, field->row[0], &rest);
#else
    const int a = split(radius_of(frac), 0, field->row[0], &rest);
#endif
    const int b = split(frac.z, cell.z, field->row[1], &rest);
    return a * (field->row[1] + 1) + b;
}

#endif

// Step length of eq 5 in the cell of the point [m].
static inline real paper_step(const Field *field, const Arrays *arrays, int3 cell, real3 frac, int current_cell)
{
    return arrays->paper_step[table_entry(field, cell, frac)];
}

// Only a mesh needs the cell of the last lookup.
static inline int find_current_cell(const Field *field, const Arrays *arrays, real3 frac, int current_cell)
{
    return current_cell;
}

#endif
