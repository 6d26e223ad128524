"""Device functions: whether a ray belongs to a family of two parameters, and its undisturbed line through the box.

See bundle/family.py and bundle/nodes.py; bundle/frame.py has the order of the numbers in `frame`.
"""

import warp as wp

from ....bundle.family import EQUAL
from ....bundle.frame import SHAPES, STOPS
from ....bundle.table import FAR
from ....lines import FACES

FACE_COUNT = len(FACES)
PLANAR, AXISYMMETRIC, VOLUME = (SHAPES[name] for name in ("planar", "axisymmetric", "volume"))
NO_STOP, PLANE = STOPS["none"], STOPS["plane"]


@wp.struct
class BoxCrossing:
    """Distances along a line at which it enters and leaves the box [m], and the faces by which it does."""

    enter: wp.float64
    leave: wp.float64
    entry_face: int
    exit_face: int


@wp.func
def frame_vector(frame: wp.array(dtype=wp.float64), first: int) -> wp.vec3d:
    """The three numbers of `frame` from `first` on."""
    return wp.vec3d(frame[first], frame[first + 1], frame[first + 2])


@wp.func
def family_parameters(frame: wp.array(dtype=wp.float64), converges: int, p: wp.vec3d, d: wp.vec3d) -> wp.vec3d:
    """The parameters of a ray, and whether it belongs to the family (1 or 0)."""
    axis = frame_vector(frame, 13)
    from_origin = p - frame_vector(frame, 4)
    close = frame[24]
    good = bool(False)
    u = wp.dot(from_origin, frame_vector(frame, 7))
    v = wp.dot(from_origin, frame_vector(frame, 10))
    if converges != 0:
        along = wp.dot(d, axis)
        beside = from_origin - wp.dot(from_origin, d) * d
        good = wp.dot(beside, beside) <= close * close and along >= frame[25]
        u = wp.dot(d, frame_vector(frame, 7)) / along
        v = wp.dot(d, frame_vector(frame, 10)) / along
    else:
        equal = wp.float64(wp.static(EQUAL))
        turned = d - axis
        good = wp.abs(turned[0]) <= equal and wp.abs(turned[1]) <= equal and wp.abs(turned[2]) <= equal
    starts = bool(False)
    if frame[22] > wp.float64(0.0):
        starts = wp.abs(wp.dot(p - frame_vector(frame, 16), frame_vector(frame, 19))) <= close
    else:
        starts = wp.abs(from_origin[0]) <= close and wp.abs(from_origin[1]) <= close and wp.abs(from_origin[2]) <= close
    starts = starts or wp.dot(p, axis) <= frame[23]
    belongs = wp.float64(0.0)
    if good and starts:
        belongs = wp.float64(1.0)
    return wp.vec3d(u, v, belongs)


@wp.func
def narrowed(
    crossing: BoxCrossing, first: wp.float64, last: wp.float64, first_face: int, last_face: int
) -> BoxCrossing:
    """The part of the line in the box that is also between two more faces."""
    if first > crossing.enter:
        crossing.entry_face = first_face
        crossing.enter = first
    if last < crossing.leave:
        crossing.exit_face = last_face
        crossing.leave = last
    return crossing


@wp.func
def box_crossing(frame: wp.array(dtype=wp.float64), shape: int, p: wp.vec3d, d: wp.vec3d) -> BoxCrossing:
    """Where a line crosses the box."""
    zero = wp.float64(0.0)
    far = wp.float64(wp.static(FAR))
    crossing = BoxCrossing()
    crossing.enter = -far
    crossing.leave = far
    crossing.entry_face = -1
    crossing.exit_face = -1
    first_axis = 0
    if shape == wp.static(PLANAR):
        first_axis = 1
    if shape == wp.static(AXISYMMETRIC):
        first_axis = 2
    for axis in range(first_axis, 3):
        place = p[axis]
        rate = d[axis]
        low = frame[33 + axis]
        high = frame[36 + axis]
        if rate == zero:
            if place < low or place > high:
                crossing.leave = -far
        else:
            to_low = (low - place) / rate
            to_high = (high - place) / rate
            if rate > zero:
                crossing = narrowed(crossing, to_low, to_high, 2 * axis, 2 * axis + 1)
            else:
                crossing = narrowed(crossing, to_high, to_low, 2 * axis + 1, 2 * axis)
    if shape == wp.static(AXISYMMETRIC):
        square = d[0] * d[0] + d[1] * d[1]
        radius = frame[36]
        if square > zero:
            middle = -(p[0] * d[0] + p[1] * d[1]) / square
            x = p[0] + middle * d[0]
            y = p[1] + middle * d[1]
            rest = radius * radius - (x * x + y * y)
            half = wp.sqrt(wp.max(rest, zero) / square)
            crossing = narrowed(crossing, middle - half, middle + half, 6, 6)
            if rest < zero:
                crossing.leave = -far
        elif p[0] * p[0] + p[1] * p[1] > radius * radius:
            crossing.leave = -far
    return crossing


