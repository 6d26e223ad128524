"""Warp kernels for volumes on meshes, in float64: means at points, slopes in cells, values at the nodes of a grid.

They run in chunks over host threads: Warp's CPU device runs a launch in one thread and releases the interpreter lock.
"""

import numpy as np
import warp as wp

from aerokernels.device_arrays.launching import launch as warp_launch
from aerokernels.process.machine import core_count
from aerokernels.process.quiet_warp import start_warp
from aerokernels.process.threads import in_threads

CHUNK = 1 << 18  # items of a launch
LEAST_CHUNK = 1 << 10

Numbers = wp.array[wp.float64]
Vectors = wp.array[wp.vec3d]
Starts = wp.array[wp.int64]
Indices = wp.array[wp.int32]
# The function of a cell: value at the origin, slope, least and greatest value allowed, loaded in one access.
Function = wp.types.vector(length=6, dtype=wp.float64)
Functions = wp.array[Function]


@wp.kernel(enable_backward=False)
def mean_of_listed(first: int, start_in: Starts, column_in: Indices, value_in: Numbers, mean_out: Numbers):
    """Compute the mean of the values that each row lists; 0 for an empty row."""
    row = first + wp.tid()
    k = start_in[row]
    end = start_in[row + 1]
    count = wp.float64(end - k)
    total = wp.float64(0.0)
    while k < end:
        total += value_in[column_in[k]]
        k += wp.int64(1)
    mean_out[row] = total / wp.max(count, wp.float64(1.0))


@wp.func
def slope_and_range(
    row: int, value: wp.float64, start_in: Starts, column_in: Indices, weight_in: Vectors, near_in: Numbers
):
    """Return the slope in a cell, a weighted sum of its row's values, and the range of these and its own value."""
    low = value
    high = value
    slope = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    k = start_in[row]
    end = start_in[row + 1]
    while k < end:
        near = near_in[column_in[k]]
        # The weights sum to zero: differences keep the digits of a nearly uniform density.
        slope += (near - value) * weight_in[k]
        low = wp.min(low, near)
        high = wp.max(high, near)
        k += wp.int64(1)
    return slope, low, high


@wp.kernel(enable_backward=False)
def linear_functions(
    first: int,
    start_in: Starts,
    column_in: Indices,
    weight_in: Vectors,
    near_in: Numbers,
    value_in: Numbers,
    middle_in: Vectors,
    origin: wp.vec3d,
    function_out: Functions,
):
    """Compute the linear function of each cell, and its range: see `slope_and_range`."""
    cell = first + wp.tid()
    value = value_in[cell]
    slope, low, high = slope_and_range(cell, value, start_in, column_in, weight_in, near_in)
    constant = value - wp.dot(middle_in[cell] - origin, slope)
    function_out[cell] = Function(constant, slope[0], slope[1], slope[2], low, high)


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
    slope, low, high = slope_and_range(held, value, start_in, column_in, weight_in, near_in)
    constant = value - wp.dot(middle_in[held] - origin, slope)
    at = int(node_start_in[held])
    last = int(node_start_in[held + 1])
    half = wp.float64(0.5)
    per_row = wp.float64(1.0) / wp.float64(row_count)
    per_column = wp.float64(1.0) / wp.float64(column_count)
    sx = spacing[0] * slope[0]
    sy = spacing[1] * slope[1]
    sz = spacing[2] * slope[2]
    while at < last:
        node = node_in[at]
        # Integer quotients by faster products: the added half is far above their rounding.
        row = int((wp.float64(node) + half) * per_row)
        i = int((wp.float64(row) + half) * per_column)
        j = row - i * column_count
        k = node - row * row_count
        here = constant + wp.float64(i) * sx + wp.float64(j) * sy + wp.float64(k) * sz
        density_out[node] = wp.min(wp.max(here, low), high)
        at += 1


def launch(kernel, count: int, *arguments) -> None:
    """Run a kernel over `count` items on all cores; arrays are used in place, (n, 3) arrays as vectors."""
    start_warp()
    given = [_shared(argument) for argument in arguments]
    size = max(LEAST_CHUNK, min(CHUNK, -(-count // (4 * core_count()))))

    def run(first: int) -> None:
        warp_launch(kernel, min(size, count - first), [first, *given], "cpu")

    in_threads(run, range(0, count, size))


TYPES = {np.dtype(np.float64): wp.float64, np.dtype(np.int64): wp.int64, np.dtype(np.int32): wp.int32}


def _shared(argument):
    if isinstance(argument, tuple):
        return wp.vec3d(*argument)
    if not isinstance(argument, np.ndarray):
        return argument
    kind = {3: wp.vec3d, 6: Function}[argument.shape[1]] if argument.ndim == 2 else TYPES[argument.dtype]
    if not len(argument):  # an empty array has no address
        return wp.zeros(1, dtype=kind, device="cpu")
    return wp.array(ptr=argument.ctypes.data, dtype=kind, shape=len(argument), device="cpu", copy=False)
