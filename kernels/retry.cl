// The kernels for another attempt at rejected rays, built together.

#include "collect_rejected.cl"
#include "deliver_retraced.cl"
