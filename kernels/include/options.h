// What a kernel is built for: the host sets these as -D options, see opencl/program.py.
// Written by scripts/kernel_headers from aerokernels/tracing/engines/layout.py: change it there.
#ifndef OPTIONS_H
#define OPTIONS_H

// REAL_IS_DOUBLE: whether deviations are float64.
#ifndef REAL_IS_DOUBLE
#define REAL_IS_DOUBLE 0
#endif

// GEOMETRY: of the field.
#define VOLUME 1
#define PLANAR 2
#define AXISYMMETRIC 3
#ifndef GEOMETRY
#define GEOMETRY VOLUME
#endif

// INTERPOLATION: on a grid, then on a mesh.
#define CUBIC 1
#define LINEAR 2
#define MONOTONE 3
#define BILINEAR 4
#define BILINEAR_BARRON 5
#define IDW 6
#ifndef INTERPOLATION
#define INTERPOLATION CUBIC
#endif

// METHOD: how long steps are.
#define ADAPTIVE 1
#define STRAIGHT 2
#define FIXED 3
#define PAPER 4
#ifndef METHOD
#define METHOD ADAPTIVE
#endif

// STOP: where rays end.
#define NONE 1
#define PLANE 2
#define ARC 3
#ifndef STOP
#define STOP NONE
#endif

// ON_MESH: whether samples are on a mesh.
#ifndef ON_MESH
#define ON_MESH 0
#endif

// HAS_BODY: whether the field has a body.
#ifndef HAS_BODY
#define HAS_BODY 0
#endif

// MEASURED: whether the errors of steps are estimated; error control needs them.
#ifndef MEASURED
#define MEASURED 1
#endif

// WITH_ENDS: whether projection tables give positions, arc lengths and errors, too.
#ifndef WITH_ENDS
#define WITH_ENDS 1
#endif

// LANES: rays that a work-item of leapfrog samples moves in step.
#ifndef LANES
#define LANES 1
#endif

// PACKED: whether coefficients are the polynomials of cells, for leapfrog samples in two dimensions.
#ifndef PACKED
#define PACKED 0
#endif

// IN_PLANE: whether all rays of leapfrog samples run along z, in a field of two dimensions.
#ifndef IN_PLANE
#define IN_PLANE 0
#endif

// CHANNELS: how many numbers are interpolated between traced rays.
#ifndef CHANNELS
#define CHANNELS 8
#endif

#endif
