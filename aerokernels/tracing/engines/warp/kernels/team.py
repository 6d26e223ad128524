"""Device functions for threads that share a group of rays: a warp of a GPU; on a processor one thread has it all."""

import warp as wp

# Threads of a warp, all of which are there: kernels that use these are launched over whole warps.
WARP = 32


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return threadIdx.x & 31;
#else
    return 0;
#endif
""")
def place_in_team() -> int:
    """Which of a group's threads this is."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 1;
#endif
""")
def team_size() -> int:
    """Threads that share a group."""
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
    """The sum of what all threads of a group have."""
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
    """The greatest of what all threads of a group have."""
    ...
