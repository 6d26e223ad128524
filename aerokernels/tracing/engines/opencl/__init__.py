"""OpenCL: kernels in C, on any device with a driver."""
