"""Warp kernels of a pupil with many rays: scrambled Sobol or lattice points, and sums over groups of rays.

Points are the two-dimensional Sobol sequence (bit reversal, and the sequence of x + 1) with a nested uniform scramble
by hashing (B. Burley, Practical hash-based Owen scrambling, JCGT 9-4 (2020)), one seed per replicate and axis. Equal
areas of the unit square map to equal shares of the pupil (device_arrays/kernels.py).
"""

import warp as wp

from aerokernels.tracing.tasks.sums import MOMENT_COUNT, SUM_COUNT

from .....device_arrays.kernels import place_on_pupil
from ....scheme import GROUP, HASHES, REDUCTION_WIDTH
from ....stop import RayStatus

# 32-bit constants get their type here: a literal inside a kernel would pass through a signed integer.
_HASH_1 = wp.constant(wp.uint32(HASHES[0]))
_HASH_2 = wp.constant(wp.uint32(HASHES[1]))
_HASH_3 = wp.constant(wp.uint32(HASHES[2]))
_HASH_4 = wp.constant(wp.uint32(HASHES[3]))
_TOP_BIT = wp.constant(wp.uint32(0x80000000))
_OK = wp.constant(int(RayStatus.OK))
_LEFT_DISTURBED_AIR = wp.constant(int(RayStatus.LEFT_DISTURBED_AIR))
_TOLERANCE_NOT_MET = wp.constant(int(RayStatus.TOLERANCE_NOT_MET))
_GROUP = wp.constant(GROUP)
_MOMENTS = wp.constant(MOMENT_COUNT)
_SUMS = wp.constant(SUM_COUNT)
_HALF = wp.constant(SUM_COUNT // 2)
_WORST = wp.constant(10)  # of the moments the greatest error, which is a maximum and no sum
_REDUCTION_WIDTH = wp.constant(REDUCTION_WIDTH)

Doubles = wp.array(dtype=wp.float64)
Ints = wp.array(dtype=wp.int32)
Sums = wp.types.vector(length=SUM_COUNT, dtype=wp.float64)


# Threads of a warp, all of them active: kernels that use these functions are launched over whole warps.
WARP = 32


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return threadIdx.x & 31;
#else
    return 0;
#endif
""")
def place_in_team() -> int:
    """Number of this thread in its team."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 1;
#endif
""")
def team_size() -> int:
    """Number of threads that share a group of rays."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int way = 16; way > 0; way /= 2) {
        part += __shfl_xor_sync(0xffffffffu, part, way);
    }
#endif
    return part;
""")
def sum_of_team(part: wp.float64) -> wp.float64:
    """The sum of `part` over the threads of a team."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int way = 16; way > 0; way /= 2) {
        part = fmax(part, __shfl_xor_sync(0xffffffffu, part, way));
    }
#endif
    return part;
