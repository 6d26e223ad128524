// Map points of the unit square on a pupil, equal areas to equal shares, in units of the pupil's reach, all in double.
// aerokernels/pupils/square_map.py has the formulas and the table of each shape.
#ifndef PUPIL_SHAPE_H
#define PUPIL_SHAPE_H

#include "constants.h"

// Number of the interval that contains a value, of `count` intervals between the ascending shares in table_in from
// `begin` on.
int share_of(__global const double *table_in, const int begin, const int count, const double value)
{
    int low = 0;
    int high = count;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (table_in[begin + middle] <= value) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

// Position on the pupil of a point (u, v) of the unit square.
double2 place_on_pupil(
    const int shape,
    const int row_count,
    const int column_count,
    __global const double *table_in,
    const double u,
    const double v)
{
    if (shape == PUPIL_RING) {
        const double radius = sqrt(table_in[0] + (1.0 - table_in[0]) * u);
        const double angle = 6.283185307179586 * v;
        return (double2)(radius * cos(angle), radius * sin(angle));
    }
    if (shape == PUPIL_PIXELS) {
        const int row = share_of(table_in, PUPIL_PIXEL_HEADER, row_count, v);
        const double low = table_in[PUPIL_PIXEL_HEADER + row];
        const double up = (v - low) / (table_in[PUPIL_PIXEL_HEADER + row + 1] - low);
        const int begin = PUPIL_PIXEL_HEADER + row_count + 1 + row * (column_count + 1);
        const int column = share_of(table_in, begin, column_count, u);
        const double left = table_in[begin + column];
        const double across = (u - left) / (table_in[begin + column + 1] - left);
        return (double2)(
            table_in[0] + ((double)column + across) * table_in[2], table_in[1] + ((double)row + up) * table_in[3]);
    }
    const int one = share_of(table_in, 0, row_count, u);
    const double outward = sqrt((u - table_in[one]) / (table_in[one + 1] - table_in[one]));
    const int begin = row_count + 1 + 6 * one;
    const double2 corner = (double2)(table_in[begin], table_in[begin + 1]);
    const double2 first = (double2)(table_in[begin + 2], table_in[begin + 3]);
    const double2 second = (double2)(table_in[begin + 4], table_in[begin + 5]);
    return corner + outward * (first + v * (second - first));
}

#endif
