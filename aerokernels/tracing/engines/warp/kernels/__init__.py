"""The Warp kernels and their functions; each file has the name of its OpenCL twin in kernels/."""
