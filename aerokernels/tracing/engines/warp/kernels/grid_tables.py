"""Warp kernels that prepare a grid: its spline, and the greatest values in blocks of cells (tracing/grid_tables.py)."""

import warp as wp

# Nodes that are read ahead of the elimination of a spline: each step would otherwise wait for a GPU's memory. Warp
# unrolls loops of up to 16.
AHEAD = 16  # speed only
Ahead = wp.types.vector(length=AHEAD, dtype=wp.float64)

Doubles = wp.array(dtype=wp.float64)


@wp.func
def value_at(values_in: Doubles, place: int, ambient: wp.float64) -> wp.float64:
    """A value; if `ambient` is above 0, the value is a contrast m, and the result its potential m (ambient + m / 2)."""
    value = values_in[place]
    if ambient > wp.float64(0.0):
        value = value * (ambient + wp.float64(0.5) * value)
    return value


@wp.kernel(enable_backward=False)
def spline_lines(
    values_in: Doubles,
    inverse_in: Doubles,
    count: int,
    pitch: int,
    even: int,
    ambient: wp.float64,
    first_line: int,
    coefficients_out: Doubles,
):
    """Solve for the coefficients of the cubic spline through the values of a line, by elimination: medium/spline.py."""
    line = wp.tid() + first_line
    two = wp.float64(2.0)
    four = wp.float64(4.0)
    six = wp.float64(6.0)
    outer = line // pitch
    inner = line - outer * pitch
    value = outer * count * pitch + inner
    made = outer * (count + 2) * pitch + inner
    last = count - 1
    first = int(3)
    before = six * value_at(values_in, value, ambient)
    if even != 0:
        first = int(2)
        coefficients_out[made + pitch] = before
    else:
        near = value_at(values_in, value, ambient)
        second = value_at(values_in, value + pitch, ambient)
        third = value_at(values_in, value + 2 * pitch, ambient)
        before = second - (near - two * second + third) / six
        coefficients_out[made + 2 * pitch] = before
    ahead = Ahead()
    pivots = Ahead()
    begin = first
    while begin < last:
        for k in range(AHEAD):
            node = wp.min(begin + k, last - 1) - 1
            ahead[k] = value_at(values_in, value + node * pitch, ambient)
            pivots[k] = inverse_in[node]
        for k in range(AHEAD):
            if begin + k < last:
                before = six * ahead[k] - before * pivots[k]
                coefficients_out[made + (begin + k) * pitch] = before
        begin += AHEAD
    outermost = value_at(values_in, value + last * pitch, ambient)
    inward = value_at(values_in, value + (last - 1) * pitch, ambient)
    further = value_at(values_in, value + (last - 2) * pitch, ambient)
    after = inward - (further - two * inward + outermost) / six
    coefficients_out[made + last * pitch] = after
    begin = last - 1
    while begin >= first:
        for k in range(AHEAD):
            row = wp.max(begin - k, first)
            ahead[k] = coefficients_out[made + row * pitch]
            pivots[k] = inverse_in[row]
        for k in range(AHEAD):
            if begin - k >= first:
                after = (ahead[k] - after) * pivots[k]
                coefficients_out[made + (begin - k) * pitch] = after
        begin -= AHEAD
    if even != 0:
        mirrored = coefficients_out[made + 2 * pitch]
        coefficients_out[made + pitch] = wp.float64(0.25) * (coefficients_out[made + pitch] - two * mirrored)
        coefficients_out[made] = mirrored
    else:
        for back in range(2):
            row = 1 - back
            nearer = coefficients_out[made + (row + 1) * pitch]
            beyond = coefficients_out[made + (row + 2) * pitch]
            coefficients_out[made + row * pitch] = (
                six * value_at(values_in, value + row * pitch, ambient) - four * nearer - beyond
            )
    for row in range(last + 1, last + 3):
        nearer = coefficients_out[made + (row - 1) * pitch]
        beyond = coefficients_out[made + (row - 2) * pitch]
        coefficients_out[made + row * pitch] = (
            six * value_at(values_in, value + (row - 2) * pitch, ambient) - four * nearer - beyond
        )


