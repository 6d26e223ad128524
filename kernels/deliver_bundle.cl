// The kernel that interpolates rays of a two-parameter family between traced rays.
//
// It uses the table of aerokernels/tracing/bundle/table.py, one lookup per ray. tests/tracing/bundle_delivery.py has
// the same formulas in NumPy.
//
// block_map: number of the block at each place of the range of parameters, -1 for none. header: eight numbers for each
// block. patches: value, slopes and mixed slope of each channel at the nodes of each block, in single precision if its
// rounding is negligible. frame: numbers of the family, the stop and the box, in the order of bundle/frame.py. Outputs
// that are not requested stay unchanged. A ray outside every valid patch gets the status NOT_DELIVERED.

#include "arguments.h"
#include "bundle_family.h"
#include "outputs.h"
#include "ray_status.h"

#if CHANNELS == 1
typedef double channels;
#define LOAD(at, patches) ((double)(patches)[at])
#elif CHANNELS == 4
typedef double4 channels;
#define LOAD(at, patches) convert_double4(vload4(at, patches))
#else
typedef double8 channels;
#define LOAD(at, patches) convert_double8(vload8(at, patches))
#endif

// Weights of the value and the slope at 0 and at 1.
static inline double4 hermite_weights(double u)
{
    const double v = 1.0 - u;
    return (double4)((1.0 + 2.0 * u) * v * v, u * v * v, u * u * (3.0 - 2.0 * u), -u * u * v);
}

// Contribution of the four numbers per channel of a node, which begin at entry `at`.
static inline channels node_share(__global const real *patches, int at, double u, double du, double v, double dv)
{
    return u * v * LOAD(at, patches) + du * v * LOAD(at + 1, patches) + u * dv * LOAD(at + 2, patches)
        + du * dv * LOAD(at + 3, patches);
}

__kernel void deliver_bundle(DELIVER_BUNDLE_ARGUMENTS)
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
    if (block < 0 || !good) {
        outputs.status[ray] = NOT_DELIVERED;
        return;
    }
    __global const double *head = header + 8 * block;
    const double4 grid = vload4(0, head);
    const double u = (parameters.x - grid.s0) * grid.s2, v = (parameters.y - grid.s1) * grid.s3;
    const int i = clamp((int)u, 0, 3), j = clamp((int)v, 0, 3);
    const double4 wu = hermite_weights(u - (double)i), wv = hermite_weights(v - (double)j);
    const int at = 4 * ((block * 5 + i) * 5 + j);
    const channels found = node_share(patches, at, wu.s0, wu.s1, wv.s0, wv.s1)
        + node_share(patches, at + 4, wu.s0, wu.s1, wv.s2, wv.s3)
        + node_share(patches, at + 20, wu.s2, wu.s3, wv.s0, wv.s1)
        + node_share(patches, at + 24, wu.s2, wu.s3, wv.s2, wv.s3);

    Arrival arrival = {0};
#if CHANNELS == 1
    arrival.opd = found;
#else
    const double3 turned = d + found.s123;
    arrival.opd = found.s0;
    arrival.direction = turned / sqrt(dot(turned, turned));
#endif
#if CHANNELS == 8
    arrival.position = p + length * d + found.s456;
    arrival.arc_length = length + found.s7;
#endif
    arrival.optical_path = FRAME_AMBIENT * length + arrival.opd;
    arrival.status = RAY_OK;
    // Load only what is requested: on a GPU the loads take most of the time.
    const int has_costs = requested & (OUTPUT_STEP_ERROR | OUTPUT_STEP_COUNT | OUTPUT_EVALUATION_COUNT);
    const double4 costs = has_costs ? vload4(1, head) : 0.0;
    write_outputs(&outputs, requested, ray, &arrival, costs.s1, (int)costs.s2, (int)costs.s3);
}
