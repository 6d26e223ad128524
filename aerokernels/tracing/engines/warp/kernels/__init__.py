"""The Warp kernels and their functions; scripts/generate_kernels writes OpenCL C from some of them."""
