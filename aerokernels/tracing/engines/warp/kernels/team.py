"""Device functions for threads that share a group of rays: a warp on a GPU, one on a CPU."""

import warp as wp

# Threads of a warp, all of them active: kernels that use these functions are launched over whole warps.
WARP = 32


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return threadIdx.x & 31;
#else
    return 0;
#endif
""")
def place_in_team() -> int:
    """Number of this thread in its team."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 1;
#endif
""")
def team_size() -> int:
    """Number of threads that share a group of rays."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int way = 16; way > 0; way /= 2) {
        part += __shfl_xor_sync(0xffffffffu, part, way);
    }
#endif
    return part;
""")
def sum_of_team(part: wp.float64) -> wp.float64:
    """The sum of `part` over the threads of a team."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int way = 16; way > 0; way /= 2) {
        part = fmax(part, __shfl_xor_sync(0xffffffffu, part, way));
    }
#endif
    return part;
""")
def greatest_of_team(part: wp.float64) -> wp.float64:
    """The greatest `part` of the threads of a team."""
    ...
