"""Kernels that make, check and select rays of a bundle, and the map of the unit square to a pupil (square_map.py)."""

import warp as wp

from ..pupils.square_map import PIXEL_HEADER, PIXELS, RING

_RING = wp.constant(RING)
_PIXELS = wp.constant(PIXELS)
_HEADER = wp.constant(PIXEL_HEADER)


@wp.func
def share_of(table_in: wp.array(dtype=wp.float64), begin: int, count: int, value: wp.float64):
    """Return which of `count` intervals of the ascending shares in table_in from `begin` on contains a value."""
    low = int(0)
    high = int(count)
    while high - low > 1:
        middle = (low + high) // 2
        if table_in[begin + middle] <= value:
            low = middle
        else:
            high = middle
    return low


@wp.func
def place_on_pupil(
    shape: int,
    row_count: int,
    column_count: int,
    table_in: wp.array(dtype=wp.float64),
    u: wp.float64,
    v: wp.float64,
):
    """Return the point of the pupil for a point (u, v) of the unit square."""
    if shape == _RING:
        radius = wp.sqrt(table_in[0] + (wp.float64(1.0) - table_in[0]) * u)
        angle = wp.float64(6.283185307179586) * v
        return wp.vec2d(radius * wp.cos(angle), radius * wp.sin(angle))
    if shape == _PIXELS:
        row = share_of(table_in, _HEADER, row_count, v)
        low = table_in[_HEADER + row]
        up = (v - low) / (table_in[_HEADER + row + 1] - low)
        start = _HEADER + row_count + 1 + row * (column_count + 1)
        column = share_of(table_in, start, column_count, u)
        left = table_in[start + column]
        across = (u - left) / (table_in[start + column + 1] - left)
        return wp.vec2d(
            table_in[0] + (wp.float64(column) + across) * table_in[2],
            table_in[1] + (wp.float64(row) + up) * table_in[3],
        )
    one = share_of(table_in, 0, row_count, u)
    outward = wp.sqrt((u - table_in[one]) / (table_in[one + 1] - table_in[one]))
    begin = row_count + 1 + 6 * one
    corner = wp.vec2d(table_in[begin], table_in[begin + 1])
    first = wp.vec2d(table_in[begin + 2], table_in[begin + 3])
    second = wp.vec2d(table_in[begin + 4], table_in[begin + 5])
    return corner + outward * (first + v * (second - first))


# Ways in which `make_rays` turns points of a pupil, or of the unit disc, into rays.
COLLIMATED, FROM_POINT, TO_POINT, DIVERGENT = range(4)
# The bits of a Sobol point, and the weight of its last one.
_BITS = wp.constant(30)
_UNIT = wp.constant(wp.float64(2.0**-30))
# Faults of rays counted by `check_rays`: for each kind the count, then the first ray.
PLACE, WAY, ZERO, FAULTS = 0, 1, 2, 3


@wp.kernel(module="aerokernels_select", enable_backward=False)
def select(
    status: wp.array(dtype=wp.int32),
    code: int,
    has_error: int,
    error: wp.array(dtype=wp.float64),
    limit: wp.float64,
    rows: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
):
    """List rays with a status, or with an error that is not within the limit, unordered, as many as there is room for.

    `count` is the number of all of them.
    """
    ray = wp.tid()
    found = status[ray] == code
    if has_error != 0:
        if not (error[ray] <= limit):
            found = True
    if found:
        place = wp.atomic_add(count, 0, 1)
        if place < rows.shape[0]:
            rows[place] = ray


@wp.kernel(module="aerokernels_rays", enable_backward=False)
def find_extremes(
    values: wp.array(dtype=wp.vec3d),
    stride: int,
    low_out: wp.array(dtype=wp.vec3d),
    high_out: wp.array(dtype=wp.vec3d),
    low_row: wp.array(dtype=wp.vec3i),
    high_row: wp.array(dtype=wp.vec3i),
):
    """Find the least and greatest of each component, and their rows, among every `stride`-th row of a thread."""
    thread = wp.tid()
    low = values[thread]
    high = values[thread]
    at_low = wp.vec3i(thread, thread, thread)
    at_high = wp.vec3i(thread, thread, thread)
    row = thread + stride
    while row < values.shape[0]:
        value = values[row]
        for axis in range(3):
            if value[axis] < low[axis]:
                low[axis] = value[axis]
                at_low[axis] = row
            if value[axis] > high[axis]:
                high[axis] = value[axis]
                at_high[axis] = row
        row += stride
    low_out[thread] = low
    high_out[thread] = high
    low_row[thread] = at_low
    high_row[thread] = at_high


