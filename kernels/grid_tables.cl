// The kernels that prepare a grid, and those that examine new values on its nodes, built together.

#include "spline_lines.cl"
#include "column_maxima.cl"
#include "block_maxima.cl"
#include "rule_in_blocks.cl"
#include "missed_in_layers.cl"
#include "missed_around.cl"
#include "greatest_outside.cl"
