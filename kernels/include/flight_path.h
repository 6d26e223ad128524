// Positions of the leapfrog samples of nearly straight rays, and the potential there: for rays of any direction, and
// for rays along z in two dimensions (IN_PLANE). In two dimensions only the distance from the axis (y in a planar
// field) changes, and only the slope along it moves the ray: vectors across the ray have one component.
#ifndef FLIGHT_PATH_H
#define FLIGHT_PATH_H

#include "packet.h"

#if IN_PLANE

#define ACROSS 1              // components across the ray
#define UNIT(h) (reals)R(1.0)  // lengths along the ray and deviations are in units of h, forces are multiplied by h
#define IN_METRES(h) (h)

typedef struct {
    reals r0, z0, ex, ey;   // start in cells; direction across the ray
    reals stride, reach;    // cells between samples along the ray, and across the ray at a slope of 1
    reals place, along;     // position of the last sample, in cells
    reals dz;
#if AHEAD
    CellAhead now;
#endif
} Path;

static inline Path path_of(
    const Field *field, const Arrays *arrays, reals x0, reals y0, reals z0, reals dx, reals dy, reals dz, reals h)
{
    Path path;
#if GEOMETRY == AXISYMMETRIC
    path.r0 = sqrt(x0 * x0 + y0 * y0);
    path.ex = CHOOSE((reals)R(1.0), x0 / path.r0, path.r0 > R(0.0));
    path.ey = CHOOSE((reals)R(0.0), y0 / path.r0, path.r0 > R(0.0));
#else
    path.r0 = y0;
    path.ex = (reals)R(0.0);
    path.ey = (reals)R(1.0);
#endif
    path.z0 = z0;
    path.dz = dz;
    path.stride = h * dz * field->inverse_spacing[2];
    path.reach = h * field->inverse_spacing[1];
    path.place = path.r0;
    path.along = z0;
#if AHEAD
    path.now = cell_ahead(field, arrays, path.r0, z0 + R(0.5) * path.stride);
#endif
    return path;
}

// The potential `middle` parts of the path on, at momentum p and deviation q, after a half step of length `half_step`;
// f gets its slopes across the path.
static inline reals sample_path(
    const Field *field, const Arrays *arrays, Path *path, real middle, reals half_step, const reals *p, const reals *q,
    reals *f, reals *ahead)
{
    reals climb;
    path->along = path->z0 + middle * path->stride;
    path->place = path->r0 + (q[0] + half_step * p[0]) * path->reach;
#if AHEAD
    // Load the next sample's cell now, at the position where the ray would be without this sample's force. If that is a
    // little beyond the face of the right cell, the polynomial is still accurate enough.
    const CellAhead after = cell_ahead(
        field, arrays, path->place + R(2.0) * half_step * p[0] * path->reach, path->z0 + (middle + R(1.0)) * path->stride);
    const reals s = sample_cell(&path->now, path->place, path->along, &climb);
    path->now = after;
#else
    const reals s = sample_along(field, arrays, path->place, path->along, &climb);
#endif
    f[0] = climb * path->reach;
    return s;
}

// The potential at the last sample, its slope along the path, and its slopes across the path in x, y, z (f).
static inline reals last_sample(
    const Field *field, const Arrays *arrays, const Path *path, reals s, const reals *across, reals *ahead, reals *f)
{
    const Potential last = sample_packet(field, arrays, path->place * path->ex, path->place * path->ey, path->along);
    *ahead = last.z * path->dz;
    f[0] = last.x;
    f[1] = last.y;
    f[2] = (reals)R(0.0);
    return last.value;
}

// Component c across the path of a vector in x, y, z.
static inline reals part_across(const Path *path, const reals *vector, int c)
{
    return vector[0] * path->ex + vector[1] * path->ey;
}

// A vector across the path in x, y, z.
static inline void spread(const Path *path, const reals *across, reals *out)
{
    out[0] = across[0] * path->ex;
    out[1] = across[0] * path->ey;
    out[2] = (reals)R(0.0);
}

#else

#define ACROSS 3
#define UNIT(h) (h)
#define IN_METRES(h) (reals)R(1.0)

typedef struct {
    reals x0, y0, z0, dx, dy, dz, h;
#if CUBES
    reals off, off_slope, off_moment;  // sums of error bounds of the cubes; the last is that of the slope's moments
#endif
} Path;

static inline Path path_of(
    const Field *field, const Arrays *arrays, reals x0, reals y0, reals z0, reals dx, reals dy, reals dz, reals h)
{
    const Path path = {x0, y0, z0, dx, dy, dz, h};  // the sums start at 0
    return path;
}

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

static inline reals last_sample(
    const Field *field, const Arrays *arrays, const Path *path, reals s, const reals *across, reals *ahead, reals *f)
{
    f[0] = across[0];
    f[1] = across[1];
    f[2] = across[2];
    return s;
}

static inline reals part_across(const Path *path, const reals *vector, int c) { return vector[c]; }

static inline void spread(const Path *path, const reals *across, reals *out)
{
    out[0] = across[0];
    out[1] = across[1];
    out[2] = across[2];
}

#endif

#endif