@wp.func
def unit_of(way: wp.vec3d):
    """Normalise a vector that is not zero; a vector that is a unit vector already keeps its bits."""
    if wp.abs(wp.length(way) - wp.float64(1.0)) <= wp.float64(4e-16):
        return way
    # Scaled first: the squared length of a very long or short vector would overflow or underflow.
    scaled = way / wp.max(wp.max(wp.abs(way[0]), wp.abs(way[1])), wp.abs(way[2]))
    return scaled / wp.length(scaled)


@wp.func
def note(faults: wp.array(dtype=wp.int32), kind: int, ray: int):
    """Count a fault, and record the first ray that has it."""
    wp.atomic_add(faults, kind, 1)
    wp.atomic_min(faults, kind + FAULTS, ray)


@wp.kernel(module="aerokernels_rays", enable_backward=False)
def check_rays(
    position: wp.array2d(dtype=wp.float64),
    direction: wp.array2d(dtype=wp.float64),
    faults: wp.array(dtype=wp.int32),
    position_out: wp.array(dtype=wp.vec3d),
    direction_out: wp.array(dtype=wp.vec3d),
):
    """Copy positions and directions, normalise the directions, and count invalid rays."""
    ray = wp.tid()
    row = wp.min(ray, direction.shape[0] - 1)
    place = wp.vec3d(position[ray, 0], position[ray, 1], position[ray, 2])
    way = wp.vec3d(direction[row, 0], direction[row, 1], direction[row, 2])
    if not wp.isfinite(place):
        note(faults, PLACE, ray)
    if not wp.isfinite(way):
        note(faults, WAY, ray)
    elif way == wp.vec3d():
        note(faults, ZERO, ray)
    else:
        way = unit_of(way)
    position_out[ray] = place
    direction_out[ray] = way


@wp.func
def sobol_coordinate(index: wp.uint32, start: wp.uint32, directions: wp.array2d(dtype=wp.uint32), axis: int):
    """Return a coordinate of a scrambled Sobol point: see aerokernels/sobol.py."""
    gray = index ^ (index >> wp.uint32(1))
    point = start
    for bit in range(_BITS):
        if ((gray >> wp.uint32(bit)) & wp.uint32(1)) != wp.uint32(0):
            point = point ^ directions[axis, bit]
    return wp.float64(point) * _UNIT


@wp.kernel(module="aerokernels_rays", enable_backward=False)
def make_rays(
    kind: int,
    flat: wp.array2d(dtype=wp.float64),
    start: wp.array(dtype=wp.uint32),
    directions: wp.array2d(dtype=wp.uint32),
    shape: int,
    row_count: int,
    column_count: int,
    table: wp.array(dtype=wp.float64),
    center: wp.vec3d,
    first: wp.vec3d,
    second: wp.vec3d,
    axis: wp.vec3d,
    scale: wp.float64,
    position_out: wp.array(dtype=wp.vec3d),
    direction_out: wp.array(dtype=wp.vec3d),
):
    """Make rays from points on a pupil or in the unit disc: from `flat`, or a Sobol sequence if `flat` is empty.

    `center`, `first` and `second` are the pupil's centre and axes, or the apex of a cone and the axes across it. `axis`
    is the direction of parallel rays, the common point of rays from or to a point, or the axis of a cone. `scale` is
    the pupil's reach, or twice the squared sine of half the cone's half angle.
    """
    ray = wp.tid()
    place = wp.vec2d()
    if flat.shape[0] > 0:
        place = wp.vec2d(flat[ray, 0], flat[ray, 1])
    else:
        u = sobol_coordinate(wp.uint32(ray), start[0], directions, 0)
        v = sobol_coordinate(wp.uint32(ray), start[1], directions, 1)
        place = place_on_pupil(shape, row_count, column_count, table, u, v)
    across = place[0] * first + place[1] * second
    point = center + scale * across
    way = axis
    if kind == FROM_POINT:
        way = unit_of(point - axis)
        point = axis
    elif kind == TO_POINT:
        way = unit_of(axis - point)
    elif kind == DIVERGENT:
        # Equal areas of the disc are equal solid angles: 1 - cos(polar) is linear in the disc's r^2.
        squared = wp.dot(place, place)
        lag = squared * scale
        way = (wp.float64(1.0) - lag) * axis
        if squared > wp.float64(0.0):
            way = way + wp.sqrt(lag * (wp.float64(2.0) - lag)) / wp.sqrt(squared) * across
        way = unit_of(way)
        point = center
    position_out[ray] = point
    direction_out[ray] = way
