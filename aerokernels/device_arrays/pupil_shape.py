"""Equal-area map of the unit square to a pupil on the device: see aerokernels/pupils/square_map.py."""

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
