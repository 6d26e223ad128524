"""The Warp kernel that interpolates rays of a two-parameter family between traced rays.

It uses the table of tasks/family.py, one lookup per ray. tests/tracing/bundle/bundle_delivery.py has the same
formulas in NumPy.
"""

import warp as wp

from aerokernels.tracing.engines.field_data import SHAPES, STOPS
from aerokernels.tracing.tasks.family import EQUAL, FAR

from ....lines import FACES
from ....plan import output_mask
from ....stop import NOT_DELIVERED, RayStatus
from ..library import TYPES, Scene, built_once
from .outputs import build_write_outputs

# The outputs that a block's header has for all its rays.
# Per thread of a GPU; more, as the compiler would take, or fewer make the kernel slower.
MOST_REGISTERS = 128
COSTS = output_mask(frozenset(("step_error", "step_count", "evaluation_count")))


BoxCrossing = TYPES["float64"].kinds["BoxCrossing"]
FACE_COUNT = len(FACES)
PLANAR, AXISYMMETRIC, VOLUME = (SHAPES[name] for name in ("planar", "axisymmetric", "volume"))
NO_STOP, PLANE = STOPS["none"], STOPS["plane"]


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


# A node has four numbers for each channel: value, slope along u, slope along v, mixed slope; a block has five by five
# nodes. `part_of` sums one of the four numbers over the nodes about a place. A GPU fetches every cache line that a load
# of a warp touches, and a thread that loads the sixteen numbers of its own cell touches lines of its own with each
# load. So four neighbouring threads of a whole warp sum the patches of their four rays together: each takes one of the
# four numbers, then they exchange and add the parts, each keeping the parts of half of the rays, and then once more.
IN_PATCH = """
    typedef wp::vec_t<COUNT, REAL> channels;
    const auto load = [](const REAL *from, REAL *to) {
#if defined(__CUDA_ARCH__)
        const int wide = sizeof(WIDE) / sizeof(REAL);
        if (COUNT % wide == 0) {
#pragma unroll
            for (int k = 0; k < COUNT; k += wide) {
                const WIDE several = __ldg(reinterpret_cast<const WIDE *>(from + k));
                const REAL *each = reinterpret_cast<const REAL *>(&several);
#pragma unroll
                for (int n = 0; n < wide; n++) {
                    to[k + n] = each[n];
                }
            }
            return;
        }
#endif
        for (int k = 0; k < COUNT; k++) {
            to[k] = from[k];
        }
    };
    const auto part_of = [&](int number, int at, REAL u, REAL v) {
        const REAL one = REAL(1), two = REAL(2), three = REAL(3), p = one - u, q = one - v;
        const bool u_slope = number & 1, v_slope = number & 2;
        const REAL u0 = u_slope ? u * p * p : (one + two * u) * p * p;
        const REAL u1 = u_slope ? -u * u * p : u * u * (three - two * u);
        const REAL v0 = v_slope ? v * q * q : (one + two * v) * q * q;
        const REAL v1 = v_slope ? -v * v * q : v * v * (three - two * v);
        const REAL w00 = u0 * v0, w01 = u0 * v1, w10 = u1 * v0, w11 = u1 * v1;
        const REAL *first = patches.data + COUNT * (at + number);
        REAL n00[COUNT], n01[COUNT], n10[COUNT], n11[COUNT];
        load(first, n00);
        load(first + 4 * COUNT, n01);
        load(first + 20 * COUNT, n10);
        load(first + 24 * COUNT, n11);
        channels sum;
#pragma unroll
        for (int k = 0; k < COUNT; k++) {
            sum[k] = w00 * n00[k] + w01 * n01[k] + w10 * n10[k] + w11 * n11[k];
        }
        return sum;
    };
#if defined(__CUDA_ARCH__)
    if (__activemask() == 0xffffffffu) {
        const int thread = threadIdx.x & 31, number = thread & 3, first = thread & ~3;
        channels part[4];
#pragma unroll
        for (int ray = 0; ray < 4; ray++) {
            const int its_at = __shfl_sync(0xffffffffu, at, first + ray);
            const REAL its_u = __shfl_sync(0xffffffffu, u, first + ray);
            const REAL its_v = __shfl_sync(0xffffffffu, v, first + ray);
            part[ray] = part_of(number, its_at, its_u, its_v);
        }
        const bool odd = number & 1, high = number & 2;
        channels found;
#pragma unroll
        for (int k = 0; k < COUNT; k++) {
            const REAL given = odd ? part[0][k] : part[1][k], last_given = odd ? part[2][k] : part[3][k];
            const REAL two_first = (odd ? part[1][k] : part[0][k]) + __shfl_xor_sync(0xffffffffu, given, 1);
            const REAL two_last = (odd ? part[3][k] : part[2][k]) + __shfl_xor_sync(0xffffffffu, last_given, 1);
            found[k] = (high ? two_last : two_first) + __shfl_xor_sync(0xffffffffu, high ? two_first : two_last, 2);
        }
        return found;
    }
#endif
    const channels p0 = part_of(0, at, u, v), p1 = part_of(1, at, u, v);
    const channels p2 = part_of(2, at, u, v), p3 = part_of(3, at, u, v);
    channels found;
    for (int k = 0; k < COUNT; k++) {
        found[k] = (p0[k] + p1[k]) + (p2[k] + p3[k]);
    }
    return found;
"""


