// What a kernel is built for. The host sets these as -D options, see aerokernels/tracing/engines/opencl/program.py; the
// defaults stand here so that a kernel without options still compiles.
#ifndef OPTIONS_H
#define OPTIONS_H

// GEOMETRY
#define PLANAR 2
#define AXISYMMETRIC 3
#define VOLUME 4
// INTERPOLATION: on a grid, then on a mesh
#define CUBIC 1
#define LINEAR 2
#define MONOTONE 3
#define BILINEAR 4
#define BILINEAR_BARRON 5
#define IDW 6
// METHOD
#define ADAPTIVE 1
#define STRAIGHT 2
#define FIXED 3
#define PAPER 4
// STOP
#define NONE 1
#define PLANE 2
#define ARC 3

#ifndef REAL_IS_DOUBLE
#define REAL_IS_DOUBLE 0
#endif
#ifndef GEOMETRY
#define GEOMETRY VOLUME
#endif
#ifndef INTERPOLATION
#define INTERPOLATION CUBIC
#endif
#ifndef ON_MESH
#define ON_MESH 0
#endif
#ifndef METHOD
#define METHOD ADAPTIVE
#endif
#ifndef STOP
#define STOP NONE
#endif
// Rays that a work-item of leapfrog samples moves in step.
#ifndef LANES
#define LANES 1
#endif
// Whether a node's entry of the coefficients holds all that leapfrog samples take from there, see packet.h.
#ifndef PACKED
#define PACKED 0
#endif
// Whether all rays of leapfrog samples run along z, in a field of two dimensions.
#ifndef IN_PLANE
#define IN_PLANE 0
#endif
#ifndef HAS_BODY
#define HAS_BODY 0
#endif
// Whether the errors of steps are estimated; error control needs them.
#ifndef MEASURED
#define MEASURED 1
#endif
// Whether the tables of columns give positions, arc lengths and errors, too.
#ifndef WITH_ENDS
#define WITH_ENDS 1
#endif

// What follows from them.
#define CONTROLLED (METHOD == ADAPTIVE || METHOD == STRAIGHT)
#define IS_STRAIGHT (METHOD == STRAIGHT)
// Index and gradient are one interpolant's: in the paper's schemes |T| = n does not hold between them.
#define ONE_SCALAR (INTERPOLATION != BILINEAR_BARRON && INTERPOLATION != IDW)
// The interpolant has kinks at the faces of cells, at which steps end.
#define KINKED (!ON_MESH && CONTROLLED && (INTERPOLATION == LINEAR || INTERPOLATION == MONOTONE))
#define AT_FACES (!ON_MESH && CONTROLLED && INTERPOLATION == LINEAR)
#define FACE_COUNT (GEOMETRY == VOLUME ? 6 : GEOMETRY == PLANAR ? 4 : 3)

#endif
