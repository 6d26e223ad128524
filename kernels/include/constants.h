// Constants of the scheme.
// Written by scripts/kernel_headers from scheme.py, tableau.py, step_bound.py, result.py and pupil_sums.py in aerokernels/tracing,
// crossings.py and grid.py in medium, and square_map.py in pupils: change it there.
#ifndef CONSTANTS_H
#define CONSTANTS_H

#include "real.h"

// Runge-Kutta-Nystrom pair: nodes, and the matrix of its stages.
#define RKN_C2 R(0.25)
#define RKN_C3 R(0.7)
#define RKN_A21 R(0.03125)
#define RKN_A31 R(0.007)
#define RKN_A32 R(0.238)

// Weights of the forces in the position's step.
#define RKN_B1 R(0.07142857142857142)
#define RKN_B2 R(0.2962962962962963)
#define RKN_B3 R(0.13227513227513227)

// Weights of the stages in the momentum's step, and in every sum over the step.
#define RKN_V1 R(0.07142857142857142)
#define RKN_V2 R(0.3950617283950617)
#define RKN_V3 R(0.4409171075837742)
#define RKN_V4 R(0.09259259259259259)

// Error of the position, from the embedded formula.
#define RKN_E1 R(0.1180952380952381)
#define RKN_E2 R(-0.15037037037037038)
#define RKN_E3 R(-0.017724867724867723)
#define RKN_E4 R(0.05)

// Error of the momentum and of the sums, from the embedded formula.
#define RKN_F1 R(-0.5476190476190477)
#define RKN_F2 R(1.1358024691358024)
#define RKN_F3 R(-1.0141093474426808)
#define RKN_F4 R(0.42592592592592593)

// Error of the optical path, from the rule of degree 7: values.
#define RKN_G1 R(-0.08171595168679718)
#define RKN_G2 R(0.05987472873618277)
#define RKN_G3 R(0.07008735267822558)
#define RKN_G4 R(-0.04824612972761122)

// The same: slopes along the ray.
#define RKN_K1 R(-0.006559766763848397)
#define RKN_K2 R(-0.021738846430204455)
#define RKN_K3 R(0.006665413568915711)
#define RKN_K4 R(0.005849500293944738)

// Momentum at the second stage.
#define RKN_P1 R(0.1015625)
#define RKN_P2 R(0.16589506172839505)
#define RKN_P3 R(-0.024112654320987654)
#define RKN_P4 R(0.006655092592592593)

// Momentum at the third stage.
#define RKN_Q1 R(0.056)
#define RKN_Q2 R(0.44039506172839504)
#define RKN_Q3 R(0.22901234567901235)
#define RKN_Q4 R(-0.025407407407407406)

// Length of a step.
#define LEAST_STEP R(0.0001)
#define FACE_TOLERANCE R(0.0001)
#define GREATEST_STAND_OFF R(0.001)

// Error of a step.
#define STEP_SHARE R(0.02)
#define NOISE_STEP R(0.5)
#define SLOPE_NOISE R(0.15)
#define DIRECTION_SHARE R(0.01)
#define OBLIQUITY_KEPT R(0.25)
#define LEAST_RATIO_SMOOTH R(0.02)
#define LEAST_RATIO R(0.2)
#define RATIO_GROWTH R(30.0)
#define MAGNIFIED R(1099511627776.0)

// Cosine of the least angle with a surface that is believed, and cells to go on at smaller ones (double).
#define LEAST_COSINE 0.05
#define STEEPEST_COSINE 0.002
#define GRAZING_TOLERANCE 0.01
#define LEAST_SLOPE 1e-15
#define ENTRY_ROUNDING 1e-09

// Event location: the share of a step that may be left to a surface.
#define EVENT_LOCATION_SHARE R(0.02)
#define TOLERANCE_COUNTED R(0.001)

// Leapfrog samples: greatest angle with the first direction [rad], least share of what is left out.
#define LEAPFROG_ANGLE R(0.05)
#define LOOKUP_STRIDE R(1.5)
#define MISSED_SLOPE R(2.0)
#define LEFT_SHARE R(0.5)

// Angle with the first direction up to which a ray counts as nearly straight [rad].
#define NEARLY_STRAIGHT R(0.01)

// Radius about the axis of symmetry within which a kink is rounded off, in cells.
#define AXIS_CORE R(0.0001)

// Cones of directions about an axis: sines squared (double) that sort rays into them.
#define NARROW_SQUARE 0.0004
#define WIDE_SQUARE 0.04000000000000001

// Cosines of the angles at which rays have turned out of their cones.
#define NARROW_COSINE R(0.9992000533313775)
#define WIDE_COSINE R(0.9756002111270675)

// Where a ray ends.
#define ARC_SURFACE 100
#define BEYOND_SUPPORT 101
#define WALK_LIMIT 6

// The body: chords, closeness and room in cells; A of lines parallel to the axis, triangles (double).
#define WALL_SAG R(0.0001)
#define WALL_CLOSE R(0.01)
#define WALL_ASIDE R(0.5)
#define WALL_BACK R(1e-05)
#define PARALLEL 1e-24
#define LEAST_SIDE 1e-300
#define GRAZING_SQUARE 0.0001

// Pupil: rays summed by one work-item and the sums it delivers, and the hash of the scramble.
#define GROUP 128
#define REDUCTION_WIDTH 64
#define MOMENT_COUNT 16
#define SUM_COUNT 18
#define HASH_1 0x6C50B47Cu
#define HASH_2 0xB82F1E52u
#define HASH_3 0xC7AFE638u
#define HASH_4 0x8D22F6E6u

// Shapes of pupils, and numbers of a table of pixels before its shares.
#define PUPIL_RING 0
#define PUPIL_PIXELS 1
#define PUPIL_TRIANGLES 2
#define PUPIL_PIXEL_HEADER 4

// Outputs of a ray that are wanted, a bit each.
#define WANT_POSITION 1
#define WANT_DIRECTION 2
#define WANT_OPTICAL_PATH 4
#define WANT_OPD 8
#define WANT_ARC_LENGTH 16
#define WANT_STEP_ERROR 32
#define WANT_STEP_COUNT 64
#define WANT_EVALUATION_COUNT 128

// By precision.
#if REAL_IS_DOUBLE
#define NOISE R(8.881784197001252e-16)
#define DIRECTION_NOISE R(2.220446049250313e-16)
#define TINY R(1e-290)
#define EVENT_LOCATION_NOISE R(1e-13)
#define AT_FACE R(1e-09)
#define RADIUS_NOISE R(4.440892098500626e-16)
#define SURFACE_TOLERANCE R(1e-10)
#define LEAST_RISE R(0.0)
#else
#define NOISE R(4.76837158203125e-07)
#define DIRECTION_NOISE R(1.1920928955078125e-07)
#define TINY R(1e-30)
#define EVENT_LOCATION_NOISE R(1e-05)
#define AT_FACE R(1e-06)
#define RADIUS_NOISE R(2.384185791015625e-07)
#define SURFACE_TOLERANCE R(1e-09)
#define LEAST_RISE R(2.384185791015625e-07)
#endif

#endif
