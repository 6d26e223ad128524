// Writes the requested outputs of a ray.
#ifndef OUTPUTS_H
#define OUTPUTS_H

#include "constants.h"
#include "types.h"

// Write the requested outputs of a ray at its stop; `requested` has bits OUTPUT_... as in result.py.
static inline void write_outputs(
    const RayOutputs *outputs,
    int requested,
    int ray,
    const Arrival *arrival,
    double step_error,
    int step_count,
    int evaluation_count)
{
    if (requested & OUTPUT_POSITION) {
        vstore3(arrival->position, ray, outputs->position);
    }
    if (requested & OUTPUT_DIRECTION) {
        vstore3(arrival->direction, ray, outputs->direction);
    }
    if (requested & OUTPUT_OPTICAL_PATH) {
        outputs->optical_path[ray] = arrival->optical_path;
    }
    if (requested & OUTPUT_OPD) {
        outputs->opd[ray] = arrival->opd;
    }
    if (requested & OUTPUT_ARC_LENGTH) {
        outputs->arc_length[ray] = arrival->arc_length;
    }
    if (requested & OUTPUT_STEP_ERROR) {
        outputs->step_error[ray] = step_error;
    }
    if (requested & OUTPUT_STEP_COUNT) {
        outputs->step_count[ray] = step_count;
    }
    if (requested & OUTPUT_EVALUATION_COUNT) {
        outputs->evaluation_count[ray] = evaluation_count;
    }
    outputs->status[ray] = arrival->status;
}

#endif
