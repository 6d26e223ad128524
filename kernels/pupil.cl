// The kernels of a pupil, built together: to load a program from a driver's cache takes longer than to trace a pupil.

#include "launch_pupil.cl"
#include "sum_rays.cl"
#include "reduce_sums.cl"