@wp.func
def fourth_difference(
    coefficients_in: Doubles, place: int, stride: int, node: int, count: int, even: int
) -> wp.float64:
    """Size of the fourth difference about the entry of a node; 0 at an end of an axis that is not mirrored there."""
    if node >= count - 1 or (node == 0 and even == 0):
        return wp.float64(0.0)
    four = wp.float64(4.0)
    before = -2
    if node == 0:
        before = 2
    change = (
        coefficients_in[place + before * stride]
        - four * coefficients_in[place - stride]
        + wp.float64(6.0) * coefficients_in[place]
        - four * coefficients_in[place + stride]
        + coefficients_in[place + 2 * stride]
    )
    return wp.abs(change)


@wp.kernel(enable_backward=False)
def column_maxima(
    coefficients_in: Doubles,
    values_in: Doubles,
    first_count: int,
    second_count: int,
    third_count: int,
    block: int,
    even: int,
    ambient: wp.float64,
    first_place: int,
    maxima_out: Doubles,
):
    """Greatest fourth differences and potential over the nodes of blocks along two axes, for nodes of the third.

    A grid of two axes has a first_count of 1 and one layer of coefficients. `even` is 1 where the second axis is
    mirrored at its first node.
    """
    place = wp.tid() + first_place
    blocks = (second_count - 2) // block + 1
    row = place // third_count
    third = place - row * third_count
    first = row // blocks * block
    second = (row - row // blocks * blocks) * block
    pitch = third_count + 2
    plane = (second_count + 2) * pitch
    before_first = wp.min(first_count - 1, 1)
    along_first = wp.float64(0.0)
    along_second = wp.float64(0.0)
    along_third = wp.float64(0.0)
    potential = wp.float64(0.0)
    for i in range(first, wp.min(first + block, first_count - 1) + 1):
        for j in range(second, wp.min(second + block, second_count - 1) + 1):
            c = (i + before_first) * plane + (j + 1) * pitch + third + 1
            value = value_at(values_in, (i * second_count + j) * third_count + third, ambient) / ambient
            along_first = wp.max(along_first, fourth_difference(coefficients_in, c, plane, i, first_count, 0))
            along_second = wp.max(along_second, fourth_difference(coefficients_in, c, pitch, j, second_count, even))
            along_third = wp.max(along_third, fourth_difference(coefficients_in, c, 1, third, third_count, 0))
            potential = wp.max(potential, wp.abs(value))
    table = (wp.max(first_count - 2, 0) // block + 1) * blocks * third_count
    maxima_out[place] = along_first
    maxima_out[table + place] = along_second
    maxima_out[2 * table + place] = along_third
    maxima_out[3 * table + place] = potential


@wp.kernel(enable_backward=False)
def block_maxima(values_in: Doubles, count: int, pitch: int, block: int, first_place: int, maxima_out: Doubles):
    """Greatest size of the values at the nodes of each block along an axis."""
    place = wp.tid() + first_place
    blocks = wp.max(count - 2, 0) // block + 1
    row = place // pitch
    inner = place - row * pitch
    outer = row // blocks
    first = (row - outer * blocks) * block
    greatest_size = wp.float64(0.0)
    for node in range(first, wp.min(first + block, count - 1) + 1):
        greatest_size = wp.max(greatest_size, wp.abs(values_in[(outer * count + node) * pitch + inner]))
    maxima_out[place] = greatest_size


@wp.kernel(enable_backward=False)
def round_coefficients(values_in: Doubles, first_place: int, values_out: wp.array(dtype=wp.float32)):
    """Round coefficients for kernels in single precision."""
    place = wp.tid() + first_place
    values_out[place] = wp.float32(values_in[place])
