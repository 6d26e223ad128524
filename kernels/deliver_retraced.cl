// Copies the results of rays that were listed by collect_rejected and traced again to their rows, if they are within
// the limit now.
//
// Places first_place up to place_count, of which the first count_in[0] are listed. requested: bits OUTPUT_... as in
// result.py, of both results. rejected_count_out: decreased by 1 for each ray that is within the limit. The start at
// each place is replaced by one far from any field, where a ray takes no samples.

#include "constants.h"
#include "arguments.h"
#include "ray_status.h"

__kernel void deliver_retraced(DELIVER_RETRACED_ARGUMENTS)
{
    const int place = (int)get_global_id(0) + first_place;
    if (place >= place_count) {
        return;
    }
    vstore3((double3)(FAR_AWAY), place, start_out);
    vstore3((double3)(0.0, 0.0, 1.0), place, heading_out);
    if (place >= count_in[0]) {
        return;
    }
    const RayOutputs found = RETRACED_OUTPUTS, outputs = RAY_OUTPUTS;
    if (found.status[place] != RAY_OK || !(found.step_error[place] <= limit)) {
        return;
    }
    const int ray = rows_in[place];
    if (requested & OUTPUT_POSITION) {
        vstore3(vload3(place, found.position), ray, outputs.position);
    }
    if (requested & OUTPUT_DIRECTION) {
        vstore3(vload3(place, found.direction), ray, outputs.direction);
    }
    if (requested & OUTPUT_OPTICAL_PATH) {
        outputs.optical_path[ray] = found.optical_path[place];
    }
    if (requested & OUTPUT_OPD) {
        outputs.opd[ray] = found.opd[place];
    }
    if (requested & OUTPUT_ARC_LENGTH) {
        outputs.arc_length[ray] = found.arc_length[place];
    }
    if (requested & OUTPUT_STEP_COUNT) {
        outputs.step_count[ray] = found.step_count[place];
    }
    if (requested & OUTPUT_EVALUATION_COUNT) {
        outputs.evaluation_count[ray] = found.evaluation_count[place];
    }
    outputs.step_error[ray] = found.step_error[place];
    outputs.status[ray] = found.status[place];
    atomic_dec(rejected_count_out);
}
