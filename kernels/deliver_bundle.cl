// The kernel that interpolates rays of a two-parameter family between traced rays.
//
// It uses the table of aerokernels/tracing/tasks/family.py, one lookup per ray. tests/tracing/bundle/bundle_delivery.py has
// the same formulas in NumPy.
//
// block_map: number of the block at each place of the range of parameters, -1 for none. header: eight numbers for each
// block. patches: value, slopes and mixed slope of each channel at the nodes of each block, in single precision if its
// rounding is negligible. frame: numbers of the family, the stop and the box, in the order of bundle/frame.py. Outputs
// that are not requested stay unchanged. A ray outside every valid patch gets the status NOT_DELIVERED.

#include "types.h"
#include "bundle_family.h"
#include "generated/outputs.h"
#include "patches.h"
#include "ray_status.h"

__kernel void deliver_bundle(
    __global const int *block_map,
    __global const double *header,
    __global const real *patches,
    __global const double *frame,
    const int map_u,
    const int map_v,
    const int converges,
    const int stop,
    const int shape,
    const int checks_faces,
    const int faces_that_matter,
    const int requested,
    const int first_ray,
    const int ray_count,
    __global const double *position_in,
    __global const double *direction_in,
    RAY_OUTPUT_ARGUMENTS)
{
    const int ray = (int)get_global_id(0) + first_ray;
    if (ray >= ray_count) {
        return;
    }
    const RayOutputs outputs = RAY_OUTPUTS;
    const double3 p = vload3(ray, position_in);
    const double3 d = vload3(ray, direction_in);
    double2 parameters;
    int good = family_parameters(frame, converges, p, d, &parameters);
    const double2 place = (parameters - (double2)(FRAME_LOW_U, FRAME_LOW_V)) * (double2)(FRAME_RATE_U, FRAME_RATE_V);
    good = good && place.x >= 0.0 && place.y >= 0.0 && place.x < (double)map_u && place.y < (double)map_v;
    const int block = good ? block_map[(int)place.x * map_v + (int)place.y] : -1;
    double length = 0.0;
    if (block >= 0) {
        int face_pair = 0;
        length = undisturbed_length(frame, stop, shape, checks_faces, faces_that_matter, p, d, &face_pair);
        good = length > 0.0 && length < FAR && (!checks_faces || (double)face_pair == header[8 * block + 4]);
    }
    // A ray without a patch looks one up all the same: threads of a GPU do so together.
    good = good && block >= 0;
    __global const double *head = header + 8 * (good ? block : 0);
    const double4 grid = vload4(0, head);
    const double u = (parameters.x - grid.s0) * grid.s2, v = (parameters.y - grid.s1) * grid.s3;
    const int i = clamp((int)u, 0, 3), j = clamp((int)v, 0, 3);
    const int at = good ? 4 * ((block * 5 + i) * 5 + j) : 0;
    const channels found = in_patch(patches, at, (real)(u - (double)i), (real)(v - (double)j));
    if (!good) {
        outputs.status[ray] = NOT_DELIVERED;
        return;
    }

    Arrival arrival = {0};
#if CHANNELS == 1
    arrival.opd = (double)found;
#else
    const double3 turned = d + convert_double3(found.s123);
    arrival.opd = (double)found.s0;
    arrival.direction = turned / sqrt(dot(turned, turned));
#endif
#if CHANNELS == 8
    arrival.position = p + length * d + convert_double3(found.s456);
    arrival.arc_length = length + (double)found.s7;
#endif
    arrival.optical_path = FRAME_AMBIENT * length + arrival.opd;
    arrival.status = RAY_OK;
    // Load only what is requested: on a GPU the loads take most of the time.
    const int has_costs = requested & (OUTPUT_STEP_ERROR | OUTPUT_STEP_COUNT | OUTPUT_EVALUATION_COUNT);
    const double4 costs = has_costs ? vload4(1, head) : 0.0;
    write_outputs(&outputs, requested, ray, arrival, costs.s1, (int)costs.s2, (int)costs.s3);
}
