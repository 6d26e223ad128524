// Writes the requested outputs of a packet's rays.
#ifndef PACKET_OUTPUTS_H
#define PACKET_OUTPUTS_H

#include "packet_ends.h"

// Loop over the lanes that belong to a ray.
#define EACH_RAY(lane) for (int lane = 0; lane < LANES && first + lane < ray_count; lane++)

static inline void write_numbers(__global double *to, int first, int ray_count, doubles numbers)
{
#if LANES > 1
    if (first + LANES <= ray_count) {
#if LANES == 16
        vstore16(numbers, 0, to + first);
#else
        vstore8(numbers, 0, to + first);
#endif
        return;
    }
#endif
    EACH_RAY(lane) {
        to[first + lane] = DOUBLE_AT(numbers, lane);
    }
}

static inline void write_vectors(__global double *to, int first, int ray_count, Triples vectors)
{
    EACH_RAY(lane) {
        vstore3(TRIPLE_AT(vectors, lane), first + lane, to);
    }
}

// Write the requested outputs of rays at their stop, and count the rejected rays, which are to be traced by another
// method. Rays that do not run took no samples.
static inline void write_packet(
    const RayOutputs *outputs,
    const Control *control,
    int first,
    int ray_count,
    const Arrivals *arrival,
    reals step_error,
    truths runs,
    __global int *rejected_count)
{
    const int requested = control->outputs;
    if (requested & OUTPUT_POSITION) {
        write_vectors(outputs->position, first, ray_count, arrival->position);
    }
    if (requested & OUTPUT_DIRECTION) {
        const Triples heading = arrival->heading;
        const doubles size = sqrt(inner(heading, heading));
        const Triples unit = triples_of(heading.x / size, heading.y / size, heading.z / size);
        write_vectors(outputs->direction, first, ray_count, unit);
    }
    if (requested & OUTPUT_OPTICAL_PATH) {
        write_numbers(outputs->optical_path, first, ray_count, arrival->optical_path);
    }
    if (requested & OUTPUT_OPD) {
        write_numbers(outputs->opd, first, ray_count, arrival->opd);
    }
    if (requested & OUTPUT_ARC_LENGTH) {
        write_numbers(outputs->arc_length, first, ray_count, arrival->arc_length);
    }
    if (requested & OUTPUT_STEP_ERROR) {
        write_numbers(outputs->step_error, first, ray_count, TO_DOUBLES(step_error));
    }
    if (requested & (OUTPUT_STEP_COUNT | OUTPUT_EVALUATION_COUNT)) {
        EACH_RAY(lane) {
            const int samples = TRUTH_AT(runs, lane) ? control->sample_count : 0;
            if (requested & OUTPUT_STEP_COUNT) {
                outputs->step_count[first + lane] = samples;
            }
            if (requested & OUTPUT_EVALUATION_COUNT) {
                outputs->evaluation_count[first + lane] = samples;
            }
        }
    }
    EACH_RAY(lane) {
        outputs->status[first + lane] = (int)NUMBER_AT(arrival->status, lane);
    }
    if (SOME(TO_TRUTHS(step_error > control->tolerance))) {
        EACH_RAY(lane) {
            if (REAL_AT(step_error, lane) > control->tolerance) {
                atomic_inc(rejected_count);
            }
        }
    }
}

#endif
