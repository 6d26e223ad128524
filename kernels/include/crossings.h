// Where straight lines cross the surface of the body, by exact formulas. In float64. The formulas are in
// aerokernels/medium/bodies/crossings.py, the tree of boxes in aerokernels/medium/bodies/wall_tree.py. Warp's twin is
// aerokernels/tracing/engines/warp/kernels/crossings.py.
#ifndef CROSSINGS_H
#define CROSSINGS_H

#include "triangles.h"

// WallLine of a line.
static inline WallLine wall_line(double3 p, double3 d)
{
    WallLine line;
    line.along = d.z;
    line.z = p.z;
#if GEOMETRY == AXISYMMETRIC
    const double a = d.x * d.x + d.y * d.y;
    const int parallel = a < PARALLEL * (a + d.z * d.z);
    const double moment = p.x * d.y - p.y * d.x;
    line.across = parallel ? 0.0 : a;
    line.nearest = parallel ? 0.0 : -(p.x * d.x + p.y * d.y) / a;
    line.first = parallel ? p.x * p.x + p.y * p.y : moment * moment / a;
    line.height = p.z + line.nearest * d.z;
    line.square = 0.0;
#elif GEOMETRY == VOLUME
    line.across = line.nearest = line.first = line.height = 0.0;
    line.square = dot(d, d);
    line.point = p;
    line.toward = d;
    set_axes_across(&line);
#else
    line.across = d.y;
    line.nearest = 0.0;
    line.first = p.y;
    line.height = p.z;
    line.square = d.y * d.y + d.z * d.z;
#endif
    return line;
}

// Whether a line may pass a box between t = first and last. The box, lowest and greatest (r, z), is enlarged by
// `margin` on every side.
static inline int passes_box(const WallLine *line, double4 box, double margin, double first, double last)
{
    double near = first, far = last;
    if (line->along == 0.0) {
        if (line->z < box.y - margin || line->z > box.w + margin) {
            return 0;
        }
    } else {
        const double one = (box.y - margin - line->z) / line->along, other = (box.w + margin - line->z) / line->along;
        near = greater64(near, lesser64(one, other));
        far = lesser64(far, greater64(one, other));
    }
#if GEOMETRY == AXISYMMETRIC
    const double n = near - line->nearest, f = far - line->nearest;
    const double low = box.x - margin, high = box.z + margin;
    const double closest = greater64(n, 0.0) + lesser64(f, 0.0);
    const double least = line->first + line->across * closest * closest;
    const double most = line->first + line->across * greater64(n * n, f * f);
    return near <= far && least <= high * high && (low <= 0.0 || !(most < low * low));
#else
    if (line->across == 0.0) {
        return near <= far && line->first >= box.x - margin && line->first <= box.z + margin;
    }
    const double one = (box.x - margin - line->first) / line->across;
    const double other = (box.z + margin - line->first) / line->across;
    return greater64(near, lesser64(one, other)) <= lesser64(far, greater64(one, other));
#endif
}

#if GEOMETRY == AXISYMMETRIC
// Positive if a corner is outside the surface that the line sweeps about the axis.
static inline double corner_side(const WallLine *line, double place, double height)
{
    return line->along * line->along * (place * place - line->first) - line->across * height * height;
}
#else
// The side of the line on which a corner is.
static inline double corner_side(const WallLine *line, double place, double height)
{
    return line->across * (height - line->z) - line->along * (place - line->first);
}
#endif

