// Solves for the coefficients of the cubic splines through the values of lines, one work-item per line, by elimination:
// see _eliminated in aerokernels/medium/spline.py. The ends are not-a-knot, or the first end is mirrored (even).
//
// Lines first_line up to line_count: values_in (outer, count, pitch), coefficients_out (outer, count + 2, pitch);
// a line is (outer, all, inner). inverse_in: inverse pivots of the equations, shape (count - 1,).
// ambient: if it is above 0, the values are contrasts m, and the spline is that of the potential m (ambient + m / 2).

#include "arguments.h"
#include "real.h"

#define VALUE(node) (ambient > 0.0 \
    ? values[(size_t)(node) * pitch] * (ambient + 0.5 * values[(size_t)(node) * pitch]) \
    : values[(size_t)(node) * pitch])
#define MADE(row) made[(size_t)(row) * pitch]

__kernel void spline_lines(SPLINE_LINES_ARGUMENTS)
{
    const int line = (int)get_global_id(0) + first_line;
    if (line >= line_count) {
        return;
    }
    const int outer = line / pitch;
    const int inner = line - outer * pitch;
    __global const double *values = values_in + (size_t)outer * count * pitch + inner;
    __global double *made = coefficients_out + (size_t)outer * (count + 2) * pitch + inner;
    const int last = count - 1;
    const int first = even ? 2 : 3;
    double before = 6.0 * VALUE(0);
    if (even) {
        MADE(1) = before;
    } else {
        const double second = VALUE(1);
        before = second - (VALUE(0) - 2.0 * second + VALUE(2)) / 6.0;
        MADE(2) = before;
    }
    for (int row = first; row < last; ++row) {
        before = 6.0 * VALUE(row - 1) - before * inverse_in[row - 1];
        MADE(row) = before;
    }
    const double inward = VALUE(count - 2);
    double after = inward - (VALUE(count - 3) - 2.0 * inward + VALUE(count - 1)) / 6.0;
    MADE(last) = after;
    for (int row = last - 1; row >= first; --row) {
        after = (MADE(row) - after) * inverse_in[row];
        MADE(row) = after;
    }
    if (even) {
        MADE(1) = 0.25 * (MADE(1) - 2.0 * MADE(2));
        MADE(0) = MADE(2);
    } else {
        MADE(1) = 6.0 * VALUE(1) - 4.0 * MADE(2) - MADE(3);
        MADE(0) = 6.0 * VALUE(0) - 4.0 * MADE(1) - MADE(2);
    }
    MADE(last + 1) = 6.0 * VALUE(last - 1) - 4.0 * MADE(last) - MADE(last - 1);
    MADE(last + 2) = 6.0 * VALUE(last) - 4.0 * MADE(last + 1) - MADE(last);
}
