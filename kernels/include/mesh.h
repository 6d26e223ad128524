// The optical potential on a quadrilateral mesh.
//
// The cell that contains a point is found by walking over edges from the cell that contained the ray at the start of
// its step; if the walk fails, through the uniform bins.
#ifndef MESH_H
#define MESH_H

#include "constants.h"
#include "types.h"

static inline real2 corner(const Arrays *arrays, int k)
{
    return vload2(k, arrays->corners);
}

// Distance of p to the left of the edge a -> b [m], times the edge's length; and the edge's length.
static inline real left_of(real2 a, real2 b, real2 p, real *edge_length)
{
    const real2 edge = b - a;
    const real2 toward = p - a;
    *edge_length = size2(edge);
    return edge.x * toward.y - edge.y * toward.x;
}

// -1 if the cell contains the point, edges included, else the number of the edge that it is furthest behind.
static inline int furthest_edge(const Field *field, const Arrays *arrays, int cell, real2 p)
{
    int edge_number = -1;
    real furthest = -field->edge_tolerance;
    real2 from = corner(arrays, 4 * cell);
    const real2 start = from;
#pragma unroll
    for (int k = 0; k < 4; k++) {
        const real2 to = k < 3 ? corner(arrays, 4 * cell + k + 1) : start;
        real edge_length;
        const real left = left_of(from, to, p, &edge_length);
        if (left < furthest * edge_length) {
            furthest = left / edge_length;
            edge_number = k;
        }
        from = to;
    }
    return edge_number;
}

// Index of the cell that contains a point, -1 if none does. The walk starts at `current_cell`, a cell nearby, or -1 for
// no walk. It crosses the edge that the point is furthest behind.
static inline int locate(const Field *field, const Arrays *arrays, real2 p, int current_cell)
{
    int cell = current_cell;
    for (int trial = 0; trial < WALK_LIMIT && cell >= 0; trial++) {
        const int edge_number = furthest_edge(field, arrays, cell, p);
        if (edge_number < 0) {
            return cell;
        }
        cell = arrays->neighbors[4 * cell + edge_number];
    }
    const int i = clamp((int)floor((p.x - field->bin_origin[0]) * field->bin_rate[0]), 0, field->bin_count[0] - 1);
    const int j = clamp((int)floor((p.y - field->bin_origin[1]) * field->bin_rate[1]), 0, field->bin_count[1] - 1);
    const int key = i * field->bin_count[1] + j;
    const int stop = arrays->bin_start[key + 1];
    for (int at = arrays->bin_start[key]; at < stop; at++) {
        cell = arrays->bin_cell[at];
        if (furthest_edge(field, arrays, cell, p) < 0) {
            return cell;
        }
    }
    return -1;
}

// Point in the plane of the mesh; positions on a mesh are in metres.
static inline real2 plane_point(real3 frac)
{
#if GEOMETRY == PLANAR
    return (real2)(frac.y, frac.z);
#else
    return (real2)(sqrt(frac.x * frac.x + frac.y * frac.y), frac.z);
#endif
}

// The nearest point in the mesh's box. Stages of the last step may be beyond the box, where the field is extrapolated
// linearly.
static inline real2 within_box(const Field *field, real2 p)
{
    return (real2)(
        bounded(p.x, field->mesh_low[0], field->mesh_high[0]), bounded(p.y, field->mesh_low[1], field->mesh_high[1]));
}

// The cell from which the next lookups of a ray start.
static inline int find_current_cell(const Field *field, const Arrays *arrays, real3 frac, int current_cell)
{
    return locate(field, arrays, within_box(field, plane_point(frac)), current_cell);
}

#if INTERPOLATION == BILINEAR_BARRON || INTERPOLATION == IDW
// Contrast and node gradient, each the sum over the four corners by weights.
static inline real3 blend(const Arrays *arrays, int first, real4 w)
{
    const real4 m = vload4(0, arrays->values + first);
    const real2 g = w.x * vload2(first, arrays->gradients) + w.y * vload2(first + 1, arrays->gradients)
        + w.z * vload2(first + 2, arrays->gradients) + w.w * vload2(first + 3, arrays->gradients);
    return (real3)(dot(w, m), g.x, g.y);
}
#endif

