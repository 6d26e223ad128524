// The potential on a uniform cubic grid for a packet of rays.
//
// Neighbours mostly lie in one cell: its coefficients are then read once and spread over the lanes. A packet that lies in
// a few cells is served cell by cell; lanes that are left over after MOST_CELLS look up on their own.
#ifndef PACKET_H
#define PACKET_H

#include "grid.h"
#include "lanes.h"

#define MOST_CELLS 4

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

// Potential and slopes per cell along the local axes.
typedef struct {
    reals value;
    reals first;
    reals second;
    reals third;
} Local;

static inline ints cells_of(reals place, int last, reals *fraction)
{
    const ints cell = clamp(TO_INTS(floor(place)), (ints)0, (ints)last);
    *fraction = place - TO_REALS(cell);
    return cell;
}

#if GEOMETRY == VOLUME

// What the coefficients around one cell say at every lane's fractions.
static inline Local in_cell(__global const real *at, const Field *field, const Weights *a, const Weights *b, const Weights *c)
{
    Local out = {(reals)R(0.0), (reals)R(0.0), (reals)R(0.0), (reals)R(0.0)};
#pragma unroll
    for (int i = 0; i < 4; i++) {
        reals sheet = (reals)R(0.0), bend = (reals)R(0.0), tilt = (reals)R(0.0);
#pragma unroll
        for (int j = 0; j < 4; j++) {
            __global const real *row = at + i * field->pitch[0] + j * field->pitch[1];
            const real c0 = row[0], c1 = row[1], c2 = row[2], c3 = row[3];
            const reals along = c->value[0] * c0 + c->value[1] * c1 + c->value[2] * c2 + c->value[3] * c3;
            const reals climb = c->slope[0] * c0 + c->slope[1] * c1 + c->slope[2] * c2 + c->slope[3] * c3;
            sheet += b->value[j] * along;
            bend += b->slope[j] * along;
            tilt += b->value[j] * climb;
        }
        out.value += a->value[i] * sheet;
        out.first += a->slope[i] * sheet;
        out.second += a->value[i] * bend;
        out.third += a->value[i] * tilt;
    }
    return out;
}

#else

static inline Local in_cell(__global const real *at, const Field *field, const Weights *a, const Weights *b, const Weights *c)
{
    Local out = {(reals)R(0.0), (reals)R(0.0), (reals)R(0.0), (reals)R(0.0)};
#pragma unroll
    for (int i = 0; i < 4; i++) {
        __global const real *row = at + i * field->pitch[0];
        const real c0 = row[0], c1 = row[1], c2 = row[2], c3 = row[3];
        const reals along = b->value[0] * c0 + b->value[1] * c1 + b->value[2] * c2 + b->value[3] * c3;
        const reals climb = b->slope[0] * c0 + b->slope[1] * c1 + b->slope[2] * c2 + b->slope[3] * c3;
        out.value += a->value[i] * along;
        out.first += a->slope[i] * along;
        out.second += a->value[i] * climb;
    }
    return out;
}

#endif

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
    const ints j = cells_of(z, field->row[1], &v);
    const ints start = i * field->pitch[0] + j;
#endif
    const Weights a = weights_of(u), b = weights_of(v), c = weights_of(w);
    Local inner;
#if LANES == 1
    inner = in_cell(arrays->coefficients + start, field, &a, &b, &c);
#else
    int here = start.s0;
    ints found = start == here;
    inner = in_cell(arrays->coefficients + here, field, &a, &b, &c);
    for (int trial = 1; !all(found) && trial < MOST_CELLS; trial++) {
        int lane = 0;
        while (INT_AT(found, lane)) {
            lane++;
        }
        here = INT_AT(start, lane);
        const ints now = start == here;
        const Local other = in_cell(arrays->coefficients + here, field, &a, &b, &c);
        inner.value = CHOOSE(inner.value, other.value, now);
        inner.first = CHOOSE(inner.first, other.first, now);
        inner.second = CHOOSE(inner.second, other.second, now);
        inner.third = CHOOSE(inner.third, other.third, now);
        found |= now;
    }
    if (!all(found)) {
        for (int lane = 0; lane < LANES; lane++) {
            if (!INT_AT(found, lane)) {
#if GEOMETRY == VOLUME
                const int3 cell = (int3)(INT_AT(i, lane), INT_AT(j, lane), INT_AT(k, lane));
                const real4 alone =
                    volume_sample(field, arrays, cell, REAL_AT(u, lane), REAL_AT(v, lane), REAL_AT(w, lane));
                REAL_AT(inner.third, lane) = alone.w;
#else
                const real3 alone = plane_sample(
                    field, arrays, INT_AT(i, lane), REAL_AT(u, lane), INT_AT(j, lane), REAL_AT(v, lane));
#endif
                REAL_AT(inner.value, lane) = alone.x;
                REAL_AT(inner.first, lane) = alone.y;
                REAL_AT(inner.second, lane) = alone.z;
            }
        }
    }
#endif

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

#endif
