// Numbers of an array for all lanes of a work-item: those in a row from the first lane's on, which a pointer points to,
// or those that lie some numbers after it.
#ifndef NEIGHBORS_H
#define NEIGHBORS_H

#include "lanes.h"

#if LANES == 1
#define LANE_NUMBERS 0
INLINED doubles read_row(__global const double *from) { return *from; }
INLINED void write_row(doubles value, __global double *to) { *to = value; }
INLINED doubles read_all(__global const double *from, ints after, int in_row) { return *from; }
INLINED void write_all(doubles value, __global double *to, ints after, int in_row) { *to = value; }
#elif REAL_IS_DOUBLE
#define LANE_NUMBERS 0, 1, 2, 3, 4, 5, 6, 7
INLINED doubles read_row(__global const double *from) { return vload8(0, from); }
INLINED void write_row(doubles value, __global double *to) { vstore8(value, 0, to); }

// Where the numbers are in a row, as `in_row` says, they are read and written together.
INLINED doubles read_all(__global const double *from, ints after, int in_row)
{
    if (in_row) {
        return read_row(from);
    }
    return (doubles)(from[after.s0], from[after.s1], from[after.s2], from[after.s3],
        from[after.s4], from[after.s5], from[after.s6], from[after.s7]);
}

INLINED void write_all(doubles value, __global double *to, ints after, int in_row)
{
    if (in_row) {
        write_row(value, to);
        return;
    }
    for (int lane = 0; lane < LANES; ++lane) {
        to[INT_AT(after, lane)] = DOUBLE_AT(value, lane);
    }
}
#else
#error these numbers are double
#endif

#endif
