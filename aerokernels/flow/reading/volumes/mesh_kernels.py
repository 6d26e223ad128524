"""Warp kernels for volumes on meshes, in float64: weights of values at points and of slopes, densities at nodes.

They run in chunks over host threads: Warp's CPU device runs a launch in one thread and releases the interpreter lock.
"""

import numpy as np
import warp as wp

from aerokernels.device_arrays.launching import launch as warp_launch
from aerokernels.process.machine import core_count
from aerokernels.process.quiet_warp import start_warp
from aerokernels.process.threads import in_threads

Numbers = wp.array[wp.float64]
Vectors = wp.array[wp.vec3d]
Starts = wp.array[wp.int64]
Indices = wp.array[wp.int32]


@wp.kernel(enable_backward=False)
def densities_at_nodes(
    first: int,
    cell_in: Indices,
    start_in: Starts,
    column_in: Indices,
    weight_in: Vectors,
    near_in: Numbers,
    value_in: Numbers,
    middle_in: Vectors,
    origin: wp.vec3d,
    node_start_in: Starts,
    node_in: Indices,
    row_count: int,
    column_count: int,
    spacing: wp.vec3d,
    density_out: Numbers,
):
    """Evaluate each cell's linear function, clamped to its range, at the nodes in it; rows of nodes run along z."""
    held = first + wp.tid()
    value = value_in[cell_in[held]]
    low = value
    high = value
    slope = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for entry in range(int(start_in[held]), int(start_in[held + 1])):
        near = near_in[column_in[entry]]
        # The weights sum to zero: differences keep the digits of a nearly uniform density.
        slope += (near - value) * weight_in[entry]
        low = wp.min(low, near)
        high = wp.max(high, near)
    constant = value - wp.dot(middle_in[held] - origin, slope)
    half = wp.float64(0.5)
    per_row = wp.float64(1.0) / wp.float64(row_count)
    per_column = wp.float64(1.0) / wp.float64(column_count)
    sx = spacing[0] * slope[0]
    sy = spacing[1] * slope[1]
    sz = spacing[2] * slope[2]
    for at in range(int(node_start_in[held]), int(node_start_in[held + 1])):
        node = node_in[at]
        # Integer quotients by faster products: the added half is far above their rounding.
        row = int((wp.float64(node) + half) * per_row)
        i = int((wp.float64(row) + half) * per_column)
        j = row - i * column_count
        k = node - row * row_count
        here = constant + wp.float64(i) * sx + wp.float64(j) * sy + wp.float64(k) * sz
        density_out[node] = wp.min(wp.max(here, low), high)