""")
def greatest_of_team(part: wp.float64) -> wp.float64:
    """The greatest `part` of the threads of a team."""
    ...


@wp.func
def reverse_bits(x: wp.uint32):
    """The 32 bits of x in reverse order."""
    x = ((x >> wp.uint32(1)) & wp.uint32(0x55555555)) | ((x & wp.uint32(0x55555555)) << wp.uint32(1))
    x = ((x >> wp.uint32(2)) & wp.uint32(0x33333333)) | ((x & wp.uint32(0x33333333)) << wp.uint32(2))
    x = ((x >> wp.uint32(4)) & wp.uint32(0x0F0F0F0F)) | ((x & wp.uint32(0x0F0F0F0F)) << wp.uint32(4))
    x = ((x >> wp.uint32(8)) & wp.uint32(0x00FF00FF)) | ((x & wp.uint32(0x00FF00FF)) << wp.uint32(8))
    return (x >> wp.uint32(16)) | (x << wp.uint32(16))


@wp.func
def scramble(x: wp.uint32, seed: wp.uint32):
    """Nested uniform scramble of a fraction."""
    x = reverse_bits(x)
    x = x + seed
    x = x ^ (x * _HASH_1)
    x = x ^ (x * _HASH_2)
    x = x ^ (x * _HASH_3)
    x = x ^ (x * _HASH_4)
    return reverse_bits(x)


@wp.func
def second_axis(index: wp.uint32):
    """Second coordinate of point `index`; the first is reverse_bits(index)."""
    result = wp.uint32(0)
    column = _TOP_BIT
    rest = wp.uint32(index)
    while rest != wp.uint32(0):
        if (rest & wp.uint32(1)) != wp.uint32(0):
            result = result ^ column
        column = column ^ (column >> wp.uint32(1))
        rest = rest >> wp.uint32(1)
    return result


@wp.func
def periodic_place(t: wp.float64):
    """The substitution p(t) of tasks/quadrature.py."""
    return t * t * t * (wp.float64(10.0) + t * (wp.float64(6.0) * t - wp.float64(15.0)))


@wp.func
def periodic_weight(t: wp.float64):
    """The slope of `periodic_place`."""
    half = t * (wp.float64(1.0) - t)
    return wp.float64(30.0) * half * half


@wp.kernel(enable_backward=False)
def launch_pupil(
    center: wp.vec3d,
    first: wp.vec3d,
    second: wp.vec3d,
    look: wp.vec3d,
    to_x: wp.vec3d,
    to_y: wp.vec3d,
    shape: int,
    row_count: int,
    column_count: int,
    table_in: Doubles,
    seeds: wp.array(dtype=wp.uint32),
    order_in: Ints,
    per_replicate: int,
    generator: int,
    smoothed: int,
    first_ray: int,
    position_out: wp.array(dtype=wp.vec3d),
    direction_out: wp.array(dtype=wp.vec3d),
    pupil_out: wp.array(dtype=wp.vec2d),
    weight_out: Doubles,
):
    """Place points on the pupil and launch their rays; `first` and `second` are the pupil's axes times its reach.

    `pupil_out` are coordinates across the look direction, in units of the reach: `to_x` and `to_y` are the rows of
    pupils.across_look.

    Ray r of a replicate is point order_in[r] of the replicate: neighbours in the launch are then neighbours on the
    pupil. With a generator the points are those of a lattice, with weights: see tasks/quadrature.py.
    """
    ray = wp.tid() + first_ray
    replicate = ray // per_replicate
    index = wp.uint32(order_in[ray - replicate * per_replicate])
    unit = wp.float64(2.3283064365386963e-10)
    u = wp.float64(0.0)
    v = wp.float64(0.0)
    if generator > 0:
        count = wp.float64(per_replicate)
        across = wp.int64(index) * wp.int64(generator) % wp.int64(per_replicate)
        u = (wp.float64(index) + (wp.float64(seeds[2 * replicate]) + wp.float64(0.5)) * unit) / count
        v = wp.float64(across) / count + (wp.float64(seeds[2 * replicate + 1]) + wp.float64(0.5)) * unit
        if v >= wp.float64(1.0):
            v = v - wp.float64(1.0)
        weight = wp.float64(1.0)
        if (smoothed & 1) != 0:
            weight = weight * periodic_weight(u)
            u = periodic_place(u)
        if (smoothed & 2) != 0:
            weight = weight * periodic_weight(v)
            v = periodic_place(v)
        weight_out[ray] = weight
    else:
        u = (wp.float64(scramble(reverse_bits(index), seeds[2 * replicate])) + wp.float64(0.5)) * unit
        v = (wp.float64(scramble(second_axis(index), seeds[2 * replicate + 1])) + wp.float64(0.5)) * unit
    place = place_on_pupil(shape, row_count, column_count, table_in, u, v)
    position_out[ray] = center + place[0] * first + place[1] * second
    direction_out[ray] = look
    pupil_out[ray] = wp.vec2d(to_x[0] * place[0] + to_x[1] * place[1], to_y[0] * place[0] + to_y[1] * place[1])


@wp.func
def has_arrived(status: int):
    """Whether a ray of this status reached the stop, see stop.py."""
    return status == _OK or status == _LEFT_DISTURBED_AIR or status == _TOLERANCE_NOT_MET


@wp.func
def weight_of(weight_count: int, weight_in: Doubles, ray: int):
    """The weight of a ray: its own, or the one that all rays share."""
    if weight_count == 1:
        return weight_in[0]
    return weight_in[ray]


@wp.func
def group_span(group: int, per_replicate: int):
    """First ray of a group, and one past its last; a replicate begins with a new group."""
    groups = (per_replicate + _GROUP - 1) // _GROUP
    replicate = group // groups
    begin = (group - replicate * groups) * _GROUP
    first = replicate * per_replicate
    return first + begin, first + wp.min(begin + _GROUP, per_replicate)


@wp.kernel(enable_backward=False)
def sum_rays(
    wave_number: wp.float64,
    plane: wp.vec3d,
    focus: wp.float64,
    per_replicate: int,
    first_group: int,
    weight_count: int,
    weight_in: Doubles,
    pupil_in: wp.array(dtype=wp.vec2d),
    opd_in: Doubles,
    step_error_in: Doubles,
    evaluation_count_in: Ints,
    status_in: Ints,
    sums_out: Doubles,
):
    """Sum moments and phasors of the rays of one group that arrived; kernels/pupil.cl has the order of the sums."""
    group = wp.tid() // team_size() + first_group
    begin, stop = group_span(group, per_replicate)
    sums = Sums()
    for ray in range(begin + place_in_team(), stop, team_size()):
        sums[11] += wp.float64(evaluation_count_in[ray])
        if has_arrived(status_in[ray]):
            p = pupil_in[ray]
            w = opd_in[ray]
            x, y = p[0], p[1]
            q = x * x + y * y
            share = weight_of(weight_count, weight_in, ray)
            sums[0] += share
            sums[1] += share * x
            sums[2] += share * y
            sums[3] += share * w
            sums[4] += share * x * x
            sums[5] += share * x * y
            sums[6] += share * y * y
            sums[7] += share * x * w
            sums[8] += share * y * w
            sums[9] += share * w * w
            sums[12] += share * x * q
            sums[13] += share * y * q
            sums[14] += share * q * q
            sums[15] += share * q * w
            sums[_WORST] = wp.max(sums[_WORST], step_error_in[ray])
            phase = wave_number * (w - (plane[0] + plane[1] * x + plane[2] * y + focus * q))
            sums[_MOMENTS] += share * wp.cos(phase)
            sums[_MOMENTS + 1] += share * wp.sin(phase)
    for half in range(2):
        for k in range(_HALF):  # Warp unrolls both, so that a GPU holds the sums in registers
            number = half * _HALF + k
            whole = sum_of_team(sums[number])
            if number == _WORST:
                whole = greatest_of_team(sums[number])
            if place_in_team() == 0:
                sums_out[group * _SUMS + number] = whole


@wp.kernel(enable_backward=False)
def reduce_sums(row_count: int, reduced_count: int, first_sum: int, sums_in: Doubles, sums_out: Doubles):
    """One level of a tree reduction: reduce row_count rows of each replicate to reduced_count rows.

    Each new row is the sum of REDUCTION_WIDTH rows, in order.
    """
    index = wp.tid() + first_sum
    joined = index // _SUMS
    k = index - joined * _SUMS
    replicate = joined // reduced_count
    first = (joined - replicate * reduced_count) * _REDUCTION_WIDTH
    stop = wp.min(first + _REDUCTION_WIDTH, row_count)
    whole = wp.float64(0.0)
    for row in range(replicate * row_count + first, replicate * row_count + stop):
        part = sums_in[row * _SUMS + k]
        if k == _WORST:
            whole = wp.max(whole, part)
        else:
            whole += part
    sums_out[index] = whole
