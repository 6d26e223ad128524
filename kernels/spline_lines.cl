// Solves for the coefficients of the cubic splines through the values of lines by elimination: see _eliminated in
// aerokernels/medium/spline.py. A work-item solves LANES lines. The ends are not-a-knot, or the first end is mirrored
// (even).
//
// Lines first_line up to line_count: values_in (outer, count, pitch), coefficients_out (outer, count + 2, pitch);
// a line is (outer, all, inner). inverse_in: inverse pivots of the equations, shape (count - 1,).
// ambient: if it is above 0, the values are contrasts m, and the spline is that of the potential m (ambient + m / 2).

#include "arguments.h"
#include "neighbors.h"

// Values of a node, or their potentials.
INLINED doubles values_at(__global const double *from, ints after, int in_row, double ambient)
{
    const doubles value = read_all(from, after, in_row);
    return ambient > 0.0 ? value * (ambient + 0.5 * value) : value;
}

// Nodes that are read ahead of the elimination: on a GPU each step would otherwise wait for memory. A processor reads
// ahead itself.
#if LANES == 1
#define AHEAD 32
#else
#define AHEAD 1
#endif

#define VALUE(node) values_at(values + (size_t)(node) * pitch, value_after, in_row, ambient)
#define MADE(row) read_all(made + (size_t)(row) * pitch, made_after, in_row)
#define MAKE(row, coefficients) write_all(coefficients, made + (size_t)(row) * pitch, made_after, in_row)

__kernel void spline_lines(SPLINE_LINES_ARGUMENTS)
{
    const int begin = (int)get_global_id(0) * LANES + first_line;
    if (begin >= line_count) {
        return;
    }
    const int outer = begin / pitch;
    const int inner = begin - outer * pitch;
    const int in_row = inner + LANES <= pitch && begin + LANES <= line_count;
    // Lanes beyond the last line solve that line too. A lane that is in the next row of lines is a row of nodes further.
    const ints line = min((ints)(LANE_NUMBERS), (ints)(line_count - 1 - begin));
    const ints rows_on = (inner + line) / pitch;
    const ints value_after = line + rows_on * ((count - 1) * pitch);
    const ints made_after = line + rows_on * ((count + 1) * pitch);
    __global const double *values = values_in + (size_t)outer * count * pitch + inner;
    __global double *made = coefficients_out + (size_t)outer * (count + 2) * pitch + inner;
    const int last = count - 1;
    const int first = even ? 2 : 3;
    doubles before = 6.0 * VALUE(0);
    if (even) {
        MAKE(1, before);
    } else {
        const doubles second = VALUE(1);
        before = second - (VALUE(0) - 2.0 * second + VALUE(2)) / 6.0;
        MAKE(2, before);
    }
    doubles ahead[AHEAD];
    double pivots[AHEAD];
    for (int begin_row = first; begin_row < last; begin_row += AHEAD) {
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            const int node = min(begin_row + k, last - 1) - 1;
            ahead[k] = VALUE(node);
            pivots[k] = inverse_in[node];
        }
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            if (begin_row + k < last) {
                before = 6.0 * ahead[k] - before * pivots[k];
                MAKE(begin_row + k, before);
            }
        }
    }
    const doubles inward = VALUE(count - 2);
    doubles after = inward - (VALUE(count - 3) - 2.0 * inward + VALUE(count - 1)) / 6.0;
    MAKE(last, after);
    for (int begin_row = last - 1; begin_row >= first; begin_row -= AHEAD) {
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            const int row = max(begin_row - k, first);
            ahead[k] = MADE(row);
            pivots[k] = inverse_in[row];
        }
        #pragma unroll
        for (int k = 0; k < AHEAD; ++k) {
            if (begin_row - k >= first) {
                after = (ahead[k] - after) * pivots[k];
                MAKE(begin_row - k, after);
            }
        }
    }
    if (even) {
        MAKE(1, 0.25 * (MADE(1) - 2.0 * MADE(2)));
        MAKE(0, MADE(2));
    } else {
        MAKE(1, 6.0 * VALUE(1) - 4.0 * MADE(2) - MADE(3));
        MAKE(0, 6.0 * VALUE(0) - 4.0 * MADE(1) - MADE(2));
    }
    MAKE(last + 1, 6.0 * VALUE(last - 1) - 4.0 * MADE(last) - MADE(last - 1));
    MAKE(last + 2, 6.0 * VALUE(last) - 4.0 * MADE(last + 1) - MADE(last));
}
