"""Warp kernels, in float64, for weights that the mesh alone determines: values at points and slopes in cells."""

import warp as wp

from aerokernels.flow.reading.volumes.mesh_kernels import Indices, Numbers, Starts, Vectors

NEWTON_STEPS = wp.constant(40)
STEEPEST = wp.constant(wp.float64(1e11))  # ratio of the squares of two widths, above which a set of points is flat
# Deviation of the cells around a point from a linear function, over their range: in a smooth density, and at a shock.
LINEAR = wp.constant(wp.float64(0.04))
NOT_LINEAR = wp.constant(wp.float64(0.12))
AGREED = wp.constant(wp.float64(1e-13))
CLOSE = wp.constant(wp.float64(1e-11))  # of the width of the cells around a point: distance of their weighted mean


@wp.func
def inverse_or_zero(square: wp.mat33d) -> wp.mat33d:
    """Return the inverse of a symmetric matrix; zeros for a matrix of lower rank."""
    trace = wp.trace(square)
    found = wp.mat33d()
    if trace > wp.float64(0.0):
        scaled = square / trace
        if wp.determinant(scaled) > wp.float64(0.0):
            inverse = wp.inverse(scaled)
            if wp.trace(inverse) < STEEPEST:
                found = inverse / trace
    return found


@wp.kernel(enable_backward=False)
def slope_weights(
    first: int, start_in: Starts, column_in: Indices, point_in: Vectors, weight_out: Vectors, centre_out: Vectors
):
    """Compute the weights of each row's values in the least-squares slope, and the mean of the row's points."""
    row = first + wp.tid()
    begin = start_in[row]
    end = start_in[row + 1]
    if begin == end:
        return
    total = wp.vec3d()
    k = begin
    while k < end:
        total += point_in[column_in[k]]
        k += wp.int64(1)
    centre = total / wp.float64(end - begin)
    square = wp.mat33d()
    k = begin
    while k < end:
        step = point_in[column_in[k]] - centre
        square += wp.outer(step, step)
        k += wp.int64(1)
    inverse = inverse_or_zero(square)
    # One correction step removes rounding errors in the slope of a linear function, which matter in flat cells.
    found = wp.mat33d()
    k = begin
    while k < end:
        step = point_in[column_in[k]] - centre
        found += wp.outer(inverse * step, step)
        k += wp.int64(1)
    if wp.trace(inverse) > wp.float64(0.0):
        inverse = wp.float64(2.0) * inverse - found * inverse
    k = begin
    while k < end:
        weight_out[k] = inverse * (point_in[column_in[k]] - centre)
        k += wp.int64(1)
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
    begin = start_in[row]
    end = start_in[row + 1]
    inside_out[row] = 0
    if begin == end:
        return
    count = wp.float64(end - begin)
    equal = wp.float64(1.0) / count
    at = point_in[row]
    total = wp.vec3d()
    k = begin
    while k < end:
        total += middle_in[column_in[k]] - at
        k += wp.int64(1)
    mean = total * equal
    square = wp.mat33d()
    k = begin
    while k < end:
        step = middle_in[column_in[k]] - at - mean
        square += wp.outer(step, step)
        k += wp.int64(1)
    inverse = inverse_or_zero(square)
    rank = int(wp.trace(inverse) > wp.float64(0.0))
    turn = inverse * mean
    least = wp.float64(1.0)
    missed = wp.vec3d()
    k = begin
    while k < end:
        step = middle_in[column_in[k]] - at
        weight = equal - wp.dot(turn, step - mean)
        missed += weight * step
        k += wp.int64(1)
    turn += inverse * missed  # correct for rounding
    k = begin
    missed = wp.vec3d()
    while k < end:
        step = middle_in[column_in[k]] - at
        weight = equal - wp.dot(turn, step - mean)
        weight_out[k] = weight
        least = wp.min(least, weight)
        missed += weight * step
        k += wp.int64(1)
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
        k = begin
        while k < end:
            highest = wp.max(highest, wp.dot(tilt, middle_in[column_in[k]] - at))
            k += wp.int64(1)
        share = wp.float64(0.0)
        slope = wp.vec3d()
        bend = wp.mat33d()
        k = begin
        while k < end:
            step = middle_in[column_in[k]] - at
            weight = wp.exp(wp.dot(tilt, step) - highest)
            share += weight
            slope += weight * step
            bend += weight * wp.outer(step, step)
            k += wp.int64(1)
        slope = slope / share
        bend = bend / share - wp.outer(slope, slope)
        turn = inverse_or_zero(bend) * slope
        rest = wp.dot(turn, slope)
        if rest <= wp.float64(0.0) and wp.length(slope) > wp.float64(0.0):
            steps = NEWTON_STEPS
        else:
            length = wp.float64(1.0)
            if rest > wp.float64(0.1):
                length = wp.float64(1.0) / (wp.float64(1.0) + wp.sqrt(rest))
            tilt -= length * turn
            if rest < AGREED * AGREED:
                agreed = int(1)
        steps += 1
    k = begin
    share = wp.float64(0.0)
    highest = wp.float64(-1.0e300)
    while k < end:
        highest = wp.max(highest, wp.dot(tilt, middle_in[column_in[k]] - at))
        k += wp.int64(1)
    k = begin
    while k < end:
        weight = equal
        if agreed == 1:
            weight = wp.exp(wp.dot(tilt, middle_in[column_in[k]] - at) - highest)
        weight_out[k] = weight
        share += weight
        k += wp.int64(1)
    missed = wp.vec3d()
    k = begin
    while k < end:
        weight_out[k] = weight_out[k] / share
        missed += weight_out[k] * (middle_in[column_in[k]] - at)
        k += wp.int64(1)
    if agreed == 1 and wp.length(missed) <= exact:
        inside_out[row] = 1
        return
    k = begin
    while k < end:
        weight_out[k] = equal
        k += wp.int64(1)


