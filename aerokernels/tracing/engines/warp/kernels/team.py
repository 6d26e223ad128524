"""Device functions for threads that share a group of rays, a warp on a GPU, or that share a ray; one on a CPU."""

import warp as wp

from ..library import KernelLibrary, built_once

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


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return threadIdx.x & 3;
#else
    return 0;
#endif
""")
def place_at_ray() -> int:
    """Number of this thread among the RAY_THREADS threads that trace its ray together."""
    ...


# In the same order for all threads of a ray.
SUM_AT_RAY = """
#if defined(__CUDA_ARCH__)
    const unsigned team = 0xfu << (threadIdx.x & 28);
    part += __shfl_xor_sync(team, part, 1);
    part += __shfl_xor_sync(team, part, 2);
#endif
    return part;
"""


@built_once
def build_sum_at_ray(library: KernelLibrary):
    """Build a function part -> the sum of `part` over the threads that trace a ray together, known to all of them."""
    real = library.types.real

    @wp.func_native(SUM_AT_RAY)
    def sum_at_ray(part: real) -> real: ...

    return sum_at_ray


@built_once
def build_pick_at_ray(library: KernelLibrary):
    """Build a function weights -> the one with the number of this thread; an index that varies would use memory."""
    t = library.types
    real, vec4 = t.real, t.vec4

    @wp.func
    def pick_at_ray(weights: vec4) -> real:
        k = place_at_ray()
        lower = wp.where(k == 0, weights[0], weights[1])
        upper = wp.where(k == 2, weights[2], weights[3])
        return wp.where(k < 2, lower, upper)

    return pick_at_ray
