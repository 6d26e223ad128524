"""Device functions in C++ that read the coefficients of a grid, one by one or for a whole cell of a volume.

Warp checks every index for counting from the array's end, and multiplies it by a stride that the compiler does not
know: six instructions per coefficient, beside the four that use it. Here an index counts from the start of a contiguous
array.
"""

import warp as wp

from ..library import KernelLibrary, built_once

# On a CPU a row of coefficients is a vector. All sums are in the order of grid.py: the results are the same to the bit.
VOLUME_LOOKUP = """
#if defined(__CUDA_ARCH__)
    return wp::vec_t<4, REAL>();
#else
    typedef REAL four __attribute__((vector_size(4 * sizeof(REAL))));
    typedef REAL row_in_memory __attribute__((vector_size(4 * sizeof(REAL)), aligned(sizeof(REAL))));
    four total = {}, first = {}, second = {};
    for (int i = 0; i < 4; i++) {
        four sheet = {}, bend = {};
        for (int j = 0; j < 4; j++) {
            const four row = *(const row_in_memory *)(coefficients.data + start + i * pitch[0] + j * pitch[1]);
            sheet = sheet + wb[j] * row;
            bend = bend + sb[j] * row;
        }
        total = total + wa[i] * sheet;
        first = first + sa[i] * sheet;
        second = second + wa[i] * bend;
    }
    auto sum = [](wp::vec_t<4, REAL> w, four v) { return w[0] * v[0] + w[1] * v[1] + w[2] * v[2] + w[3] * v[3]; };
    return wp::vec_t<4, REAL>(sum(wc, total), sum(wc, first), sum(wc, second), sum(sc, total));
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
