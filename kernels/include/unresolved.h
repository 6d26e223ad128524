// A bound of the error from features between a ray's leapfrog samples: a table summed along its path, and one looked up
// at its ends (see aerokernels/tracing/tasks/unresolved.py).
#ifndef UNRESOLVED_H
#define UNRESOLVED_H

#include "constants.h"
#include "flight_path.h"

// Block of the table along one of its axes; places are in cells.
static inline ints block_of(const Control *control, int axis, reals place)
{
    const reals block = place * (R(1.0) / (real)control->block);
    return TO_INTS(min(max(block, (reals)R(0.0)), (reals)((real)control->block_count[axis] - R(0.5))));
}

// Entry of the table at a place in cells.
static inline ints entry_at(const Control *control, reals x, reals y, reals z)
{
#if GEOMETRY == VOLUME
    const ints column = block_of(control, 0, x) * control->block_count[1] + block_of(control, 1, y);
    return column * control->block_count[2] + block_of(control, 2, z);
#elif GEOMETRY == PLANAR
    return block_of(control, 0, y) * control->block_count[1] + block_of(control, 1, z);
#else
    return block_of(control, 0, sqrt(x * x + y * y)) * control->block_count[1] + block_of(control, 1, z);
#endif
}

// A bound of the error of a ray's path [m]. The ray runs along its path for `length` metres, and ends q [m] beside that
// line. 0 without a table, infinite if the samples are further apart than the table is valid for.
static inline reals unresolved_of(
    const Field *field, const Arrays *arrays, const Control *control, const Path *path, reals length, const reals *q)
{
    if (arrays->step_bound_start[0] < 0) {
        return (reals)R(0.0);
    }
    const real3 rate = VECTOR(field->inverse_spacing);
    const reals x0 = path->x0, y0 = path->y0, z0 = path->z0, dx = path->dx, dy = path->dy, dz = path->dz;
    const reals qx = q[0], qy = q[1], qz = q[2];
    reals ahead = length * max(fabs(dy) * rate.y, fabs(dz) * rate.z);
    if (GEOMETRY != PLANAR) {
        ahead = max(ahead, length * fabs(dx) * rate.x);
    }
    const reals strides = ahead * (R(1.0) / (LOOKUP_STRIDE * (real)control->block));
    int count = 1;
    for (int lane = 0; lane < LANES; lane++) {
        count = max(count, (int)ceil(REAL_AT(strides, lane)));
    }
    reals sum = (reals)R(0.0);
    for (int k = 0; k < count; k++) {
        const real share = ((real)k + R(0.5)) / (real)count;
        const reals t = share * length;
        const real deflected = share * share;
        const reals x = x0 + (t * dx + deflected * qx) * rate.x, y = y0 + (t * dy + deflected * qy) * rate.y;
        const reals z = z0 + (t * dz + deflected * qz) * rate.z;
        const ints entry = entry_at(control, x, y, z);
        for (int lane = 0; lane < LANES; lane++) {
            REAL_AT(sum, lane) += arrays->step_bound[INT_AT(entry, lane)];
        }
    }
    reals missed = sum * length * (R(1.0) / (real)count);
    const int at_ends = arrays->step_bound_start[1];
    if (at_ends >= 0) {
        const ints first = entry_at(control, x0, y0, z0);
        const ints last = entry_at(
            control, x0 + (length * dx + qx) * rate.x, y0 + (length * dy + qy) * rate.y,
            z0 + (length * dz + qz) * rate.z);
        for (int lane = 0; lane < LANES; lane++) {
            REAL_AT(missed, lane) +=
                arrays->step_bound[at_ends + INT_AT(first, lane)] + arrays->step_bound[at_ends + INT_AT(last, lane)];
        }
    }
    const reals spacing = length * (R(1.0) / (real)control->sample_count);
    return CHOOSE(missed, (reals)INFINITY, spacing > R(1.001) * control->step);
}

// Error of the path [m] including that from the error of direction, if the ray meets its stop `onward` metres further
// on at this cosine with the stop's normal.
static inline reals with_lever_arm(const Field *field, reals missed, reals onward, reals cosine)
{
    const reals tangent = sqrt(max(R(1.0) - cosine * cosine, R(0.0))) / max(cosine, (real)LEAST_COSINE);
    return missed * (R(1.0) + MISSED_SLOPE * greatest(VECTOR(field->inverse_spacing)) * onward * tangent);
}

#endif
