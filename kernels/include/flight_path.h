// Positions of the leapfrog samples of nearly straight rays, and the potential there.
#ifndef FLIGHT_PATH_H
#define FLIGHT_PATH_H

#include "packet.h"

// The undisturbed ray: its start in cells, its direction, and the distance between samples.
typedef struct {
    reals x0, y0, z0, dx, dy, dz, h;  // place in cells from the grid's first node (x, y from the axis)
#if CUBES
    reals off, off_slope, off_moment;  // sums of error bounds of the cubes; the last is that of the slope's moments
#endif
} Path;

// The potential `middle` parts of the path on, at momentum p and deviation q, after a half step of length `half_step`; f
// gets its slopes across the path in x, y, z, and `ahead` its slope along it.
static inline reals sample_path(
    const Field *field, const Arrays *arrays, Path *path, real middle, reals half_step, const reals *p, const reals *q,
    reals *f, reals *ahead)
{
    const real3 rate = VECTOR(field->inverse_spacing);
    const reals t = middle * path->h, dx = path->dx, dy = path->dy, dz = path->dz;
    const reals x = path->x0 + (t * dx + q[0] + half_step * p[0]) * rate.x;
    const reals y = path->y0 + (t * dy + q[1] + half_step * p[1]) * rate.y;
    const reals z = path->z0 + (t * dz + q[2] + half_step * p[2]) * rate.z;
#if CUBES && LANES > 1
    // Prefetch for the next sample, straight ahead: a ray turns very little between samples.
    reals u, v, w;
    const reals hop = path->h;
    ask_for_cubes(
        arrays->coefficients,
        cube_start(field, x + hop * dx * rate.x, y + hop * dy * rate.y, z + hop * dz * rate.z, &u, &v, &w));
#endif
    const Potential at = sample_packet(field, arrays, x, y, z);
#if CUBES
    path->off += at.off;
    path->off_slope += at.off_slope;
    path->off_moment += middle * at.off_slope;
#endif
    *ahead = at.x * dx + at.y * dy + at.z * dz;
    f[0] = at.x - *ahead * dx;
    f[1] = at.y - *ahead * dy;
    f[2] = at.z - *ahead * dz;
    return at.value;
}

#endif