def launch(kernel, count: int, *arguments) -> None:
    """Run a kernel over `count` items on all cores; arrays are used in place, (n, 3) arrays as vectors."""
    start_warp()

    def shared(own):
        if isinstance(own, tuple):
            return wp.vec3d(*own)
        if not isinstance(own, np.ndarray):
            return own
        kind = wp.vec3d if own.ndim == 2 else wp.dtype_from_numpy(own.dtype)
        # An empty array has no address.
        return wp.array(own, dtype=kind, device="cpu", copy=False) if len(own) else wp.zeros(1, kind, device="cpu")

    arrays = [shared(argument) for argument in arguments]
    size = max(1 << 10, min(1 << 18, -(-count // (4 * core_count()))))  # items of a launch

    def run(first: int) -> None:
        warp_launch(kernel, min(size, count - first), [first, *arrays], "cpu")

    in_threads(run, range(0, count, size))


NEWTON_STEPS = wp.constant(40)
STEEPEST = wp.constant(wp.float64(1e11))  # ratio of the squares of two widths, above which a set of points is flat
AGREED = wp.constant(wp.float64(1e-13))
CLOSE = wp.constant(wp.float64(1e-11))  # of the width of the cells around a point: distance of their weighted mean


@wp.func
def inverse_or_zero(square: wp.mat33d) -> wp.mat33d:
    """Return the inverse of a symmetric matrix; zeros for a matrix of lower rank."""
    trace = wp.trace(square)
    result = wp.mat33d()
    if trace > wp.float64(0.0):
        scaled = square / trace
        if wp.determinant(scaled) > wp.float64(0.0):
            inverse = wp.inverse(scaled)
            if wp.trace(inverse) < STEEPEST:
                result = inverse / trace
    return result


@wp.kernel(enable_backward=False)
def slope_weights(
    first: int, start_in: Starts, column_in: Indices, point_in: Vectors, weight_out: Vectors, centre_out: Vectors
):
    """Compute the weights of each row's values in the least-squares slope, and the mean of the row's points."""
    row = first + wp.tid()
    begin = int(start_in[row])
    end = int(start_in[row + 1])
    if begin == end:
        return
    total = wp.vec3d()
    for k in range(begin, end):
        total += point_in[column_in[k]]
    centre = total / wp.float64(end - begin)
    square = wp.mat33d()
    for k in range(begin, end):
        step = point_in[column_in[k]] - centre
        square += wp.outer(step, step)
    inverse = inverse_or_zero(square)
    # One correction step removes rounding errors in the slope of a linear function, which matter in flat cells.
    result = wp.mat33d()
    for k in range(begin, end):
        step = point_in[column_in[k]] - centre
        result += wp.outer(inverse * step, step)
    if wp.trace(inverse) > wp.float64(0.0):
        inverse = wp.float64(2.0) * inverse - result * inverse
    for k in range(begin, end):
        weight_out[k] = inverse * (point_in[column_in[k]] - centre)
    centre_out[row] = centre


@wp.kernel(enable_backward=False)
def convex_weights(
    first: int,
    start_in: Starts,
    column_in: Indices,
    middle_in: Vectors,
    point_in: Vectors,
    weight_out: Numbers,
    inside_out: Indices,
):
    r"""Compute weights >= 0 of the cells around each point that are exact for linear densities, where they exist.

    They are closest to equal weights: 1 / n + lambda . d by least squares where none of these is negative, else
    exp(lambda . d) / sum, with d from the point to the cells' centroids. Outside the convex hull of the centroids all
    weights are equal.
    """
    row = first + wp.tid()
    begin = int(start_in[row])
    end = int(start_in[row + 1])
    inside_out[row] = 0
    if begin == end:
        return
    equal = wp.float64(1.0) / wp.float64(end - begin)
    at = point_in[row]
    total = wp.vec3d()
    for k in range(begin, end):
        total += middle_in[column_in[k]] - at
    mean = total * equal
    square = wp.mat33d()
    for k in range(begin, end):
        step = middle_in[column_in[k]] - at - mean
        square += wp.outer(step, step)
    inverse = inverse_or_zero(square)
    rank = int(wp.trace(inverse) > wp.float64(0.0))
    turn = inverse * mean
    least = wp.float64(1.0)
    missed = wp.vec3d()
    for k in range(begin, end):
        step = middle_in[column_in[k]] - at
        weight = equal - wp.dot(turn, step - mean)
        missed += weight * step
    turn += inverse * missed  # correct for rounding
    missed = wp.vec3d()
    for k in range(begin, end):
        step = middle_in[column_in[k]] - at
        weight = equal - wp.dot(turn, step - mean)
        weight_out[k] = weight
        least = wp.min(least, weight)
        missed += weight * step
    exact = CLOSE * wp.sqrt(wp.trace(square))
    if rank == 1 and least >= wp.float64(0.0) and wp.length(missed) <= exact:
        inside_out[row] = 1
        return
    # Newton iteration for the minimum of log sum exp(lambda . d), which is finite only inside the centroids' hull.
    agreed = int(0)
    tilt = wp.vec3d()
    steps = int(0)
    while rank == 1 and agreed == 0 and steps < NEWTON_STEPS:
        highest = wp.float64(-1.0e300)
        for k in range(begin, end):
            highest = wp.max(highest, wp.dot(tilt, middle_in[column_in[k]] - at))
        share = wp.float64(0.0)
        slope = wp.vec3d()
        bend = wp.mat33d()
        for k in range(begin, end):
            step = middle_in[column_in[k]] - at
            weight = wp.exp(wp.dot(tilt, step) - highest)
            share += weight
            slope += weight * step
            bend += weight * wp.outer(step, step)
        slope = slope / share
        bend = bend / share - wp.outer(slope, slope)
        turn = inverse_or_zero(bend) * slope
        slack = wp.dot(turn, slope)
        if slack <= wp.float64(0.0) and wp.length(slope) > wp.float64(0.0):
            steps = NEWTON_STEPS
        else:
            length = wp.float64(1.0)
            if slack > wp.float64(0.1):
                length = wp.float64(1.0) / (wp.float64(1.0) + wp.sqrt(slack))
            tilt -= length * turn
            if slack < AGREED * AGREED:
                agreed = int(1)
        steps += 1
    share = wp.float64(0.0)
    highest = wp.float64(-1.0e300)
    for k in range(begin, end):
        highest = wp.max(highest, wp.dot(tilt, middle_in[column_in[k]] - at))
    for k in range(begin, end):
        weight = equal
        if agreed == 1:
            weight = wp.exp(wp.dot(tilt, middle_in[column_in[k]] - at) - highest)
        weight_out[k] = weight
        share += weight
    missed = wp.vec3d()
    for k in range(begin, end):
        weight_out[k] = weight_out[k] / share
        missed += weight_out[k] * (middle_in[column_in[k]] - at)
    if agreed == 1 and wp.length(missed) <= exact:
        inside_out[row] = 1
        return
    for k in range(begin, end):
        weight_out[k] = equal
