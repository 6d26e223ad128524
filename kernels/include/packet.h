// The potential on a uniform cubic grid for a packet of rays.
//
// Neighbours mostly lie in one cell: its coefficients are then read once and spread over the lanes. A packet that lies in
// a few cells is served cell by cell; lanes that are left over after MOST_CELLS look up on their own.
#ifndef PACKET_H
#define PACKET_H

#include "grid.h"
#include "lanes.h"

#define MOST_CELLS 4

// Potential and slopes per cell along the local axes.
typedef struct {
    reals value;
    reals first;
    reals second;
    reals third;
} Local;

#if GEOMETRY == VOLUME || !PACKED
// Four neighbours along the last axis. Where they are PACKED, each node's entry holds them all, so that a GPU gets them by
// one load of 16 bytes.
static inline real4 row_at(__global const real *coefficients, int node)
{
#if PACKED
    return ((__global const real4 *)coefficients)[node];
#else
    return vload4(0, coefficients + node);
#endif
}

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

// Where in a cell a packet is.
typedef struct {
    Weights u, v, w;
} Fraction;

static inline Fraction fraction_of(reals u, reals v, reals w)
{
    const Fraction at = {weights_of(u), weights_of(v), weights_of(w)};
    return at;
}

#endif

#if GEOMETRY == VOLUME

