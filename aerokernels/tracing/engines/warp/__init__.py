"""The Warp engine: kernels in Python, on the CPU and on CUDA devices."""
