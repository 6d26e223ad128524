"""The OpenCL engine: kernels in C, on any device with a driver."""
