"""Warp kernels that examine new values on known nodes, for tracing/pupil/new_values.py.

Their OpenCL twins are the kernels of the same names in kernels/, whose comments describe the arguments.
"""

import warp as wp

from ..types import takes


@wp.kernel(enable_backward=False)
@takes("rule_in_blocks")
def rule_in_blocks(fourth_in, table, scales, first_place, missed_out):
    """The rule's own bound in each block, per metre of path: the fourth derivatives of a structure with one normal."""
    place = wp.tid() + first_place
    root = wp.sqrt(wp.sqrt(scales[0] * fourth_in[place]))
    root += wp.sqrt(wp.sqrt(scales[1] * fourth_in[table + place]))
    root += wp.sqrt(wp.sqrt(scales[2] * fourth_in[2 * table + place]))
    square = root * root
    missed_out[place] = square * square


@wp.kernel(enable_backward=False)
@takes("missed_in_layers")
def missed_in_layers(
    missed_in,
    begin,
    layer_pitch,
    row_count,
    row_pitch,
    row_width,
    column_count,
    column_pitch,
    column_width,
    first_place,
    greatest_out,
):
    """The greatest error that a ray may meet in each layer of blocks."""
    place = wp.tid() + first_place
    line = place // column_count
    column = place - line * column_count
    layer = line // row_count
    row = line - layer * row_count
    corner = begin + layer * layer_pitch + row * row_pitch + column * column_pitch
    greatest = wp.float64(0.0)
    for i in range(row_width):
        for j in range(column_width):
            greatest = wp.max(greatest, missed_in[corner + i * row_pitch + j * column_pitch])
    greatest_out[place] = greatest


@wp.kernel(enable_backward=False)
@takes("missed_around")
def missed_around(
    missed_in, tables_in, potential_begin, first_count, second_count, third_count, blocks_in, first_place, greatest_out
):
    """The greatest error and the greatest potential in blocks and in those adjacent to them."""
    place = wp.tid() + first_place
    row = blocks_in[place] // third_count
    third = blocks_in[place] - row * third_count
    first = row // second_count
    second = row - first * second_count
    missed = wp.float64(0.0)
    potential = wp.float64(0.0)
    for i in range(wp.max(first - 1, 0), wp.min(first + 2, first_count)):
        for j in range(wp.max(second - 1, 0), wp.min(second + 2, second_count)):
            for k in range(wp.max(third - 1, 0), wp.min(third + 2, third_count)):
                block = (i * second_count + j) * third_count + k
                missed = wp.max(missed, missed_in[block])
                potential = wp.max(potential, tables_in[potential_begin + block])
    greatest_out[2 * place] = missed
    greatest_out[2 * place + 1] = potential


@wp.kernel(enable_backward=False)
@takes("greatest_outside")
def greatest_outside(
    values_in,
    first_count,
    second_count,
    third_count,
    first_low,
    first_high,
    second_low,
    second_high,
    third_low,
    third_high,
    first_place,
    greatest_out,
):
    """The greatest size of a grid's values outside a part of it, for each node of the last two axes."""
    place = wp.tid() + first_place
    second = place // third_count
    third = place - second * third_count
    beside = second < second_low or second > second_high or third < third_low or third > third_high
    greatest = wp.float64(0.0)
    for first in range(first_count):
        if beside or first < first_low or first > first_high:
            greatest = wp.max(greatest, wp.abs(values_in[first * second_count * third_count + place]))
    greatest_out[place] = greatest
