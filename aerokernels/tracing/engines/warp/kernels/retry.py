"""Warp kernels that list rejected rays, and deliver their results after they were traced again (tracing/retry.py).

Their OpenCL twins are the kernels of the same names in kernels/, whose comments describe the arguments.
"""

import warp as wp

from ....result import OUTPUT_BITS
from ....scheme import FAR_AWAY
from ....status import RayStatus
from ..types import takes

OK = wp.constant(int(RayStatus.OK))


@wp.kernel(enable_backward=False)
@takes("collect_rejected")
def collect_rejected(
    limit, room, first_ray, position_in, direction_in, step_error_in, rows_out, count_out, start_out, heading_out
):
    """List the rays of a chunk whose error is finite and above a limit, and copy their starts to the listed places."""
    ray = wp.tid() + first_ray
    error = step_error_in[ray]
    if error > limit and error < wp.float64(wp.inf):
        place = wp.atomic_add(count_out, 0, 1)
        if place < room:
            rows_out[place] = ray
            start_out[place] = position_in[ray]
            heading_out[place] = direction_in[ray]


@wp.kernel(enable_backward=False)
@takes("deliver_retraced")
def deliver_retraced(
    limit,
    requested,
    first_place,
    count_in,
    rows_in,
    found,
    outputs,
    rejected_count_out,
    start_out,
    heading_out,
):
    """Copy the results of listed rays that were traced again to their rows, if they are within the limit now.

    All places are empty afterwards: they hold a ray far from the field.
    """
    place = wp.tid() + first_place
    away = wp.float64(FAR_AWAY)
    start_out[place] = wp.vec3d(away, away, away)
    heading_out[place] = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    if place >= count_in[0]:
        return
    if found.status[place] != OK or not (found.step_error[place] <= limit):
        return
    ray = rows_in[place]
    if (requested & wp.static(OUTPUT_BITS["position"])) != 0:
        outputs.position[ray] = found.position[place]
    if (requested & wp.static(OUTPUT_BITS["direction"])) != 0:
        outputs.direction[ray] = found.direction[place]
    if (requested & wp.static(OUTPUT_BITS["optical_path"])) != 0:
        outputs.optical_path[ray] = found.optical_path[place]
    if (requested & wp.static(OUTPUT_BITS["opd"])) != 0:
        outputs.opd[ray] = found.opd[place]
    if (requested & wp.static(OUTPUT_BITS["arc_length"])) != 0:
        outputs.arc_length[ray] = found.arc_length[place]
    if (requested & wp.static(OUTPUT_BITS["step_count"])) != 0:
        outputs.step_count[ray] = found.step_count[place]
    if (requested & wp.static(OUTPUT_BITS["evaluation_count"])) != 0:
        outputs.evaluation_count[ray] = found.evaluation_count[place]
    outputs.step_error[ray] = found.step_error[place]
    outputs.status[ray] = found.status[place]
    wp.atomic_add(rejected_count_out, 0, -1)
