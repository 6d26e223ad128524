// The potential on a uniform cubic grid for a packet of rays.
//
// Neighbouring rays are mostly in the same cell: its coefficients are then read once for all lanes. A packet in a few
// cells is interpolated cell by cell; the lanes that are left after MOST_CELLS cells are interpolated one by one.
#ifndef PACKET_H
#define PACKET_H

#include "cell.h"
#include "cubes.h"
#include "generated/grid.h"

#define MOST_CELLS 4

// Potential and slopes for each lane, in the cell whose coefficients begin at `start`, at fractions u, v, w.
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
    for (int lane = 0; !all(found) && lane < LANES; lane++) {
        if (!INT_AT(found, lane)) {
#if GEOMETRY == VOLUME
            const real4 alone = volume_sample(
                field, arrays, INT_AT(i, lane), REAL_AT(u, lane), INT_AT(j, lane), REAL_AT(v, lane),
                INT_AT(k, lane), REAL_AT(w, lane));
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
    return inner;
#endif
}

// Potential and its gradient in x, y, z [1/m].
typedef struct {
    reals value;
    reals x;
    reals y;
    reals z;
#if CUBES
    reals off, off_slope;
#endif
} Potential;

#if CUBES

// The entry at which the polynomial of a cube begins, and the place in the cube.
static inline ints cube_start(const Field *field, reals x, reals y, reals z, reals *u, reals *v, reals *w)
{
    const ints i = cube_of(x, field->row[0], u), j = cube_of(y, field->row[1], v), k = cube_of(z, field->row[2], w);
    const int cubes_y = field->row[1] / CUBE_SIDE + 1, cubes_z = field->row[2] / CUBE_SIDE + 1;
    return CUBE_ROW * ((i * cubes_y + j) * cubes_z + k);
}

#endif

// The potential at places in cells from the grid's first node (x, y from the axis).
static inline Potential sample_packet(const Field *field, const Arrays *arrays, reals x, reals y, reals z)
{
    reals u, v, w = (reals)R(0.0);
#if CUBES
    const Local inner = in_cubes(arrays, cube_start(field, x, y, z, &u, &v, &w), u, v, w);
#elif GEOMETRY == VOLUME
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
#if !CUBES
    const Local inner = look_up(field, arrays, start, i, j, k, u, v, w);
#endif
    Potential out;
    out.value = inner.value;
#if CUBES
    out.off = inner.off;
    out.off_slope = inner.off_slope;
#endif
#if GEOMETRY == VOLUME
    out.x = inner.first * field->inverse_spacing[0];
    out.y = inner.second * field->inverse_spacing[1];
    out.z = inner.third * field->inverse_spacing[2];
#elif GEOMETRY == PLANAR
    out.x = (reals)R(0.0);
    out.y = inner.first * field->inverse_spacing[1];
    out.z = inner.second * field->inverse_spacing[2];
#else
    // On the axis the slope along the radius is zero, so any finite divisor is correct.
    const reals outward = inner.first * field->inverse_spacing[0] * SWIFT_INVERSE(max(radius, (reals)TINY));
    out.x = outward * x;
    out.y = outward * y;
    out.z = inner.second * field->inverse_spacing[2];
#endif
    return out;
}

#endif
