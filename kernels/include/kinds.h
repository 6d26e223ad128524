// What follows from the options.
#ifndef KINDS_H
#define KINDS_H

#include "options.h"

#define CONTROLLED (METHOD == ADAPTIVE || METHOD == STRAIGHT)
#define IS_STRAIGHT (METHOD == STRAIGHT)
// Index and gradient are one interpolant's: in the paper's schemes |T| = n does not hold between them.
#define CONSISTENT_GRADIENT (INTERPOLATION != BILINEAR_BARRON && INTERPOLATION != IDW)
// The interpolant is smooth in each cell only: steps end at the faces of cells.
#define PIECEWISE_SMOOTH (!ON_MESH && CONTROLLED && (INTERPOLATION == LINEAR || INTERPOLATION == MONOTONE))
#define AT_FACES (!ON_MESH && CONTROLLED && INTERPOLATION == LINEAR)
#define FACE_COUNT (GEOMETRY == VOLUME ? 6 : GEOMETRY == PLANAR ? 4 : 3)
// Axes, from the last one on, whose faces are flat: the first surfaces, two to an axis.
#define FLAT_AXES (GEOMETRY == VOLUME ? 3 : GEOMETRY == PLANAR ? 2 : 1)
// Threads of an NVIDIA GPU look up cubes together, over a desk for each warp of 32: rows of five fours of numbers, of which
// the last is spare, so that neighbours' rows lie in different banks of memory.
#if CUBES && LANES == 1 && defined(__NV_CL_C_VERSION)
#define DESKS 1
#define WARP 32
#define DESK_ROW 5
#endif

#endif
