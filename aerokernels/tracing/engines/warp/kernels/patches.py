"""Device function: the value of a bicubic Hermite patch, see tracing/bundle/hermite.py."""

import warp as wp

from ..library import KernelLibrary, built_once

# A node has four numbers for each channel: value, slope along u, slope along v, mixed slope; a block has five by five
# nodes. `part_of` sums one of the four numbers over the nodes about a place. A GPU fetches every cache line that a load
# of a warp touches, and a thread that loads the sixteen numbers of its own cell touches lines of its own with each
# load. So four neighbouring threads of a whole warp sum the patches of their four rays together: each takes one of the
# four numbers, then they exchange and add the parts, each keeping the parts of half of the rays, and then once more.
IN_PATCH = """
    typedef wp::vec_t<COUNT, REAL> channels;
    const auto load = [](const REAL *from, REAL *to) {
#if defined(__CUDA_ARCH__)
        const int wide = sizeof(WIDE) / sizeof(REAL);
        if (COUNT % wide == 0) {
#pragma unroll
            for (int k = 0; k < COUNT; k += wide) {
                const WIDE several = __ldg(reinterpret_cast<const WIDE *>(from + k));
                const REAL *each = reinterpret_cast<const REAL *>(&several);
#pragma unroll
                for (int n = 0; n < wide; n++) {
                    to[k + n] = each[n];
                }
            }
            return;
        }
#endif
        for (int k = 0; k < COUNT; k++) {
            to[k] = from[k];
        }
    };
    const auto part_of = [&](int number, int at, REAL u, REAL v) {
        const REAL one = REAL(1), two = REAL(2), three = REAL(3), p = one - u, q = one - v;
        const bool u_slope = number & 1, v_slope = number & 2;
        const REAL u0 = u_slope ? u * p * p : (one + two * u) * p * p;
        const REAL u1 = u_slope ? -u * u * p : u * u * (three - two * u);
        const REAL v0 = v_slope ? v * q * q : (one + two * v) * q * q;
        const REAL v1 = v_slope ? -v * v * q : v * v * (three - two * v);
        const REAL w00 = u0 * v0, w01 = u0 * v1, w10 = u1 * v0, w11 = u1 * v1;
        const REAL *first = patches.data + COUNT * (at + number);
        REAL n00[COUNT], n01[COUNT], n10[COUNT], n11[COUNT];
        load(first, n00);
        load(first + 4 * COUNT, n01);
        load(first + 20 * COUNT, n10);
        load(first + 24 * COUNT, n11);
        channels sum;
#pragma unroll
        for (int k = 0; k < COUNT; k++) {
            sum[k] = w00 * n00[k] + w01 * n01[k] + w10 * n10[k] + w11 * n11[k];
        }
        return sum;
    };
#if defined(__CUDA_ARCH__)
    if (__activemask() == 0xffffffffu) {
        const int thread = threadIdx.x & 31, number = thread & 3, first = thread & ~3;
        channels part[4];
#pragma unroll
        for (int ray = 0; ray < 4; ray++) {
            const int its_at = __shfl_sync(0xffffffffu, at, first + ray);
            const REAL its_u = __shfl_sync(0xffffffffu, u, first + ray);
            const REAL its_v = __shfl_sync(0xffffffffu, v, first + ray);
            part[ray] = part_of(number, its_at, its_u, its_v);
        }
        const bool odd = number & 1, high = number & 2;
        channels found;
#pragma unroll
        for (int k = 0; k < COUNT; k++) {
            const REAL given = odd ? part[0][k] : part[1][k], last_given = odd ? part[2][k] : part[3][k];
            const REAL two_first = (odd ? part[1][k] : part[0][k]) + __shfl_xor_sync(0xffffffffu, given, 1);
            const REAL two_last = (odd ? part[3][k] : part[2][k]) + __shfl_xor_sync(0xffffffffu, last_given, 1);
            found[k] = (high ? two_last : two_first) + __shfl_xor_sync(0xffffffffu, high ? two_first : two_last, 2);
        }
        return found;
    }
#endif
    const channels p0 = part_of(0, at, u, v), p1 = part_of(1, at, u, v);
    const channels p2 = part_of(2, at, u, v), p3 = part_of(3, at, u, v);
    channels found;
    for (int k = 0; k < COUNT; k++) {
        found[k] = (p0[k] + p1[k]) + (p2[k] + p3[k]);
    }
    return found;
"""


@built_once
def build_in_patch(library: KernelLibrary, channel_count: int):
    """Build a function (patches, at, u, v) -> the channels of a patch.

    (u, v) is the place in a cell, each from 0 to 1; `at` is the entry of the cell's first node, in units of
    `channel_count` numbers.
    """
    real = library.types.real
    # What a thread of a GPU loads at once, if so many channels are a multiple of it.
    wide = {"float32": "float4", "float64": "double2"}[library.precision]
    names = {"REAL": f"wp::{library.precision}", "WIDE": wide, "COUNT": str(channel_count)}
    source = IN_PATCH
    for name, value in names.items():
        source = source.replace(name, value)

    @wp.func_native(source)
    def in_patch(patches: wp.array(dtype=real), at: int, u: real, v: real) -> wp.types.vector(channel_count, real): ...

    return in_patch
