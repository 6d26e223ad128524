// The value of a bicubic Hermite patch, for CHANNELS channels at once; see aerokernels/tracing/bundle/lattice.py.
//
// A node has four numbers for each channel: value, slope along u, slope along v, mixed slope. A block has five by five
// nodes. Sums are in the precision of the table: bundle/refine.py allows for their rounding.
#ifndef PATCHES_H
#define PATCHES_H

#include "real.h"
#include "warp_threads.h"

// Number of a channel of a patch.
#if CHANNELS == 1
#define CHANNEL(patch, k) (patch)
#else
#define CHANNEL(patch, k) ((real *)&(patch))[k]
#endif

#if CHANNELS == 1
typedef real channels;
#define LOAD(at, patches) (patches)[at]
#define FROM_ACROSS(v, mask) from_across(v, mask)
#elif CHANNELS == 4
typedef real4 channels;
#define LOAD(at, patches) vload4(at, patches)
#define FROM_ACROSS(v, mask) \
    (float4)(from_across((v).s0, mask), from_across((v).s1, mask), from_across((v).s2, mask), from_across((v).s3, mask))
#else
typedef real8 channels;
#define LOAD(at, patches) vload8(at, patches)
#define FROM_ACROSS(v, mask) \
    (float8)( \
        from_across((v).s0, mask), from_across((v).s1, mask), from_across((v).s2, mask), from_across((v).s3, mask), \
        from_across((v).s4, mask), from_across((v).s5, mask), from_across((v).s6, mask), from_across((v).s7, mask))
#endif

// Weights at 0 and at 1 of the value, or of the slope.
static inline real2 hermite_weights(int of_slope, real u)
{
    const real v = R(1.0) - u;
    return of_slope ? (real2)(u * v * v, -u * u * v)
                    : (real2)((R(1.0) + R(2.0) * u) * v * v, u * u * (R(3.0) - R(2.0) * u));
}

// What number `number` (0 to 3) of the four nodes about a place adds; the first node's numbers begin at entry `at`.
static inline channels of_number(__global const real *patches, int at, int number, real u, real v)
{
    const real2 along_u = hermite_weights(number & 1, u), along_v = hermite_weights(number & 2, v);
    const int first = at + number;
    return along_u.x * along_v.x * LOAD(first, patches) + along_u.x * along_v.y * LOAD(first + 4, patches)
        + along_u.y * along_v.x * LOAD(first + 20, patches) + along_u.y * along_v.y * LOAD(first + 24, patches);
}

#if IN_WARPS && !REAL_IS_DOUBLE

// An NVIDIA GPU fetches every cache line that a load of a warp touches, and a thread that loads the sixteen numbers of
// its own cell touches lines of its own with each load. So four neighbouring threads sum the patches of their four rays
// together: each loads and sums one of the four numbers of every node, then they exchange and add the parts.
static inline channels sum_together(__global const real *patches, int at, real u, real v)
{
    const int thread = get_local_id(0) % WARP, number = thread & 3, first = thread & ~3;
    channels part[4];
#pragma unroll
    for (int ray = 0; ray < 4; ray++) {
        const int its_at = from_thread(at, first + ray);
        const real its_u = as_float(from_thread(as_int(u), first + ray));
        const real its_v = as_float(from_thread(as_int(v), first + ray));
        part[ray] = of_number(patches, its_at, number, its_u, its_v);
    }
    // Each thread keeps the parts of half of the rays and gives away the others, then once more.
    const int odd = number & 1, high = number & 2;
    const channels first_kept = odd ? part[1] : part[0], first_given = odd ? part[0] : part[1];
    const channels last_kept = odd ? part[3] : part[2], last_given = odd ? part[2] : part[3];
    const channels first_two = first_kept + FROM_ACROSS(first_given, 1);
    const channels last_two = last_kept + FROM_ACROSS(last_given, 1);
    const channels kept = high ? last_two : first_two, given = high ? first_two : last_two;
    return kept + FROM_ACROSS(given, 2);
}

#endif

// The patch at the place (u, v) of a cell, each from 0 to 1; `at` is the entry of the cell's first node, in units of
// CHANNELS numbers.
static inline channels in_patch(__global const real *patches, int at, real u, real v)
{
#if IN_WARPS && !REAL_IS_DOUBLE
    if (is_whole_warp()) {
        return sum_together(patches, at, u, v);
    }
#endif
    const channels values = of_number(patches, at, 0, u, v) + of_number(patches, at, 1, u, v);
    return values + (of_number(patches, at, 2, u, v) + of_number(patches, at, 3, u, v));
}

#endif
