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

static inline void meet_in_warp(void)
{
    asm volatile("bar.warp.sync 0xffffffff;" : : : "memory");
}

#endif

#endif
