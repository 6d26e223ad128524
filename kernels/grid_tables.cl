// The kernels that prepare a grid, built together.

#include "spline_lines.cl"
#include "column_maxima.cl"
#include "block_maxima.cl"
