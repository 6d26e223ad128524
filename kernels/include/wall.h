// The body: where a ray leaves it, whether a ray stays clear of it, where a step enters it.
//
// All use the crossings of straight lines with the body's surface, see crossings.h. Warp's twin is
// aerokernels/tracing/engines/warp/kernels/wall.py.
#ifndef WALL_H
#define WALL_H

#include "crossings.h"
#include "motion.h"

// WallMeeting whose exit is where a ray that starts in the body leaves it: NEVER if it does not leave, and `first` for
// rays that start outside the body, which are not `odd`.
APART WallMeeting body_exit(const Field *field, const Arrays *arrays, double3 p, double3 d, double first)
{
    if (GEOMETRY == PLANAR && d.y == 0.0 && d.z == 0.0) {
        // Along x the ray stays in the body or beside it: a line in any other direction shows which.
        const WallLine beside = wall_line(p, (double3)(0.0, 0.0, 1.0));
        WallMeeting met = meet_wall(field, arrays, &beside, 0.0, NEVER);
        met.exit = met.odd ? NEVER : first;
        return met;
    }
    const WallLine line = wall_line(p, d);
    WallMeeting met = meet_wall(field, arrays, &line, first, NEVER);
    met.exit = met.odd ? met.exit : first;
    return met;
}

// Outward unit normal of the body at a point of a piece of its surface.
static inline double3 outward_normal(const Arrays *arrays, int piece, double3 p)
{
#if GEOMETRY == VOLUME
    const double3 a = vload4(3 * piece, arrays->wall).xyz;
    const double3 first = vload4(3 * piece + 1, arrays->wall).xyz - a;
    const double3 second = vload4(3 * piece + 2, arrays->wall).xyz - a;
    const double3 area = cross(first, second);
    // Shares of the second and the third corner: areas within the triangle.
    const double one = dot(cross(p - a, second), area) / dot(area, area);
    const double other = dot(cross(first, p - a), area) / dot(area, area);
    const double3 sum = (1.0 - one - other) * vload4(3 * piece, arrays->wall_normals).xyz +
        one * vload4(3 * piece + 1, arrays->wall_normals).xyz + other * vload4(3 * piece + 2, arrays->wall_normals).xyz;
#else
    const double4 s = vload4(piece, arrays->wall), at_ends = vload4(piece, arrays->wall_normals);
    double place = p.y;
    double2 across = (double2)(0.0, 1.0);
    if (GEOMETRY == AXISYMMETRIC) {
        place = sqrt(p.x * p.x + p.y * p.y);
        across = p.xy / greater64(place, 1.0e-300);
    }
    const double2 step = s.zw - s.xy;
    const double share = dot((double2)(place, p.z) - s.xy, step) / dot(step, step);
    const double r = at_ends.x + share * (at_ends.z - at_ends.x);
    const double3 sum = (double3)(r * across.x, r * across.y, at_ends.y + share * (at_ends.w - at_ends.y));
#endif
    return sum / greater64(size64(sum), 1.0e-300);
}

// Change k of the momentum along the normal of the body where rays leave it, with the momentum `before` along it and
// the potential outside. A ray that would be reflected within the body runs along its surface.
#define LEAVING_KICK(before, potential)                                                                                \
    max(R(2.0) * (potential) / ((before) + sqrt(max((before) * (before) + R(2.0) * (potential), R(0.0)))), -(before))

// Deviation of the momentum where a ray begins. A ray that leaves the body, where `normal` is not zero, is refracted
// there; other rays keep their direction.
static inline real3 starting_momentum(real ambient, real pot, real3 d, double3 normal)
{
    const real3 outward = convert_real3(normal);
    const real before = ambient * dot(d, outward);
    return before > R(0.0) ? LEAVING_KICK(before, pot) * outward : contrast(ambient, pot) * d;
}

// Distance at which a ray enters the body before it reaches the box. It reaches the box at `last`. NEVER if it does not
// enter.
APART double body_entry(const Field *field, const Arrays *arrays, double3 p, double3 d, double last)
{
    if (last <= 0.0 || (GEOMETRY == PLANAR && d.y == 0.0 && d.z == 0.0)) {
        return NEVER;
    }
    const WallLine line = wall_line(p, d);
    return meet_wall(field, arrays, &line, 0.0, (1.0 + ENTRY_ROUNDING) * last).entry;
}

#if GEOMETRY != VOLUME
// A segment moved in r and z; in an axisymmetric field it does not cross the axis.
static inline double4 moved_segment(double4 s, double r, double z)
{
    const double least = GEOMETRY == AXISYMMETRIC ? 0.0 : -NEVER;
    return (double4)(greater64(s.x + r, least), s.y + z, greater64(s.z + r, least), s.w + z);
}
#endif

#if GEOMETRY != VOLUME
// Whether a line, however it is shifted, can only leave the body through a segment, without grazing it. In an
// axisymmetric field, the side of the cone that leans most toward the line counts.
static inline int only_leaves(const WallLine *line, double4 s)
{
    // (r, z) is the normal, out of the body.
    const double r = s.w - s.y, z = s.x - s.z;
    const double least = GRAZING_SQUARE * (r * r + z * z);
#if GEOMETRY == AXISYMMETRIC
    const double rising = z * line->along;
    return rising > 0.0 && rising * rising > 2.0 * (r * r * line->across + least);
#else
    const double rising = r * line->across + z * line->along;
    return rising > 0.0 && rising * rising > least * line->square;
#endif
}
#endif

