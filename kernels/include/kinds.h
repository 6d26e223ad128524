// Macros derived from the compile options.
#ifndef KINDS_H
#define KINDS_H

#include "options.h"

#define CONTROLLED (METHOD == ADAPTIVE || METHOD == STRAIGHT)
#define IS_STRAIGHT (METHOD == STRAIGHT)
// Index and gradient come from the same interpolant; in the paper's schemes they do not, and |T| = n does not hold.
#define CONSISTENT_GRADIENT (INTERPOLATION != BILINEAR_BARRON && INTERPOLATION != IDW)
// The interpolant is smooth only within each cell: steps end at the faces of cells.
#define PIECEWISE_SMOOTH (!ON_MESH && CONTROLLED && (INTERPOLATION == LINEAR || INTERPOLATION == MONOTONE))
#define AT_FACES (!ON_MESH && CONTROLLED && INTERPOLATION == LINEAR)
// The jumps at the edges of a mesh's cells are known, so that a step may cross some.
#define KINKS_PASSED (INTERPOLATION == BILINEAR)
#define FACE_COUNT (GEOMETRY == VOLUME ? 6 : GEOMETRY == PLANAR ? 4 : 3)
// How many axes, counted from z, have flat faces: these are the first surfaces, two per axis.
#define FLAT_AXES (GEOMETRY == VOLUME ? 3 : GEOMETRY == PLANAR ? 2 : 1)
// Threads of an NVIDIA GPU run in warps, see warp_threads.h.
#if LANES == 1 && defined(__NV_CL_C_VERSION)
#define IN_WARPS 1
#endif
// They load cubes together through a desk in local memory for each warp. A row of the desk takes five float4, the last
// unused, to avoid bank conflicts.
#if CUBES && IN_WARPS
#define DESKS 1
#define DESK_ROW 5
#endif

#endif
