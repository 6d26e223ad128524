// What the 32 threads of a warp of an NVIDIA GPU do together; all of them must be active.
#ifndef WARP_THREADS_H
#define WARP_THREADS_H

#include "real.h"

#if IN_WARPS

#define WARP 32

static inline int is_whole_warp(void)
{
    uint found;
    asm volatile("activemask.b32 %0;" : "=r"(found));
    return found == 0xffffffffu;
}

static inline int from_thread(int number, int thread)
{
    int found;
    asm volatile("shfl.sync.idx.b32 %0, %1, %2, 0x1f, 0xffffffff;" : "=r"(found) : "r"(number), "r"(thread));
    return found;
}

// The number of the thread whose place differs in the bits of `mask`.
static inline float from_across(float number, int mask)
{
    int found;
    asm volatile("shfl.sync.bfly.b32 %0, %1, %2, 0x1f, 0xffffffff;" : "=r"(found) : "r"(as_int(number)), "r"(mask));
    return as_float(found);
}

#if THREADS > 1

// Number of this thread among those that trace its ray together.
#define PLACE_AT_RAY ((int)get_local_id(0) % THREADS)

static inline float across_ray(float number, int mask)
{
    int found;
    const int team = 0xf << ((int)get_local_id(0) % WARP & ~3);
    asm volatile(
        "shfl.sync.bfly.b32 %0, %1, %2, 0x1f, %3;" : "=r"(found) : "r"(as_int(number)), "r"(mask), "r"(team));
    return as_float(found);
}

// The sum of a number over the threads of a ray, the same in all of them.
static inline real sum_of_threads(real part)
{
#pragma unroll
    for (int mask = 1; mask < THREADS; mask *= 2) {
#if REAL_IS_DOUBLE
        const float2 halves = as_float2(part);
        part += as_double((float2)(across_ray(halves.x, mask), across_ray(halves.y, mask)));
#else
        part += across_ray(part, mask);
#endif
    }
    return part;
}

#endif

static inline void meet_in_warp(void)
{
    asm volatile("bar.warp.sync 0xffffffff;" : : : "memory");
}

#endif

#endif