// Crossings of a line with a segment. With `entries_only`, a single crossing that leads out of the body is skipped,
// which saves a root and a division.
static inline Crossings segment_crossings(const WallLine *line, double4 segment, int entries_only)
{
    Crossings out = {0, 0, 0.0, 0.0};
    const double dr = segment.z - segment.x, dz = segment.w - segment.y;
#if GEOMETRY == AXISYMMETRIC
    const double d = line->along;
    const double h1 = segment.y - line->height, h2 = segment.w - line->height;
    const double w1 = corner_side(line, segment.x, h1), w2 = corner_side(line, segment.z, h2);
    const int once = (w1 > 0.0) != (w2 > 0.0);
    const int enters = w1 > 0.0 ? d < 0.0 : d > 0.0;
    if (once ? entries_only && !enters : w1 > 0.0) {
        return out;
    }
    const double steepness = line->across * dz * dz - d * d * dr * dr;
    if (steepness > 0.0) {
        // Less steep than the line: find the roots of the cone's equation.
        const double k = segment.x * dz - h1 * dr;
        const double mean = k * dr * d;
        const double rest = line->first * dz * dz - k * k;
        const double square = mean * mean - steepness * rest;
        const double root = sqrt(greater64(square, 0.0));
        const double larger = mean >= 0.0 ? mean + root : mean - root;
        const double one = larger / steepness, other = larger == 0.0 ? 0.0 : rest / larger;
        const double low = lesser64(one, other), high = greater64(one, other);
        if (once) {
            out.count = 1;
            out.enters = enters;
            out.one = line->nearest + ((w1 > 0.0 ? dz : -dz) * d > 0.0 ? high : low);
        } else {
            const double middle = line->height + d * (mean / steepness);
            if (square > 0.0 && (segment.y > middle) != (segment.w > middle)) {
                out.count = 2;
                out.enters = dz > 0.0;
                out.one = line->nearest + low;
                out.two = line->nearest + high;
            }
        }
    } else if (once) {
        // As steep as the line or steeper: solve for the place along the segment.
        const double slope = d * d * segment.x * dr - line->across * h1 * dz;
        const double root = sqrt(greater64(slope * slope + steepness * w1, 0.0));
        double share = w1 / (root - slope);
        if (!(w1 > 0.0)) {
            share = slope > 0.0 ? -w1 / (slope + root) : (root - slope) / -steepness;
        }
        out.count = 1;
        out.enters = enters;
        out.one = (segment.y + lesser64(greater64(share, 0.0), 1.0) * dz - line->z) / d;
    }
#else
    const double side = corner_side(line, segment.x, segment.y), other = corner_side(line, segment.z, segment.w);
    if ((side > 0.0) != (other > 0.0) && (side > other || !entries_only)) {
        const double share = side / (side - other);
        const double y = segment.x + share * dr - line->first, z = segment.y + share * dz - line->z;
        out.count = 1;
        out.enters = side > other;
        out.one = (y * line->across + z * line->along) / line->square;
    }
#endif
    return out;
}

// Whether a line may pass the box of a node of the tree. The box is enlarged by `margin`; only the line between
// t = first and last counts.
static inline int passes_node(
    const Arrays *arrays, const WallLine *line, int node, double margin, double first, double last)
{
#if GEOMETRY == VOLUME
    const double4 low = vload4(2 * node, arrays->wall_boxes), high = vload4(2 * node + 1, arrays->wall_boxes);
    return passes_volume_box(line, low.xyz, high.xyz, margin, first, last);
#else
    return passes_box(line, vload4(node, arrays->wall_boxes), margin, first, last);
#endif
}

// Crossings of a line with a piece of the surface.
static inline Crossings piece_crossings(const Arrays *arrays, const WallLine *line, int piece)
{
#if GEOMETRY == VOLUME
    const double4 a = vload4(3 * piece, arrays->wall), b = vload4(3 * piece + 1, arrays->wall);
    return triangle_crossing(line, a.xyz, b.xyz, vload4(3 * piece + 2, arrays->wall).xyz);
#else
    return segment_crossings(line, vload4(piece, arrays->wall), 0);
#endif
}

// WallMeeting of a line with the body between t = first and last.
static inline WallMeeting meet_wall(
    const Field *field, const Arrays *arrays, const WallLine *line, double first, double last)
{
    WallMeeting found = {NEVER, NEVER, 0, 0};
    int node = 0;
    while (node < field->wall_count) {
        const int3 links = vload3(node, arrays->wall_links);
        int next = links.x;
        if (passes_node(arrays, line, node, 0.0, first, last)) {
            next = node + 1;
            for (int k = links.y; k < links.z; k++) {
                const Crossings at = piece_crossings(arrays, line, k);
                for (int j = 0; j < at.count; j++) {
                    const double t = j == 0 ? at.one : at.two;
                    const int enters = j == 0 ? at.enters : !at.enters;
                    if (t >= first && t <= last) {
                        found.odd = !found.odd;
                        found.entry = enters ? lesser64(found.entry, t) : found.entry;
                        if (!enters && t < found.exit) {
                            found.exit = t;
                            found.piece = k;
                        }
                    }
                }
            }
        }
        node = next;
    }
    return found;
}

#endif
