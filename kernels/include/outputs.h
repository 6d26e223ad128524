// Writes the requested outputs of a ray.
#ifndef OUTPUTS_H
#define OUTPUTS_H

#include "constants.h"
#include "types.h"

// Write the requested outputs of a ray at its stop; `wanted` has bits WANT_... as in result.py.
static inline void write_outputs(
    const RayOutputs *outputs,
    int wanted,
    int ray,
    const Arrival *arrival,
    double step_error,
    int step_count,
    int evaluation_count)
{
    if (wanted & WANT_POSITION) {
        vstore3(arrival->position, ray, outputs->position);
    }
    if (wanted & WANT_DIRECTION) {
        vstore3(arrival->direction, ray, outputs->direction);
    }
    if (wanted & WANT_OPTICAL_PATH) {
        outputs->optical_path[ray] = arrival->optical_path;
    }
    if (wanted & WANT_OPD) {
        outputs->opd[ray] = arrival->opd;
    }
    if (wanted & WANT_ARC_LENGTH) {
        outputs->arc_length[ray] = arrival->arc_length;
    }
    if (wanted & WANT_STEP_ERROR) {
        outputs->step_error[ray] = step_error;
    }
    if (wanted & WANT_STEP_COUNT) {
        outputs->step_count[ray] = step_count;
    }
    if (wanted & WANT_EVALUATION_COUNT) {
        outputs->evaluation_count[ray] = evaluation_count;
    }
    outputs->status[ray] = arrival->status;
}

#endif