@built_once("channels")
def build_in_patch(scene: Scene):
    """Build a function (patches, at, u, v) -> the channels of a patch.

    (u, v) is the place in a cell, each from 0 to 1; `at` is the entry of the cell's first node, in units of
    `channel_count` numbers.
    """
    real, channel_count = scene.types.real, scene.channels
    # What a thread of a GPU loads at once, if so many channels are a multiple of it.
    wide = {"float32": "float4", "float64": "double2"}[scene.precision]
    names = {"REAL": f"wp::{scene.precision}", "WIDE": wide, "COUNT": str(channel_count)}
    source = IN_PATCH
    for name, value in names.items():
        source = source.replace(name, value)

    @wp.func_native(source)
    def in_patch(patches: wp.array(dtype=real), at: int, u: real, v: real) -> wp.types.vector(channel_count, real): ...

    return in_patch


@built_once("channels")
def build_bundle_kernel(scene: Scene):
    """Build the kernel for patches with 1, 4 or 8 channels (tasks/family.py)."""
    t, channel_count = scene.types, scene.channels
    real, Arrival = t.real, t.Arrival
    in_patch, write_outputs = build_in_patch(scene), build_write_outputs(scene)
    ok = int(RayStatus.OK)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=MOST_REGISTERS)
    def deliver_bundle(
        block_map: wp.array(dtype=wp.int32),
        header: wp.array(dtype=wp.float64),
        patches: wp.array(dtype=real),
        frame: wp.array(dtype=wp.float64),
        map_u: int,
        map_v: int,
        converges: int,
        stop: int,
        shape: int,
        checks_faces: int,
        faces_that_matter: int,
        requested: int,
        first_ray: int,
        position_in: wp.array(dtype=wp.vec3d),
        direction_in: wp.array(dtype=wp.vec3d),
        outputs: t.RayOutputs,
    ):
        ray = wp.tid() + first_ray
        p = position_in[ray]
        d = direction_in[ray]
        zero = wp.float64(0.0)
        parameters = family_parameters(frame, converges, p, d)
        place_u = (parameters[0] - frame[0]) * frame[2]
        place_v = (parameters[1] - frame[1]) * frame[3]
        good = parameters[2] > zero and place_u >= zero and place_v >= zero
        good = good and place_u < wp.float64(map_u) and place_v < wp.float64(map_v)
        block = int(-1)
        if good:
            block = block_map[int(place_u) * map_v + int(place_v)]
        length = zero
        if block >= 0:
            line = undisturbed_length(frame, stop, shape, checks_faces, faces_that_matter, p, d)
            length = line[0]
            good = length > zero and length < wp.float64(wp.static(FAR))
            good = good and (checks_faces == 0 or line[1] == header[8 * block + 4])
        # A ray without a patch looks one up all the same: threads of a GPU do so together.
        good = good and block >= 0
        head = int(0)
        if good:
            head = 8 * block
        u = (parameters[0] - header[head]) * header[head + 2]
        v = (parameters[1] - header[head + 1]) * header[head + 3]
        i = wp.clamp(int(u), 0, 3)
        j = wp.clamp(int(v), 0, 3)
        at = int(0)
        if good:
            at = 4 * ((block * 5 + i) * 5 + j)
        found = in_patch(patches, at, real(u - wp.float64(i)), real(v - wp.float64(j)))
        if not good:
            outputs.status[ray] = wp.static(NOT_DELIVERED)
            return

        arrival = Arrival()
        arrival.opd = wp.float64(found[0])
        if wp.static(channel_count > 1):
            turned = d + wp.vec3d(wp.float64(found[1]), wp.float64(found[2]), wp.float64(found[3]))
            arrival.direction = turned / wp.sqrt(wp.dot(turned, turned))
        if wp.static(channel_count > 4):
            moved = wp.vec3d(wp.float64(found[4]), wp.float64(found[5]), wp.float64(found[6]))
            arrival.position = p + length * d + moved
            arrival.arc_length = length + wp.float64(found[7])
        arrival.optical_path = frame[39] * length + arrival.opd
        arrival.status = int(ok)
        step_error = zero
        step_count = int(0)
        evaluation_count = int(0)
        if (requested & wp.static(COSTS)) != 0:
            step_error = header[head + 5]
            step_count = int(header[head + 6])
            evaluation_count = int(header[head + 7])
        write_outputs(outputs, requested, ray, arrival, step_error, step_count, evaluation_count)

    return deliver_bundle
