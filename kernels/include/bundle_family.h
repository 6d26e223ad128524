// Whether a ray belongs to a family of two parameters, and its undisturbed line through the box. See
// aerokernels/tracing/tasks/family.py.
#ifndef BUNDLE_FAMILY_H
#define BUNDLE_FAMILY_H

#include "options.h"
#include "real.h"

#define NOT_DELIVERED -1
#define FAR 1e300
#define EQUAL_DIRECTIONS 4e-15
#define FACES 7

// Numbers of `frame`, in the order of bundle/frame.py.
#define FRAME_LOW_U frame[0]
#define FRAME_LOW_V frame[1]
#define FRAME_RATE_U frame[2]
#define FRAME_RATE_V frame[3]
#define FRAME_ORIGIN vload3(0, frame + 4)
#define FRAME_AXIS_U vload3(0, frame + 7)
#define FRAME_AXIS_V vload3(0, frame + 10)
#define FRAME_AXIS vload3(0, frame + 13)
#define FRAME_START_POINT vload3(0, frame + 16)
#define FRAME_START_NORMAL vload3(0, frame + 19)
#define FRAME_HAS_START_PLANE frame[22]
#define FRAME_AHEAD frame[23]
#define FRAME_CLOSE frame[24]
#define FRAME_LEAST_COSINE frame[25]
#define FRAME_STOP_POINT vload3(0, frame + 26)
#define FRAME_STOP_NORMAL vload3(0, frame + 29)
#define FRAME_STOP_LENGTH frame[32]
#define FRAME_BOX_LOW(axis) frame[33 + (axis)]
#define FRAME_BOX_HIGH(axis) frame[36 + (axis)]
#define FRAME_AMBIENT frame[39]
#define FRAME_MARGIN frame[40]

// The parameters of a ray, and whether it belongs to the family (1 or 0).
static inline int family_parameters(
    __global const double *frame, int converges, double3 p, double3 d, double2 *parameters)
{
    const double3 axis = FRAME_AXIS, from = p - FRAME_ORIGIN;
    const double close = FRAME_CLOSE;
    int good;
    if (converges) {
        const double along = dot(d, axis);
        const double3 beside = from - dot(from, d) * d;
        good = dot(beside, beside) <= close * close && along >= FRAME_LEAST_COSINE;
        *parameters = (double2)(dot(d, FRAME_AXIS_U), dot(d, FRAME_AXIS_V)) / along;
    } else {
        const double3 turned = fabs(d - axis);
        good = turned.x <= EQUAL_DIRECTIONS && turned.y <= EQUAL_DIRECTIONS && turned.z <= EQUAL_DIRECTIONS;
        *parameters = (double2)(dot(from, FRAME_AXIS_U), dot(from, FRAME_AXIS_V));
    }
    int starts;
    if (FRAME_HAS_START_PLANE > 0.0) {
        starts = fabs(dot(p - FRAME_START_POINT, FRAME_START_NORMAL)) <= close;
    } else {
        starts = fabs(from.x) <= close && fabs(from.y) <= close && fabs(from.z) <= close;
    }
    return good && (starts || dot(p, axis) <= FRAME_AHEAD);
}

// Distances along a line at which it enters and leaves the box [m], and the faces by which it does.
typedef struct {
    double enter;
    double leave;
    int entry_face;
    int exit_face;
} BoxCrossing;

// The part of the line in the box that is also between two more faces.
static inline BoxCrossing narrowed(BoxCrossing crossing, double first, double last, int first_face, int last_face)
{
    crossing.entry_face = first > crossing.enter ? first_face : crossing.entry_face;
    crossing.enter = first > crossing.enter ? first : crossing.enter;
    crossing.exit_face = last < crossing.leave ? last_face : crossing.exit_face;
    crossing.leave = last < crossing.leave ? last : crossing.leave;
    return crossing;
}

