"""The Warp kernel that finds the range of the parameters of rays in a family: see bundle/known_family.py."""

import warp as wp

from ....bundle.nodes import FAR
from .bundle_family import family_parameters

# Numbers that each thread returns: how many rays do not belong, least and greatest parameters.
NUMBERS = 5


@wp.kernel(module="aerokernels_family_range", enable_backward=False)
def find_range(
    frame: wp.array(dtype=wp.float64),
    converges: int,
    rows: wp.array(dtype=wp.int32),
    threads: int,
    position_in: wp.array(dtype=wp.vec3d),
    direction_in: wp.array(dtype=wp.vec3d),
    found_out: wp.array(dtype=wp.float64),
):
    """For the rays of each thread: how many do not belong to a family, and the range of the others' parameters."""
    thread = wp.tid()
    far = wp.float64(wp.static(FAR))
    outside = wp.float64(0.0)
    low = wp.vec2d(far, far)
    high = wp.vec2d(-far, -far)
    place = thread
    while place < rows.shape[0]:
        ray = rows[place]
        parameters = family_parameters(frame, converges, position_in[ray], direction_in[ray])
        if parameters[2] > wp.float64(0.0):
            for axis in range(2):
                low[axis] = wp.min(low[axis], parameters[axis])
                high[axis] = wp.max(high[axis], parameters[axis])
        else:
            outside += wp.float64(1.0)
        place += threads
    # All threads' first numbers, then their second ones, and so on: NumPy reduces rows several times faster.
    found_out[thread] = outside
    for axis in range(2):
        found_out[(1 + axis) * threads + thread] = low[axis]
        found_out[(3 + axis) * threads + thread] = high[axis]
