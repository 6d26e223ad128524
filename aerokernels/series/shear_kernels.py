"""Warp kernels of sheared_lattice.py, for the CPU and for GPUs, in the precision of the samples."""

from typing import Any


def build_kernels(precision: str, taps_u: int, taps_v: int) -> tuple[Any, Any]:
    """The kernels `shear`, for so many nodes across a line, and `rows`; for samples of "float32" or "float64"."""
    import warp as wp

    real: Any = {"float32": wp.float32, "float64": wp.float64}[precision]

    @wp.func
    def along(samples: wp.array(dtype=real), place: int, count: int, stride: int, base: int):
        """A sample of an axis, cubic beyond its ends."""
        if place >= 0 and place < count:
            return samples[base + place * stride]
        m = wp.min(-place, 3)
        first = base
        step = stride
        if place >= count:
            m = wp.min(place - count + 1, 3)
            first = base + (count - 1) * stride
            step = -stride
        a, b, c = m + 1, m + 2, m + 3
        total = real(float(a * b * c) / 6.0) * samples[first]
        total -= real(float(m * b * c) / 2.0) * samples[first + step]
        total += real(float(m * a * c) / 2.0) * samples[first + 2 * step]
        return total - real(float(m * a * b) / 6.0) * samples[first + 3 * step]

    @wp.func
    def sample(samples: wp.array(dtype=real), u: int, v: int, k: int, count: wp.vec3i, stride: wp.vec3i):
        """A sample of a plane, cubic beyond its edges, three cells at most."""
        base = k * stride[2]
        if u >= 0 and u < count[0]:
            return along(samples, v, count[1], stride[1], base + u * stride[0])
        m = wp.min(-u, 3)
        first = int(0)
        step = int(1)
        if u >= count[0]:
            m = wp.min(u - count[0] + 1, 3)
            first = count[0] - 1
            step = -1
        a, b, c = m + 1, m + 2, m + 3
        total = real(float(a * b * c) / 6.0) * along(samples, v, count[1], stride[1], base + first * stride[0])
        near, far = first + step, first + 2 * step
        total -= real(float(m * b * c) / 2.0) * along(samples, v, count[1], stride[1], base + near * stride[0])
        total += real(float(m * a * c) / 2.0) * along(samples, v, count[1], stride[1], base + far * stride[0])
        last = first + 3 * step
        return total - real(float(m * a * b) / 6.0) * along(samples, v, count[1], stride[1], base + last * stride[0])

    @wp.kernel(module="unique", enable_backward=False)
    def shear(
        samples_in: wp.array(dtype=real),
        count: wp.vec3i,
        stride: wp.vec3i,
        shift_in: wp.array2d(dtype=int),
        weight_u_in: wp.array2d(dtype=real),
        weight_v_in: wp.array2d(dtype=real),
        low: wp.vec2i,
        width: int,
        first_line: int,
        sum_out: wp.array(dtype=real),
    ):
        """Sum along one line of the lattice, of taps_u by taps_v nodes in each plane."""
        line = wp.tid() + first_line
        u = low[0] + line // width
        v = low[1] + line % width
        total = real(0.0)
        for k in range(count[2]):
            at_u = u + shift_in[k, 0]
            at_v = v + shift_in[k, 1]
            part = real(0.0)
            if at_u >= 0 and at_u + taps_u <= count[0] and at_v >= 0 and at_v + taps_v <= count[1]:
                base = at_u * stride[0] + at_v * stride[1] + k * stride[2]
                for a in range(taps_u):
                    row = real(0.0)
                    for b in range(taps_v):
                        row += weight_v_in[k, b] * samples_in[base + a * stride[0] + b * stride[1]]
                    part += weight_u_in[k, a] * row
            else:
                for a in range(taps_u):
                    row = real(0.0)
                    for b in range(taps_v):
                        row += weight_v_in[k, b] * sample(samples_in, at_u + a, at_v + b, k, count, stride)
                    part += weight_u_in[k, a] * row
            total += part
        sum_out[line] = total

    @wp.kernel(module="unique", enable_backward=False)
    def rows(
        values_in: wp.array(dtype=real),
        start_in: wp.array(dtype=int),
        column_in: wp.array(dtype=int),
        entry_in: wp.array(dtype=real),
        strides: wp.vec4i,
        value_out: wp.array(dtype=real),
    ):
        """A sparse matrix times many columns: strides of its rows and of the columns, in what comes in and goes out."""
        i, j = wp.tid()
        total = real(0.0)
        for p in range(start_in[i], start_in[i + 1]):
            total += entry_in[p] * values_in[column_in[p] * strides[0] + j * strides[1]]
        value_out[i * strides[2] + j * strides[3]] = total

    return shear, rows
