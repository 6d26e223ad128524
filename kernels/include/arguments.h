// Arguments of the kernels, as macros.
// Written by scripts/kernel_headers from aerokernels/tracing/engines/layout.py: change it there.
#ifndef ARGUMENTS_H
#define ARGUMENTS_H

#include "types.h"

#define ARRAY_ARGUMENTS \
    __global const real *coefficients, __global const real *corners, __global const real *values, \
    __global const real *gradients, __global const int *neighbors, __global const int *bin_start, \
    __global const int *bin_cell, __global const real *paper_step, __global const double *wall, \
    __global const double *wall_boxes, __global const int *wall_links, __global const real *step_bound, \
    __global const int *step_bound_start

#define ARRAYS \
    {coefficients, corners, values, gradients, neighbors, bin_start, bin_cell, paper_step, wall, wall_boxes, \
    wall_links, step_bound, step_bound_start}

#define RAY_OUTPUT_ARGUMENTS \
    __global double *position_out, __global double *direction_out, __global double *optical_path_out, \
    __global double *opd_out, __global double *arc_length_out, __global double *step_error_out, \
    __global int *step_count_out, __global int *evaluation_count_out, __global int *status_out

#define RAY_OUTPUTS \
    {position_out, direction_out, optical_path_out, opd_out, arc_length_out, step_error_out, step_count_out, \
    evaluation_count_out, status_out}

#define TRACE_KERNEL_ARGUMENTS \
    const Field field, const Bounds bounds, const Control control, ARRAY_ARGUMENTS, const int first_ray, \
    const int ray_count, __global const double *position_in, __global const double *direction_in, \
    RAY_OUTPUT_ARGUMENTS

#define LEAPFROG_ARGUMENTS \
    const Field field, const Bounds bounds, const Control control, ARRAY_ARGUMENTS, const int first_ray, \
    const int ray_count, __global const double *position_in, __global const double *direction_in, \
    RAY_OUTPUT_ARGUMENTS, __global int *rejected_count_out

#define TRACE_PROJECTION_ARGUMENTS \
    __global const real *coefficients, const int cells_x, const int cells_y, const double origin_x, \
    const double origin_y, const double rate_x, const double rate_y, const double ambient, const double sign, \
    const double first_plane, const double length, const double flight, const int wanted, const int first_ray, \
    const int ray_count, __global const double *position_in, RAY_OUTPUT_ARGUMENTS

#define DELIVER_BUNDLE_ARGUMENTS \
    __global const int *block_map, __global const double *header, __global const real *patches, \
    __global const double *frame, const int map_u, const int map_v, const int converges, const int stop, \
    const int shape, const int checks_faces, const int faces_that_matter, const int wanted, const int first_ray, \
    const int ray_count, __global const double *position_in, __global const double *direction_in, \
    RAY_OUTPUT_ARGUMENTS

#define LAUNCH_PUPIL_ARGUMENTS \
    const double3 center, const double3 first, const double3 second, const double3 look, const int shape, \
    const int row_count, const int column_count, __global const double *table_in, __global const uint *seeds, \
    __global const int *order_in, const int per_replicate, const int generator, const int smoothed, \
    const int first_ray, const int ray_count, __global double *position_out, __global double *direction_out, \
    __global double *pupil_out, __global double *weight_out

#define SUM_MOMENTS_ARGUMENTS \
    const int per_replicate, const int first_group, const int group_count, const int weight_count, \
    __global const double *weight_in, __global const double *pupil_in, __global const double *opd_in, \
    __global const double *step_error_in, __global const int *evaluation_count_in, __global const int *status_in, \
    __global double *sums_out

#define SUM_PHASORS_ARGUMENTS \
    const double wave_number, const double3 plane, const double focus, const int per_replicate, \
    const int first_group, const int group_count, const int weight_count, __global const double *weight_in, \
    __global const double *pupil_in, __global const double *opd_in, __global const int *status_in, \
    __global double *sums_out

#define REDUCE_SUMS_ARGUMENTS \
    const int row_count, const int reduced_count, const int first_sum, const int sum_count, \
    __global const double *sums_in, __global double *sums_out

#define SPLINE_LINES_ARGUMENTS \
    __global const double *values_in, __global const double *inverse_in, const int count, const int pitch, \
    const int even, const double ambient, const int first_line, const int line_count, \
    __global double *coefficients_out

#define ROUND_COEFFICIENTS_ARGUMENTS \
    __global const double *values_in, const int first_place, const int place_count, __global real *values_out

#define FOURTH_DIFFERENCES_ARGUMENTS \
    __global const double *coefficients_in, const int first_count, const int second_count, const int third_count, \
    const int axis, const int block, const int first_place, const int place_count, __global double *maxima_out

#define BLOCK_MAXIMA_ARGUMENTS \
    __global const double *values_in, const int count, const int pitch, const int block, const double ambient, \
    const int first_place, const int place_count, __global double *maxima_out

#endif