@wp.kernel(enable_backward=False)
def weighted_means(
    first: int, start_in: Starts, column_in: Indices, weight_in: Numbers, value_in: Numbers, mean_out: Numbers
):
    """Compute the weighted mean of each row's values, by differences from its first value; 0 for an empty row."""
    row = first + wp.tid()
    k = start_in[row]
    end = start_in[row + 1]
    mean = wp.float64(0.0)
    if k < end:
        one = value_in[column_in[k]]
        while k < end:
            mean += weight_in[k] * (value_in[column_in[k]] - one)
            k += wp.int64(1)
        mean += one
    mean_out[row] = mean


@wp.func
def lesser(one: wp.float64, other: wp.float64) -> wp.float64:
    """Return the lesser of two changes, zero where they differ in sign."""
    found = wp.float64(0.0)
    if one * other > wp.float64(0.0):
        found = wp.sign(one) * wp.min(wp.abs(one), wp.abs(other))
    return found


@wp.kernel(enable_backward=False)
def carry_to_rim(
    first: int,
    point_in: Indices,
    near_start_in: Starts,
    near_in: Indices,
    near_weight_in: Numbers,
    near_basis_in: Vectors,
    far_start_in: Starts,
    far_in: Indices,
    far_weight_in: Numbers,
    least_share: wp.float64,
    average_in: Numbers,
    value: Numbers,
):
    """Add the change of the density from the centroids of its cells to each point on the rim of the mesh.

    The change follows from the slope of the surrounding cells and from a line through points further in: the lesser of
    the
    two counts, zero if they differ in sign or the cells deviate from a line, limited by the range of those cells.
    """
    rim = first + wp.tid()
    point = point_in[rim]
    own = value[point]
    low = own
    high = own
    near = wp.float64(0.0)
    total = wp.float64(0.0)
    squares = wp.float64(0.0)
    explained = wp.vec3d()
    k = near_start_in[rim]
    end = near_start_in[rim + 1]
    count = wp.float64(end - k)
    while k < end:
        average = average_in[near_in[k]]
        change = average - own
        near += near_weight_in[k] * change
        total += change
        squares += change * change
        explained += change * near_basis_in[k]
        low = wp.min(low, average)
        high = wp.max(high, average)
        k += wp.int64(1)
    # The root mean square deviation of the cells from their best linear fit, over their range.
    left = wp.max(squares - total * total / count - wp.dot(explained, explained), wp.float64(0.0))
    missed = wp.sqrt(left / count) / wp.max(high - low, wp.float64(1e-300))
    share = wp.clamp((NOT_LINEAR - missed) / (NOT_LINEAR - LINEAR), wp.float64(0.0), wp.float64(1.0))
    far = wp.float64(0.0)
    k = far_start_in[rim]
    end = far_start_in[rim + 1]
    while k < end:
        far += far_weight_in[k] * (value[far_in[k]] - own)
        k += wp.int64(1)
    rise = wp.clamp(share * lesser(near, far), low - high, high - low)
    value[point] = wp.max(own + rise, wp.min(own, least_share * low))


@wp.kernel(enable_backward=False)
def carry_on(
    first: int,
    node_in: Indices,
    start_in: Starts,
    one_in: Indices,
    two_in: Indices,
    three_in: Indices,
    least_share: wp.float64,
    value: Numbers,
):
    """Extrapolate the density to nodes beyond known ones: the mean over the directions that each row lists."""
    row = first + wp.tid()
    k = start_in[row]
    end = start_in[row + 1]
    count = wp.float64(end - k)
    total = wp.float64(0.0)
    while k < end:
        one = value[one_in[k]]
        rise = wp.float64(0.0)
        if two_in[k] >= 0:
            two = value[two_in[k]]
            rise = one - two
            if three_in[k] >= 0:
                rise = lesser(rise, two - value[three_in[k]])
        total += wp.max(one + rise, least_share * one)
        k += wp.int64(1)
    value[node_in[row]] = total / count