#if GEOMETRY == VOLUME
// Whether a ray may enter the body through a triangle, either where the ray is, or if moved by `margin` in any
// direction.
static inline int may_enter(
    const Arrays *arrays, const WallLine *line, int piece, double margin, double t_enter, double t_exit)
{
    const double3 a = vload4(3 * piece, arrays->wall).xyz, b = vload4(3 * piece + 1, arrays->wall).xyz;
    const double3 c = vload4(3 * piece + 2, arrays->wall).xyz;
    return may_enter_triangle(line, a, b, c, margin, t_enter, t_exit);
}
#else
// Whether a ray may enter the body through a segment, either where the ray is, or if moved by `margin` up and down in r
// and in z.
static inline int may_enter(
    const Arrays *arrays, const WallLine *line, int piece, double margin, double t_enter, double t_exit)
{
    const double4 s = vload4(piece, arrays->wall);
    const double4 box = (double4)(lesser64(s.x, s.z), lesser64(s.y, s.w), greater64(s.x, s.z), greater64(s.y, s.w));
    if (only_leaves(line, s) || !passes_box(line, box, margin, t_enter, t_exit)) {
        return 0;
    }
    for (int side = 0; side < 5; side++) {
        const double r = side == 1 ? margin : side == 2 ? -margin : 0.0;
        const double z = side == 3 ? margin : side == 4 ? -margin : 0.0;
        const double4 moved = moved_segment(s, r, z);
        const Crossings at = segment_crossings(line, moved, 1);
        const double t = at.enters ? at.one : at.two;
        if ((at.enters ? at.count > 0 : at.count > 1) && t > t_enter && t < t_exit) {
            return 1;
        }
    }
    return 0;
}
#endif

// Whether a straight ray stays out of the body. It must do so between two distances, and so must the rays moved across
// the surface by `margin` [m]. Places where they leave the body do not matter, so a ray may begin on the wall.
APART int has_clearance(
    const Field *field, const Arrays *arrays, double3 p, double3 d, double t_enter, double t_exit, double margin)
{
    const WallLine line = wall_line(p, d);
    int node = 0;
    while (node < field->wall_count) {
        const int3 links = vload3(node, arrays->wall_links);
        int next = links.x;
        if (passes_node(arrays, &line, node, margin, t_enter, t_exit)) {
            next = node + 1;
            for (int k = links.y; k < links.z; k++) {
                if (may_enter(arrays, &line, k, margin, t_enter, t_exit)) {
                    return 0;
                }
            }
        }
        node = next;
    }
    return 1;
}

// Whether a point is within `within` [m] of the box around the whole body. The distance is taken along each axis.
static inline int comes_near(const Arrays *arrays, double3 here, double within)
{
#if GEOMETRY == VOLUME
    const double4 low = vload4(0, arrays->wall_boxes), high = vload4(1, arrays->wall_boxes);
    const int is_along = here.z - within <= high.z && here.z + within >= low.z;
    return is_along && here.x - within <= high.x && here.x + within >= low.x && here.y - within <= high.y &&
           here.y + within >= low.y;
#else
    const double4 whole = vload4(0, arrays->wall_boxes);
    const double beside = GEOMETRY == AXISYMMETRIC ? sqrt(here.x * here.x + here.y * here.y) : here.y;
    const int is_along = here.z - within <= whole.w && here.z + within >= whole.y;
    return is_along && beside - within <= whole.z && beside + within >= whole.x;
#endif
}

// How much of a step of length h is behind its entry into the body; -1 if it does not enter. The step goes from `here`
// along its first tangent, with the bend `kick` [m]; it is replaced by chords that stay within WALL_SAG cells of it.
// `allowance`: how far before the step's start a wall counts, in the unit of h.
APART real behind_wall(
    const Field *field,
    const Arrays *arrays,
    const Control *control,
    double3 here,
    real3 tangent,
    real3 kick,
    real h,
    real allowance)
{
    const real sag = size3(kick * VECTOR(control->cell_rate)) / (R(4.0) * WALL_SAG);
    const int pieces = sag > R(1.0) ? 1 + (int)lesser(sqrt(sag), R(15.0)) : 1;
    const double3 straight = convert_double3(h * tangent), bend = convert_double3(kick);
    // Most steps are far from the box around the whole body: they need no line.
    const double within = (double)(h + allowance) * (double)size3(tangent) + (double)size3(kick);
    if (!comes_near(arrays, here, within)) {
        return R(-1.0);
    }
    double3 begin = here;
    double first = -(double)pieces * (double)(allowance / h);
    for (int k = 0; k < pieces; k++) {
        const double share = (double)(k + 1) / (double)pieces;
        const double3 end = here + share * straight + (share * share) * bend;
        const WallLine line = wall_line(begin, end - begin);
        const double entry = meet_wall(field, arrays, &line, first, 1.0).entry;
        if (entry <= 1.0) {
            return (real)(1.0 - ((double)k + entry) / (double)pieces) * h;
        }
        begin = end;
        first = -1.0e-9;
    }
    return R(-1.0);
}

#endif