// What the coefficients around one cell say at every lane's fractions.
static inline Local in_cell(__global const real *coefficients, int node, const Field *field, const Fraction *at)
{
    Local out = {(reals)R(0.0), (reals)R(0.0), (reals)R(0.0), (reals)R(0.0)};
#pragma unroll
    for (int i = 0; i < 4; i++) {
        reals sheet = (reals)R(0.0), bend = (reals)R(0.0), tilt = (reals)R(0.0);
#pragma unroll
        for (int j = 0; j < 4; j++) {
            const real4 row = row_at(coefficients, node + i * field->pitch[0] + j * field->pitch[1]);
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

#elif !PACKED

static inline Local in_cell(__global const real *coefficients, int node, const Field *field, const Fraction *at)
{
    Local out = {(reals)R(0.0), (reals)R(0.0), (reals)R(0.0), (reals)R(0.0)};
#pragma unroll
    for (int i = 0; i < 4; i++) {
        const real4 row = row_at(coefficients, node + i * field->pitch[0]);
        const real c0 = row.x, c1 = row.y, c2 = row.z, c3 = row.w;
        const reals along = at->v.value[0] * c0 + at->v.value[1] * c1 + at->v.value[2] * c2 + at->v.value[3] * c3;
        const reals climb = at->v.slope[0] * c0 + at->v.slope[1] * c1 + at->v.slope[2] * c2 + at->v.slope[3] * c3;
        out.value += at->u.value[i] * along;
        out.first += at->u.slope[i] * along;
        out.second += at->u.value[i] * climb;
    }
    return out;
}

#else

// Where they are PACKED, a node's entry holds the 16 coefficients of the polynomial in the cell behind it: those of the
// powers of the second fraction, for each power of the first.
typedef struct {
    reals u, v;
} Fraction;

static inline Fraction fraction_of(reals u, reals v, reals w)
{
    const Fraction at = {u, v};
    return at;
}

// A cubic polynomial and its slope.
#define CUBIC_AT(value, slope, x, c0, c1, c2, c3) \
    {                                             \
        value = (c3) * x + (c2);                  \
        slope = (c3) * x + value;                 \
        value = value * x + (c1);                 \
        slope = slope * x + value;                \
        value = value * x + (c0);                 \
    }

static inline Local in_cell(__global const real *coefficients, int node, const Field *field, const Fraction *at)
{
    reals rows[4], slopes[4];
#pragma unroll
    for (int i = 0; i < 4; i++) {
        const real4 row = ((__global const real4 *)coefficients)[4 * node + i];
        const reals c0 = (reals)row.x, c1 = (reals)row.y, c2 = (reals)row.z, c3 = (reals)row.w;
        CUBIC_AT(rows[i], slopes[i], at->v, c0, c1, c2, c3)
    }
    Local out;
    CUBIC_AT(out.value, out.first, at->u, rows[0], rows[1], rows[2], rows[3])
    out.second = ((slopes[3] * at->u + slopes[2]) * at->u + slopes[1]) * at->u + slopes[0];
    out.third = (reals)R(0.0);
    return out;
}

// The same where every lane has a cell of its own.
static inline Local in_cells_of_their_own(__global const real *coefficients, ints node, const Fraction *at)
{
    reals rows[4], slopes[4];
#if LANES > 1
#pragma unroll
    for (int i = 0; i < 4; i++) {
        reals c[4];
        for (int lane = 0; lane < LANES; lane++) {
            const real4 row = ((__global const real4 *)coefficients)[4 * INT_AT(node, lane) + i];
            REAL_AT(c[0], lane) = row.x;
            REAL_AT(c[1], lane) = row.y;
            REAL_AT(c[2], lane) = row.z;
            REAL_AT(c[3], lane) = row.w;
        }
        CUBIC_AT(rows[i], slopes[i], at->v, c[0], c[1], c[2], c[3])
    }
#endif
    Local out;
    CUBIC_AT(out.value, out.first, at->u, rows[0], rows[1], rows[2], rows[3])
    out.second = ((slopes[3] * at->u + slopes[2]) * at->u + slopes[1]) * at->u + slopes[0];
    out.third = (reals)R(0.0);
    return out;
}

#endif

// The cell and the fraction in it. On a GPU whole numbers are found by an addition that rounds: to convert is slow there.
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

// What the coefficients say where each lane is: in the cell of `start`, at fractions u, v, w.
static inline Local
look_up(const Field *field, const Arrays *arrays, ints start, ints i, ints j, ints k, reals u, reals v, reals w)
{
    const Fraction at = fraction_of(u, v, w);
#if LANES == 1
    return in_cell(arrays->coefficients, start, field, &at);
#else
    int here = start.s0;
    ints found = start == here;
    Local inner = in_cell(arrays->coefficients, here, field, &at);
    for (int trial = 1; !all(found) && trial < MOST_CELLS; trial++) {
        int lane = 0;
        while (INT_AT(found, lane)) {
            lane++;
        }
        here = INT_AT(start, lane);
        const ints now = start == here;
        const Local other = in_cell(arrays->coefficients, here, field, &at);
        inner.value = CHOOSE(inner.value, other.value, now);
        inner.first = CHOOSE(inner.first, other.first, now);
        inner.second = CHOOSE(inner.second, other.second, now);
        inner.third = CHOOSE(inner.third, other.third, now);
        found |= now;
    }
#if GEOMETRY != VOLUME && PACKED
    if (!all(found)) {
        inner = in_cells_of_their_own(arrays->coefficients, start, &at);
    }
#else
    for (int lane = 0; !all(found) && lane < LANES; lane++) {
        if (!INT_AT(found, lane)) {
#if GEOMETRY == VOLUME
            const int3 cell = (int3)(INT_AT(i, lane), INT_AT(j, lane), INT_AT(k, lane));
            const real4 alone =
                volume_sample(field, arrays, cell, REAL_AT(u, lane), REAL_AT(v, lane), REAL_AT(w, lane));
            REAL_AT(inner.third, lane) = alone.w;
#else
            const real3 alone =
                plane_sample(field, arrays, INT_AT(i, lane), REAL_AT(u, lane), INT_AT(j, lane), REAL_AT(v, lane));
#endif
            REAL_AT(inner.value, lane) = alone.x;
            REAL_AT(inner.first, lane) = alone.y;
            REAL_AT(inner.second, lane) = alone.z;
        }
    }
#endif
    return inner;
#endif
}

// Potential and its gradient in x, y, z [1/m] at places in cells from the grid's first node (x, y from the axis).
typedef struct {
    reals value;
    reals x;
    reals y;
    reals z;
} Potential;

static inline Potential sample_packet(const Field *field, const Arrays *arrays, reals x, reals y, reals z)
{
    reals u, v, w = (reals)R(0.0);
#if GEOMETRY == VOLUME
    const ints i = cells_of(x, field->row[0], &u);
    const ints j = cells_of(y, field->row[1], &v);
    const ints k = cells_of(z, field->row[2], &w);
    const ints start = i * field->pitch[0] + j * field->pitch[1] + k;
#else
#if GEOMETRY == AXISYMMETRIC
    const reals radius = SWIFT_ROOT(x * x + y * y);
    const ints i = cells_of(radius, field->row[0], &u);
#else
    const ints i = cells_of(y, field->row[0], &u);
#endif
    const ints j = cells_of(z, field->row[1], &v), k = j;
    const ints start = i * field->pitch[0] + j;
#endif
    const Local inner = look_up(field, arrays, start, i, j, k, u, v, w);
    Potential out;
    out.value = inner.value;
#if GEOMETRY == VOLUME
    out.x = inner.first * field->inverse_spacing[0];
    out.y = inner.second * field->inverse_spacing[1];
    out.z = inner.third * field->inverse_spacing[2];
#elif GEOMETRY == PLANAR
    out.x = (reals)R(0.0);
    out.y = inner.first * field->inverse_spacing[1];
    out.z = inner.second * field->inverse_spacing[2];
#else
    // On the axis the slope along the radius is zero, and any finite divisor will do.
    const reals outward = inner.first * field->inverse_spacing[0] * SWIFT_INVERSE(max(radius, (reals)TINY));
    out.x = outward * x;
    out.y = outward * y;
    out.z = inner.second * field->inverse_spacing[2];
#endif
    return out;
}

// Whether a cell is asked for one sample before it is needed: on a GPU nothing else hides how long that takes.
#define AHEAD (GEOMETRY != VOLUME && PACKED && LANES == 1)

#if AHEAD

// The polynomial of a cell, and where the cell begins.
typedef struct {
    real4 rows[4];
    real first, second;
} CellAhead;

static inline CellAhead cell_ahead(const Field *field, const Arrays *arrays, real place, real along)
{
    CellAhead cell;
    real u, v;
#if GEOMETRY == AXISYMMETRIC
    place = fabs(place);
#endif
    const int i = cells_of(place, field->row[0], &u);
    const int j = cells_of(along, field->row[1], &v);
    const int node = i * field->pitch[0] + j;
#pragma unroll
    for (int k = 0; k < 4; k++) {
        cell.rows[k] = ((__global const real4 *)arrays->coefficients)[4 * node + k];
    }
    cell.first = place - u;
    cell.second = along - v;
    return cell;
}

// As sample_along, from a cell that is there.
static inline real sample_cell(const CellAhead *cell, real place, real along, real *climb)
{
#if GEOMETRY == AXISYMMETRIC
    const real u = fabs(place) - cell->first;
#else
    const real u = place - cell->first;
#endif
    const real v = along - cell->second;
    real rows[4], value;
#pragma unroll
    for (int i = 0; i < 4; i++) {
        const real4 c = cell->rows[i];
        rows[i] = ((c.w * v + c.z) * v + c.y) * v + c.x;
    }
    CUBIC_AT(value, *climb, u, rows[0], rows[1], rows[2], rows[3])
#if GEOMETRY == AXISYMMETRIC
    *climb = copysign(R(1.0), place) * *climb;
#endif
    return value;
}

#endif

#if GEOMETRY != VOLUME

// The potential, and by `climb` its slope per cell along the first axis, at a distance from the axis (or y) and along z,
// both in cells; on the far side of the axis the distance is negative.
static inline reals sample_along(const Field *field, const Arrays *arrays, reals place, reals along, reals *climb)
{
    reals u, v;
#if GEOMETRY == AXISYMMETRIC
    const ints i = cells_of(fabs(place), field->row[0], &u);
#else
    const ints i = cells_of(place, field->row[0], &u);
#endif
    const ints j = cells_of(along, field->row[1], &v);
    const Local inner = look_up(field, arrays, i * field->pitch[0] + j, i, j, j, u, v, (reals)R(0.0));
#if GEOMETRY == AXISYMMETRIC && LANES == 1 && !REAL_IS_DOUBLE
    *climb = as_float(as_int(inner.first) ^ (as_int(place) & (int)0x80000000));
#elif GEOMETRY == AXISYMMETRIC
    *climb = CHOOSE(inner.first, -inner.first, place < R(0.0));
#else
    *climb = inner.first;
#endif
    return inner.value;
}

#endif

#endif
