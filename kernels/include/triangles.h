// Where straight lines cross the triangles of a body in a volume, watertight. In float64. The formulas are in
// aerokernels/medium/bodies/triangle_crossings.py. Warp's twin is
// aerokernels/tracing/engines/warp/kernels/triangles.py.
#ifndef TRIANGLES_H
#define TRIANGLES_H

#include "constants.h"
#include "types.h"

#define NEVER 1.0e300  // stands for a distance that does not exist

// Set a line's two unit vectors across its direction, right-handed with it.
static inline void set_axes_across(WallLine *line)
{
    const double3 e = line->toward / sqrt(line->square);
    const double sign = e.z < 0.0 ? -1.0 : 1.0;
    const double a = -1.0 / (sign + e.z), b = e.x * e.y * a;
    line->right = (double3)(1.0 + sign * e.x * e.x * a, sign * b, -sign * e.x);
    line->up = (double3)(b, sign + e.y * e.y * a, -e.y);
}

// The part of `span` in which a coordinate of a line is between two bounds; reversed if there is none.
static inline double2 within_slab(double place, double along, double low, double high, double2 span)
{
    if (along == 0.0) {
        return place < low || place > high ? (double2)(NEVER, -NEVER) : span;
    }
    const double one = (low - place) / along, other = (high - place) / along;
    return (double2)(greater64(span.x, lesser64(one, other)), lesser64(span.y, greater64(one, other)));
}

// Whether a line may pass a box between t = first and last. The box is enlarged by `margin` on every side.
static inline int passes_volume_box(
    const WallLine *line, double3 low, double3 high, double margin, double first, double last)
{
    double2 span = (double2)(first, last);
    span = within_slab(line->point.x, line->toward.x, low.x - margin, high.x + margin, span);
    span = within_slab(line->point.y, line->toward.y, low.y - margin, high.y + margin, span);
    span = within_slab(line->point.z, line->toward.z, low.z - margin, high.z + margin, span);
    return span.x <= span.y;
}

// Coordinates of a corner across a line (two) and along it.
static inline double3 corner_across(const WallLine *line, double3 corner)
{
    const double3 offset = corner - line->point;
    return (double3)(dot(line->right, offset), dot(line->up, offset), dot(line->toward, offset));
}

// Side of the edge from a to b on which the line is: positive on the left, never zero, opposite from b to a.
static inline double edge_side(double3 a, double3 b)
{
    const int swap = a.x > b.x || (a.x == b.x && a.y > b.y);
    const double3 p = swap ? b : a, q = swap ? a : b;
    double side = p.x * q.y - p.y * q.x;
    side = side > 0.0 ? side : lesser64(side, -LEAST_SIDE);
    return swap ? -side : side;
}

// Crossings of a line with a triangle.
static inline Crossings triangle_crossing(const WallLine *line, double3 one, double3 two, double3 three)
{
    Crossings out = {0, 0, 0.0, 0.0};
    const double3 a = corner_across(line, one), b = corner_across(line, two), c = corner_across(line, three);
    const double ab = edge_side(a, b), bc = edge_side(b, c), ca = edge_side(c, a);
    if ((ab > 0.0) == (bc > 0.0) && (bc > 0.0) == (ca > 0.0)) {
        out.count = 1;
        out.enters = ab < 0.0;
        out.one = (bc * a.z + ca * b.z + ab * c.z) / ((ab + bc + ca) * line->square);
    }
    return out;
}

// Whether a line may enter the body through a triangle between t_enter and t_exit if moved by `margin`. A triangle
// through which the line can only leave the body does not count; one that it grazes does.
static inline int may_enter_triangle(
    const WallLine *line, double3 a, double3 b, double3 c, double margin, double t_enter, double t_exit)
{
    const double3 normal = cross(b - a, c - a);
    const double rising = dot(normal, line->toward);
    if (rising > 0.0 && rising * rising > GRAZING_SQUARE * dot(normal, normal) * line->square) {
        return 0;
    }
    return passes_volume_box(line, fmin(a, fmin(b, c)), fmax(a, fmax(b, c)), margin, t_enter, t_exit);
}

#endif
