"""A device function that writes the requested outputs of a ray."""

import warp as wp

from ....plan import OUTPUT_BITS
from ..library import Scene, built_once


@built_once()
def build_write_outputs(scene: Scene):
    """Build the function that writes the outputs of a ray."""
    t = scene.types
    Arrival, RayOutputs = t.Arrival, t.RayOutputs

    @wp.func
    def write_outputs(
        outputs: RayOutputs,
        requested: int,
        ray: int,
        arrival: Arrival,
        step_error: wp.float64,
        step_count: int,
        evaluation_count: int,
    ):
        """Writes the requested outputs of a ray at its stop; `requested` has bits as in result.py."""
        if (requested & wp.static(OUTPUT_BITS["position"])) != 0:
            outputs.position[ray] = arrival.position
        if (requested & wp.static(OUTPUT_BITS["direction"])) != 0:
            outputs.direction[ray] = arrival.direction
        if (requested & wp.static(OUTPUT_BITS["optical_path"])) != 0:
            outputs.optical_path[ray] = arrival.optical_path
        if (requested & wp.static(OUTPUT_BITS["opd"])) != 0:
            outputs.opd[ray] = arrival.opd
        if (requested & wp.static(OUTPUT_BITS["arc_length"])) != 0:
            outputs.arc_length[ray] = arrival.arc_length
        if (requested & wp.static(OUTPUT_BITS["step_error"])) != 0:
            outputs.step_error[ray] = step_error
        if (requested & wp.static(OUTPUT_BITS["step_count"])) != 0:
            outputs.step_count[ray] = step_count
        if (requested & wp.static(OUTPUT_BITS["evaluation_count"])) != 0:
            outputs.evaluation_count[ray] = evaluation_count
        outputs.status[ray] = arrival.status

    return write_outputs