// Where a line crosses the box.
static inline BoxCrossing box_crossing(__global const double *frame, int shape, double3 p, double3 d)
{
    BoxCrossing crossing;
    crossing.enter = -FAR;
    crossing.leave = FAR;
    crossing.entry_face = crossing.exit_face = -1;
    for (int axis = shape == VOLUME ? 0 : shape == PLANAR ? 1 : 2; axis < 3; axis++) {
        const double place = pick64(p, axis), rate = pick64(d, axis);
        const double low = FRAME_BOX_LOW(axis), high = FRAME_BOX_HIGH(axis);
        if (rate == 0.0) {
            if (place < low || place > high) {
                crossing.leave = -FAR;
            }
            continue;
        }
        const double to_low = (low - place) / rate, to_high = (high - place) / rate;
        const int up = rate > 0.0;
        crossing = narrowed(crossing, up ? to_low : to_high, up ? to_high : to_low, 2 * axis + !up, 2 * axis + up);
    }
    if (shape == AXISYMMETRIC) {
        const double square = d.x * d.x + d.y * d.y, radius = FRAME_BOX_HIGH(0);
        if (square > 0.0) {
            const double middle = -(p.x * d.x + p.y * d.y) / square;
            const double x = p.x + middle * d.x, y = p.y + middle * d.y;
            const double rest = radius * radius - (x * x + y * y);
            const double chord = sqrt(greater64(rest, 0.0) / square);
            crossing = narrowed(crossing, middle - chord, middle + chord, 6, 6);
            crossing.leave = rest < 0.0 ? -FAR : crossing.leave;
        } else if (p.x * p.x + p.y * p.y > radius * radius) {
            crossing.leave = -FAR;
        }
    }
    return crossing;
}

// Distance from the other faces at which a line leaves the box [m].
static inline double depth_at_exit(__global const double *frame, int shape, double3 p, double3 d, BoxCrossing crossing)
{
    const double3 place = p + crossing.leave * d;
    double depth = FAR;
    for (int axis = shape == VOLUME ? 0 : shape == PLANAR ? 1 : 2; axis < 3; axis++) {
        if (crossing.exit_face >> 1 != axis || crossing.exit_face == 6) {
            const double at = pick64(place, axis);
            depth = lesser64(depth, lesser64(at - FRAME_BOX_LOW(axis), FRAME_BOX_HIGH(axis) - at));
        }
    }
    if (shape == AXISYMMETRIC && crossing.exit_face != 6) {
        depth = lesser64(depth, FRAME_BOX_HIGH(0) - sqrt(place.x * place.x + place.y * place.y));
    }
    return depth;
}

// Distance to the stop along the undisturbed line [m], not positive without a stop; number of its pair of faces. The
// pair is the face by which the line enters the box and the face by which it leaves.
static inline double undisturbed_length(
    __global const double *frame,
    int stop,
    int shape,
    int checks_faces,
    int faces_that_matter,
    double3 p,
    double3 d,
    int *number)
{
    double length = FRAME_STOP_LENGTH;
    if (stop == PLANE) {
        const double3 normal = FRAME_STOP_NORMAL;
        length = dot(FRAME_STOP_POINT - p, normal) / dot(d, normal);
    }
    if (stop != NONE && !checks_faces) {
        return length;
    }
    const BoxCrossing crossing = box_crossing(frame, shape, p, d);
    const double close = FRAME_CLOSE;
    const double enter = greater64(crossing.enter, 0.0);
    if (crossing.leave < enter) {
        *number = stop == NONE ? -1 : (FACES + 2) * (FACES + 3);
        return stop == NONE ? -1.0 : length;
    }
    // A line that begins in the box is like one that enters through the face behind it, if that does not matter.
    const int behind = crossing.entry_face;
    const int enters = behind >= 0 && !((faces_that_matter >> behind) & 1) ? FACES + 1
        : enter <= close ? FACES : behind;
    int leaves = crossing.exit_face;
    if (stop == NONE) {
        length = crossing.leave;
    } else if (length < crossing.leave - close) {
        leaves = FACES + 1;
    } else if (!((faces_that_matter >> crossing.exit_face) & 1)) {
        leaves = FACES;
    }
    *number = (FACES + 2) * leaves + enters;
    if ((stop == NONE || leaves <= FACES) && depth_at_exit(frame, shape, p, d, crossing) < FRAME_MARGIN) {
        *number = -1;
    }
    return length;
}

#endif