@wp.func
def depth_at_exit(
    frame: wp.array(dtype=wp.float64), shape: int, p: wp.vec3d, d: wp.vec3d, crossing: BoxCrossing
) -> wp.float64:
    """Distance from the other faces at which a line leaves the box [m]."""
    place = p + crossing.leave * d
    depth = wp.float64(wp.static(FAR))
    first_axis = 0
    if shape == wp.static(PLANAR):
        first_axis = 1
    if shape == wp.static(AXISYMMETRIC):
        first_axis = 2
    for axis in range(first_axis, 3):
        if (crossing.exit_face >> 1) != axis or crossing.exit_face == 6:
            depth = wp.min(depth, wp.min(place[axis] - frame[33 + axis], frame[36 + axis] - place[axis]))
    if shape == wp.static(AXISYMMETRIC) and crossing.exit_face != 6:
        depth = wp.min(depth, frame[36] - wp.sqrt(place[0] * place[0] + place[1] * place[1]))
    return depth


@wp.func
def undisturbed_length(
    frame: wp.array(dtype=wp.float64),
    stop: int,
    shape: int,
    checks_faces: int,
    faces_that_matter: int,
    p: wp.vec3d,
    d: wp.vec3d,
) -> wp.vec2d:
    """Distance to the stop along the undisturbed line [m], not positive without a stop; number of its pair of faces.

    The pair is the face by which the line enters the box and the face by which it leaves.
    """
    length = frame[32]
    if stop == wp.static(PLANE):
        normal = frame_vector(frame, 29)
        length = wp.dot(frame_vector(frame, 26) - p, normal) / wp.dot(d, normal)
    if stop != wp.static(NO_STOP) and checks_faces == 0:
        return wp.vec2d(length, wp.float64(0.0))
    crossing = box_crossing(frame, shape, p, d)
    close = frame[24]
    enter = wp.max(crossing.enter, wp.float64(0.0))
    if crossing.leave < enter:
        if stop == wp.static(NO_STOP):
            return wp.vec2d(wp.float64(-1.0), wp.float64(-1.0))
        return wp.vec2d(length, wp.float64(wp.static((FACE_COUNT + 2) * (FACE_COUNT + 3))))
    # A line that begins in the box is like one that enters through the face behind it, if that does not matter.
    enters = crossing.entry_face
    if enter <= close:
        enters = int(wp.static(FACE_COUNT))
    if crossing.entry_face >= 0:
        if ((faces_that_matter >> crossing.entry_face) & 1) == 0:
            enters = int(wp.static(FACE_COUNT + 1))
    leaves = crossing.exit_face
    if stop == wp.static(NO_STOP):
        length = crossing.leave
    elif length < crossing.leave - close:
        leaves = wp.static(FACE_COUNT + 1)
    elif ((faces_that_matter >> crossing.exit_face) & 1) == 0:
        leaves = wp.static(FACE_COUNT)
    number = wp.static(FACE_COUNT + 2) * leaves + enters
    if stop == wp.static(NO_STOP) or leaves <= wp.static(FACE_COUNT):
        if depth_at_exit(frame, shape, p, d, crossing) < frame[40]:
            number = int(-1)
    return wp.vec2d(length, wp.float64(number))
