// Structs: what the host fills, and what kernels make.
// Written by scripts/kernel_headers from aerokernels/tracing/engines/layout.py: change it there.
#ifndef TYPES_H
#define TYPES_H

#include "real.h"

typedef struct {
    int row[3];               // nodes less one along each local axis, for clamping
    int pitch[3];             // distance in the flat array of neighbours along each local axis
    real inverse_spacing[3];  // cells per metre along x, y, z
    real ambient;
    real mesh_low[2];         // bounding box of the mesh
    real mesh_high[2];
    int bin_count[2];
    real bin_origin[2];
    real bin_rate[2];         // bins per metre
    real edge_tolerance;      // within which a point beside a cell lies in it
    int cell_count;           // of the mesh
    int wall_count;           // boxes about the body's surface
} Field;

typedef struct {
    double origin[3];        // where cell = 0, frac = 0 lies
    double spacing[3];       // metres per cell
    double low[3];           // box
    double high[3];
    double radius;           // of an axisymmetric box
    double support_low[3];   // the part of it outside which the air is uniform
    double support_high[3];
    double support_radius;
    double ambient;
    double plane_point[3];
    double plane_normal[3];
    double length;
} Bounds;

typedef struct {
    real face_low[3];             // box in cells
    real face_high[3];
    real radius;                  // in cells
    real plane_normal[3];         // per cell, so that plane_normal . cells - plane_offset is in metres
    real plane_offset;
    real cell_rate[3];            // typical cells per metre, for limits on the step
    real step;                    // "fixed": arc length; leapfrog: greatest distance of samples that step_bound holds for
    real step_limit;              // step in cells up to which step_bound is not asked
    int block_count[3];           // blocks along each local axis
    int block;                    // cells in a block
    real tolerance;               // OPD error allowed for the whole ray
    real extent;                  // a few diagonals of the box, longer than any step
    int max_steps;
    real quadrature_error_scale;  // leapfrog: the share of a difference that is taken for the error
    real trajectory_error_scale;  // and that of int P^2 / w dt
    int sample_count;             // of a ray whose samples are even, a multiple of three
    real left_potential;          // greatest potential outside the support
    real left_slope;              // and its slope [1/m]
    int outputs;                  // of a ray that are wanted, a bit each, see result.py
} Control;

typedef struct {
    double t_enter;        // where the first step begins
    double t_exit;         // where it leaves the box, or stops before that
    double stop_distance;
    int has_stop;          // whether it ever gets to the stop
    int meets;             // whether it meets the box before the stop
    real side;             // times this, the normal of the stop plane points away from where the ray starts
} Interval;

typedef struct {
    double3 position;
    double3 direction;
    double optical_path;
    double opd;
    double arc_length;
    double flight;        // beyond the box
    double2 grazing;      // what a ray that grazes its last surface lacks of it, and its cosine there
    int status;
} Arrival;

typedef struct {
    real obliquity;  // of the stop
    real lever_arm;  // how far on the error grows
    real reach;      // the part of that in the box
    real derating;   // share of the step bounds of step_bound.py, which know nothing of the distance to a far stop
} StopGeometry;

typedef struct {
    real h;          // to try [sigma]
    real safe;       // in smooth air
    real stand_off;  // distance to keep from faces, in cells
} Stride;

typedef struct {
    double first;    // planar: y of p; axisymmetric: square of the least distance from the axis
    double across;   // planar: dy; axisymmetric: dx^2 + dy^2
    double along;    // dz
    double z;        // of p
    double nearest;  // axisymmetric: t where it is nearest to the axis
    double height;   // z there
    double square;   // dy^2 + dz^2, of a planar line; in a volume dx^2 + dy^2 + dz^2
    double3 point;   // volume: p
    double3 toward;  // volume: d
    double3 right;   // volume: unit vectors across d, right-handed with it
    double3 up;
} WallLine;

typedef struct {
    int count;   // 0, 1 or 2 crossings
    int enters;  // whether the first one leads into the body, which lies to the left of the segment, behind the triangle
    double one;  // t of the first
    double two;  // and of the second, which leads the other way
} Crossings;

typedef struct {
    double entry;  // where it first enters it, NEVER if it does not
    double exit;   // where it first leaves it
    int odd;       // whether it crosses the surface an odd number of times
} WallMeeting;

typedef struct {
    __global const real *coefficients;     // uniform grid: of the potential, see medium/spline.py, flat
    __global const real *corners;          // mesh: four corners of each cell
    __global const real *values;           // mesh: contrast at those corners
    __global const real *gradients;        // mesh: node gradients at those corners
    __global const int *neighbors;         // mesh: cell behind each edge of each cell, or -1
    __global const int *bin_start;
    __global const int *bin_cell;
    __global const real *paper_step;       // eq 5 for each cell
    __global const double *wall;           // the body's surface in segments or triangles, see medium/wall_tree.py
    __global const double *wall_boxes;     // boxes about them
    __global const int *wall_links;
    __global const real *step_bound;       // of each block, see step_bound.py; leapfrog: error per metre, see unresolved.py
    __global const int *step_bound_start;  // where each cone's table starts in step_bound; -1 where it has none
} Arrays;

typedef struct {
    __global double *position;
    __global double *direction;
    __global double *optical_path;
    __global double *opd;
    __global double *arc_length;
    __global double *step_error;
    __global int *step_count;
    __global int *evaluation_count;
    __global int *status;
} RayOutputs;

#endif
