"""The process and its machine: cores, memory, threads, children, interrupts, clocks, and caches of compiled kernels."""
