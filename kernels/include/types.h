// What a kernel gets besides the rays: the scalars of Warp's structs in aerokernels/tracing/engines/warp/types.py, name by name
// in their order (a test compares them); their arrays are arguments of the kernel, gathered in Arrays.
//
// Vectors are plain arrays: their layout is then the same for every compiler and for NumPy.
#ifndef TYPES_H
#define TYPES_H

#include "real.h"

typedef struct {
    int row[3];               // nodes less one along each local axis, for clamping
    int pitch[3];             // distance in the flat array of neighbours along each local axis
    real inverse_spacing[3];  // cells per metre along x, y, z
    real ambient;
    real mesh_low[2];         // bounding box of the mesh [m]
    real mesh_high[2];
    int bin_count[2];
    real bin_origin[2];
    real bin_rate[2];         // bins per metre
    real slack;               // containment slack [m]
    int cell_count;           // of the mesh
    int wall_count;           // boxes about the body's surface
} Field;

typedef struct {
    double origin[3];         // where cell = 0, frac = 0 lies [m]
    double spacing[3];        // metres per cell
    double low[3];            // box [m]
    double high[3];
    double radius;            // of an axisymmetric box
    double support_low[3];    // the part of it outside which the air is uniform [m]
    double support_high[3];
    double support_radius;
    double ambient;
    double plane_point[3];
    double plane_normal[3];
    double length;
} Bounds;

typedef struct {
    real face_low[3];         // box in cells
    real face_high[3];
    real radius;              // in cells
    real plane_normal[3];     // per cell, so that plane_normal . cells - plane_offset is in metres
    real plane_offset;
    real cell_rate[3];        // typical cells per metre, for limits on the step
    // "fixed": metres of arc length; leapfrog samples: greatest distance that `step_bound` holds for
    real step;
    real step_limit;          // step in cells that needs no leave from `step_bound`
    int block_count[3];       // blocks of the table of step bounds along each local axis
    int block;                // cells in a block
    real tolerance;           // OPD error allowed for the whole ray [m]
    real extent;              // a few diagonals of the box, longer than any step [m]
    int max_steps;
    real quadrature_error_scale;  // leapfrog samples: the share of a difference that is taken for the error
    real trajectory_error_scale;  // and that of int P^2 / w dt
    int sample_count;         // of a ray whose samples are even, a multiple of three
    real left_potential;      // greatest potential outside the support, and its slope [1/m]
    real left_slope;
    int outputs;              // of a ray that are wanted, a bit each
} Control;

typedef struct {
    __global const real *coefficients;
    __global const real *corners;
    __global const real *values;
    __global const real *gradients;
    __global const int *neighbors;
    __global const int *bin_start;
    __global const int *bin_cell;
    __global const real *paper_step;
    __global const double *wall;
    __global const double *wall_boxes;
    __global const int *wall_links;
    __global const real *step_bound;
    __global const int *step_bound_start;
} Arrays;

// Course of the undisturbed ray; distances along it [m].
typedef struct {
    double enter;             // where the first step begins
    double far;               // where it leaves the box, or stops before that
    double stop_distance;
    int has_stop;             // whether it ever gets to the stop
    int meets;                // whether it meets the box before the stop
    real side;                // times this, the normal of the stop plane points away from where the ray starts
} Course;

#define VECTOR(a) ((real3)((a)[0], (a)[1], (a)[2]))
#define VECTOR64(a) ((double3)((a)[0], (a)[1], (a)[2]))

#endif
