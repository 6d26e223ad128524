"""Device functions in C++ that read the coefficients of a grid, one by one or for a whole cell of a volume.

Warp checks every index for counting from the array's end, and multiplies it by a stride that the compiler does not
know: six instructions per coefficient, beside the four that use it. Here an index counts from the start of a contiguous
array.
"""

import warp as wp

from ..library import KernelLibrary, built_once

# On a CPU the 64 coefficients of a volume's cell fill vectors of 16 lanes. All sums are in the order of the loops of
# grid.py, so the results are the same to the bit. A lane is a row along the last axis, four times four, the first axis
# outermost; `transposed` transposes each block of four lanes and four vectors.
VOLUME_LOOKUP = """
#if defined(__CUDA_ARCH__)
    return wp::vec_t<4, REAL>();
#else
    typedef REAL four __attribute__((vector_size(4 * sizeof(REAL))));
    typedef REAL row_in_memory __attribute__((vector_size(4 * sizeof(REAL)), aligned(sizeof(REAL))));
    typedef REAL lanes __attribute__((vector_size(16 * sizeof(REAL))));
    auto row = [&](int i, int j) -> four {
        return *(const row_in_memory *)(coefficients.data + start + i * pitch[0] + j * pitch[1]);
    };
    auto column = [&](int j) {
        return __builtin_shufflevector(
            __builtin_shufflevector(row(0, j), row(1, j), 0, 1, 2, 3, 4, 5, 6, 7),
            __builtin_shufflevector(row(2, j), row(3, j), 0, 1, 2, 3, 4, 5, 6, 7),
            0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    };
    auto transposed = [](lanes a, lanes b, lanes c, lanes d, lanes *out) {
        const lanes ab = __builtin_shufflevector(a, b, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
        const lanes AB = __builtin_shufflevector(a, b, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
        const lanes cd = __builtin_shufflevector(c, d, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
        const lanes CD = __builtin_shufflevector(c, d, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31);
        out[0] = __builtin_shufflevector(ab, cd, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
        out[1] = __builtin_shufflevector(ab, cd, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
        out[2] = __builtin_shufflevector(AB, CD, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
        out[3] = __builtin_shufflevector(AB, CD, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31);
    };
    auto repeated = [](wp::vec_t<4, REAL> w) {
        const four once = {w[0], w[1], w[2], w[3]};
        return __builtin_shufflevector(once, once, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3);
    };
    lanes c[4], along = {}, climb = {};  // coefficient k of every row; value and slope along the last axis
    transposed(column(0), column(1), column(2), column(3), c);
    for (int k = 0; k < 4; k++) {
        along = along + wc[k] * c[k];
        climb = climb + sc[k] * c[k];
    }
    // Sum along the second axis the value, the value, the slope along it, the slope along the last axis: a lane each.
    lanes term[4], sheet = {};
    const lanes value = repeated(wb) * along, second = repeated(sb) * along, third = repeated(wb) * climb;
    transposed(value, value, second, third, term);
    for (int j = 0; j < 4; j++) {
        sheet = sheet + term[j];
    }
    // Sum along the first axis; the second lane takes the slopes of the weights and becomes the slope along this axis.
    const four values = {wa[0], wa[1], wa[2], wa[3]}, slopes = {sa[0], sa[1], sa[2], sa[3]};
    sheet = __builtin_shufflevector(values, slopes, 0, 4, 0, 0, 1, 5, 1, 1, 2, 6, 2, 2, 3, 7, 3, 3) * sheet;
    four total = {};
    total = total + __builtin_shufflevector(sheet, sheet, 0, 1, 2, 3);
    total = total + __builtin_shufflevector(sheet, sheet, 4, 5, 6, 7);
    total = total + __builtin_shufflevector(sheet, sheet, 8, 9, 10, 11);
    total = total + __builtin_shufflevector(sheet, sheet, 12, 13, 14, 15);
    return wp::vec_t<4, REAL>(total[0], total[1], total[2], total[3]);
#endif
"""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return false;
#else
    return true;
#endif
""")
def on_processor() -> bool:
    """Whether the kernel is compiled for a CPU; the compiler drops the branch not taken."""
    ...


@built_once
def build_entry(library: KernelLibrary):
    """Build a function (numbers, place) -> the number at that place of a contiguous array."""
    real = library.types.real

    @wp.func_native("return numbers.data[place];")
    def entry(numbers: wp.array(dtype=real), place: int) -> real: ...

    return entry


@built_once
def build_volume_lookup(library: KernelLibrary):
    """Build a function -> value and slopes per cell of a volume, for CPUs only; see VOLUME_LOOKUP.

    Its arguments: the coefficients, the entry at which the cell's coefficients begin, the distance of its rows along
    the first two axes, and the four weights and their slopes along each axis.
    """
    t = library.types
    real, vec4 = t.real, t.vec4

    @wp.func_native(VOLUME_LOOKUP.replace("REAL", f"wp::{library.precision}"))
    def volume_lookup(
        coefficients: wp.array(dtype=real),
        start: int,
        pitch: wp.vec3i,
        wa: vec4,
        sa: vec4,
        wb: vec4,
        sb: vec4,
        wc: vec4,
        sc: vec4,
    ) -> vec4: ...

    return volume_lookup
