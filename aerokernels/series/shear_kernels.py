"""Warp kernels of sheared_device.py, for the CPU and for GPUs, in the precision of the samples."""

from typing import Any

from aerokernels.process.machine import core_count
from aerokernels.process.threads import in_threads


def shear_kernels(precision: str, taps_u: int, taps_v: int, lanes: int, parts: int) -> tuple[Any, Any, Any, Any]:
    """Return the kernels `shear`, `gather`, `rows` and `take` for samples of "float32" or "float64".

    A line reads taps_u by taps_v nodes in each plane. A thread sums `lanes` neighbouring lines, which share most of
    their
    nodes. With several `parts` a thread sums every `parts`-th plane only: neighbouring threads then read neighbouring
    planes.
    """
    import warp as wp

    real: Any = {"float32": wp.float32, "float64": wp.float64}[precision]

    @wp.func
    def along(samples: wp.array(dtype=real), place: int, count: int, stride: int, base: int):
        """Return a sample along an axis, extrapolated cubically beyond its ends."""
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
        """Return a sample of a plane, extrapolated cubically beyond its edges, by at most three cells."""
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

    lines_of: Any = wp.types.vector(length=lanes, dtype=real)
    nodes_of: Any = wp.types.vector(length=lanes + taps_v - 1, dtype=real)

    @wp.kernel(module="unique", enable_backward=False)
    def shear(
        samples_in: wp.array(dtype=real),
        offset: real,
        count: wp.vec3i,
        stride: wp.vec3i,
        shift_in: wp.array2d(dtype=int),
        weight_u_in: wp.array2d(dtype=real),
        weight_v_in: wp.array2d(dtype=real),
        plane_weight_in: wp.array(dtype=real),
        low: wp.vec2i,
        width: int,
        first_group: int,
        sum_out: wp.array(dtype=real),
    ):
        """Sum a group of neighbouring lines of the lattice, taps_u by taps_v nodes, over a part of the planes."""
        thread = wp.tid() + first_group
        group = thread // parts
        part = thread % parts
        groups = (width + lanes - 1) // lanes
        u = low[0] + group // groups
        first = (group % groups) * lanes
        v = low[1] + first
        total = lines_of()
        for k in range(part, count[2], parts):
            at_u = u + shift_in[k, 0]
            at_v = v + shift_in[k, 1]
            nodes = nodes_of()
            if at_u >= 0 and at_u + taps_u <= count[0] and at_v >= 0 and at_v + taps_v + lanes - 1 <= count[1]:
                base = at_u * stride[0] + at_v * stride[1] + k * stride[2]
                for a in range(taps_u):
                    w = weight_u_in[k, a]
                    for b in range(lanes + taps_v - 1):
                        nodes[b] += w * samples_in[base + a * stride[0] + b * stride[1]]
            else:
                for a in range(taps_u):
                    w = weight_u_in[k, a]
                    for b in range(lanes + taps_v - 1):
                        nodes[b] += w * sample(samples_in, at_u + a, at_v + b, k, count, stride)
            # Subtract the offset plane by plane: the sum and its rounding error stay small.
            for j in range(lanes):
                value = -offset
                for b in range(taps_v):
                    value += weight_v_in[k, b] * nodes[j + b]
                total[j] += plane_weight_in[k] * value
        for j in range(lanes):
            if first + j < width:
                sum_out[((u - low[0]) * width + first + j) * parts + part] = total[j]

    @wp.kernel(module="unique", enable_backward=False)
    def gather(sum_in: wp.array(dtype=real), total_out: wp.array(dtype=real)):
        """Sum the parts of a line, in their order."""
        line = wp.tid()
        total = real(0.0)
        for part in range(parts):
            total += sum_in[line * parts + part]
        total_out[line] = total

    @wp.kernel(module="unique", enable_backward=False)
    def rows(
        values_in: wp.array(dtype=real),
        start_in: wp.array(dtype=int),
        column_in: wp.array(dtype=int),
        entry_in: wp.array(dtype=real),
        strides: wp.vec4i,
        value_out: wp.array(dtype=real),
    ):
        """Multiply a sparse matrix by many columns; strides of matrix rows and columns in the input and the output."""
        i, j = wp.tid()
        total = real(0.0)
        for p in range(start_in[i], start_in[i + 1]):
            total += entry_in[p] * values_in[column_in[p] * strides[0] + j * strides[1]]
        value_out[i * strides[2] + j * strides[3]] = total

    @wp.kernel(module="unique", enable_backward=False)
    def take(value_in: wp.array(dtype=real), index_in: wp.array(dtype=int), value_out: wp.array(dtype=real)):
        """Pick values by index; zero where an index is negative."""
        i = wp.tid()
        value = real(0.0)
        if index_in[i] >= 0:
            value = value_in[index_in[i]]
        value_out[i] = value

    return shear, gather, rows, take


def launch(kernel: Any, count: int, before: list, after: list, device: str) -> None:
    """Run a kernel for `count` items; its arguments: `before`, the number of the launch's first item, `after`.

    On the processor in chunks over host threads, since a launch uses one thread.
    """
    from ..device_arrays.launching import launch as warp_launch

    if device != "cpu":
        warp_launch(kernel, count, [*before, 0, *after], device)
        return
    chunk = max(1, -(-count // (4 * core_count())))

    def run(first: int) -> None:
        warp_launch(kernel, min(chunk, count - first), [*before, first, *after], "cpu")

    in_threads(run, range(0, count, chunk))