// Contrast and its gradient in the plane, at a point of a cell.
static inline real3 in_cell(const Arrays *arrays, int cell, real2 p)
{
    const int first = 4 * cell;
    const real2 origin = corner(arrays, first);
    const real2 b = corner(arrays, first + 1) - origin;
    const real2 c = corner(arrays, first + 2) - origin;
    const real2 d = corner(arrays, first + 3) - origin;
    const real2 target = p - origin;
#if INTERPOLATION == IDW
    const real4 away = (real4)(size2(target), size2(target - b), size2(target - c), size2(target - d)) / size2(c);
    const real4 w = (real4)(
        away.y * away.z * away.w, away.x * away.z * away.w, away.x * away.y * away.w, away.x * away.y * away.z);
    return blend(arrays, first, w / (w.x + w.y + w.z + w.w));
#else
    real xi = R(0.5), eta = R(0.5);
    real2 along = b, across = d;
    real det = R(1.0);
    // Newton's method; the last pass only computes the Jacobian at the solution, for the gradient.
    for (int trial = 0; trial < 8; trial++) {
        along = (R(1.0) - eta) * b + eta * (c - d);
        across = (R(1.0) - xi) * d + xi * (c - b);
        det = along.x * across.y - along.y * across.x;
        if (trial < 7) {
            const real2 miss = xi * (R(1.0) - eta) * b + xi * eta * c + (R(1.0) - xi) * eta * d - target;
            const real step_xi = (miss.x * across.y - miss.y * across.x) / det;
            const real step_eta = (along.x * miss.y - along.y * miss.x) / det;
            xi = bounded(xi - step_xi, R(-0.5), R(1.5));
            eta = bounded(eta - step_eta, R(-0.5), R(1.5));
        }
    }
#if INTERPOLATION == BILINEAR_BARRON
    return blend(
        arrays,
        first,
        (real4)((R(1.0) - xi) * (R(1.0) - eta), xi * (R(1.0) - eta), xi * eta, (R(1.0) - xi) * eta));
#else
    const real4 m = vload4(0, arrays->values + first);
    const real vb = m.y - m.x, vc = m.z - m.x, vd = m.w - m.x;
    const real value = m.x + xi * (R(1.0) - eta) * vb + xi * eta * vc + (R(1.0) - xi) * eta * vd;
    const real rise = (R(1.0) - eta) * vb + eta * (vc - vd);
    const real lift = (R(1.0) - xi) * vd + xi * (vc - vb);
    return (real3)(value, (rise * across.y - lift * along.y) / det, (lift * along.x - rise * across.x) / det);
#endif
#endif
}

// Potential s and its gradient [1/m] by the interpolant of one cell. The contrast m is interpolated, and
// s = m (a + m / 2), grad s = (a + m) grad m.
static real4 sample_in(const Field *field, const Arrays *arrays, int inside, real3 frac)
{
    const real2 p = plane_point(frac);
    const real2 edge = within_box(field, p);
    real3 s = in_cell(arrays, inside, edge);
    s.x += dot(s.yz, p - edge);
    const real index = field->ambient + s.x;
    s = (real3)(s.x * (field->ambient + R(0.5) * s.x), index * s.y, index * s.z);
#if GEOMETRY == PLANAR
    return (real4)(s.x, R(0.0), s.y, s.z);
#else
    const real outward = p.x > R(0.0) ? s.y / p.x : R(0.0);
    return (real4)(s.x, outward * frac.x, outward * frac.y, s.z);
#endif
}

// The same in the cell that contains a point; zero outside the mesh.
static real4 sample(const Field *field, const Arrays *arrays, int3 cell, real3 frac, int current_cell)
{
    const int inside = locate(field, arrays, within_box(field, plane_point(frac)), current_cell);
    return inside < 0 ? (real4)R(0.0) : sample_in(field, arrays, inside, frac);
}

// Step length of eq 5 in the cell of the point [m]. Outside the mesh it is the median over all cells, which is stored
// after the entry of the last cell.
static inline real paper_step(const Field *field, const Arrays *arrays, int3 cell, real3 frac, int current_cell)
{
    const int inside = locate(field, arrays, plane_point(frac), current_cell);
    return arrays->paper_step[inside < 0 ? field->cell_count : inside];
}

#endif
