r"""Measure the greatest rates of a device in float32, and the share of them that a tracer uses.

Two ceilings, each by an OpenCL kernel that does nothing else: fused multiply-adds in independent chains, counted as two
operations each, and vector loads from a few KiB that stay in the first cache.

Operations of an evaluation of the field (kernels/generated/grid.h; where steps differ, the ray equation around it is
not counted, so the share is a lower bound):

    cubic volume          64 loads of 4 B. 16 rows of 4 coefficients: value and slope along y, 2 x 64 multiply-adds;
                          then along x, 3 x 16; along z, 4 x 4: 192 multiply-adds = 384 operations, and 3 axes x 24 for
                          the weights and their slopes: 456
    cubic, two axes       16 loads; 2 x 16 and 3 x 4 multiply-adds = 88 operations, 2 x 24 for the weights: 136
    linear volume         8 loads; 2 x 8 + 3 x 4 + 4 x 2 multiply-adds = 72 operations, 3 x 1 for the weights: 75
    linear, two axes      4 loads; 2 x 4 + 3 x 2 multiply-adds = 28 operations, 2 x 1 for the weights: 30
    monotone              as cubic
    leapfrog samples      the same and the ray equation, which is the same for every sample (kernels/leapfrog.cl):
                          place 20, force 16, momentum and w 15, sums 15, course 21, fourth-order ends 18, and the third
                          of 36 that comes with every third sample: 117
    on a mesh             not counted: the share is null
"""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.process.foreign_files import fault_text

# (axes, interpolation) -> float32 operations and loads of one evaluation
COSTS = {(3, "cubic"): (456, 64), (2, "cubic"): (136, 16), (3, "linear"): (75, 8), (2, "linear"): (30, 4)}
LEAPFROG_OPERATIONS = 117
GROUP = 64
CHAINS = 8  # independent sums, to hide the latency of a multiply-add
LOADED = 1024  # float32 values that are loaded repeatedly: 4 KiB
REPEATS = 5
LEAST_SECONDS = 0.05

ARITHMETIC = """
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void arithmetic(__global float *out, const int rounds, const float factor, const float term)
{
    VECTOR sum[CHAINS];
    for (int c = 0; c < CHAINS; c++) sum[c] = (VECTOR)(get_global_id(0) * 1e-9f + c);
    for (int i = 0; i < rounds; i++) {
        #pragma unroll
        for (int c = 0; c < CHAINS; c++) sum[c] = fma(sum[c], (VECTOR)factor, (VECTOR)term);
    }
    VECTOR total = sum[0];
    for (int c = 1; c < CHAINS; c++) total += sum[c];
    float whole = 0.0f;  // of every lane, or a compiler leaves the others out
    for (int k = 0; k < WIDTH; k++) whole += ((const float *)&total)[k];
    out[get_global_id(0)] = whole;
}
"""
LOADS = """
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void loads(__global float *out, __global const VECTOR *values, const int rounds)
{
    VECTOR sum[CHAINS];
    for (int c = 0; c < CHAINS; c++) sum[c] = (VECTOR)0.0f;
    int at = (int)get_global_id(0);
    for (int i = 0; i < rounds; i++) {
        __global const VECTOR *row = values + (at & (STRIDE - 1));
        #pragma unroll
        for (int c = 0; c < CHAINS; c++) sum[c] += row[c * STRIDE];
        at += 1;
    }
    VECTOR total = sum[0];
    for (int c = 1; c < CHAINS; c++) total += sum[c];
    float whole = 0.0f;  // of every lane, or a compiler leaves the others out
    for (int k = 0; k < WIDTH; k++) whole += ((const float *)&total)[k];
    out[get_global_id(0)] = whole;
}
"""


def evaluation_cost(field: IndexField) -> tuple[int, int] | None:
    """Operations and loads of one evaluation of a field, None where they are not counted."""
    if not field.is_uniform:
        return None
    kind = "linear" if field.interpolation == "linear" else "cubic"
    return COSTS[3 if field.geometry == "volume" else 2, kind]


def absent(reason: str) -> dict:
    """A ceiling that was not measured."""
    return {"flops_per_second": None, "loads_per_second": None, "measured_on": None, "reason": reason}


def measure_ceiling(backend: str, device: str) -> dict:
    """The ceilings of a device: float32 operations and 4-byte loads a second, or None with a reason.

    For Warp's "cpu" and the reference OpenCL's CPU is measured, for Warp's GPUs the first GPU that OpenCL finds.
    """
    from aerokernels.tracing.engines.opencl.devices import OpenCLUnavailable, session

    if backend != "opencl":
        device = "cpu" if device == "cpu" else "gpu"
    try:
        opened = session(device)
    except (OpenCLUnavailable, ValueError) as error:
        return absent(f"no OpenCL device to measure it on: {error}")
    try:
        return _measure(opened)
    except Exception as error:  # a failing driver must not end the benchmark
        return absent(f"{opened.name}: {fault_text(error)}")


def _measure(opened: Any) -> dict:
    from aerokernels.tracing.engines.opencl.devices import import_pyopencl

    cl = import_pyopencl()
    on_cpu = bool(opened.device.type & cl.device_type.CPU)
    width = 16 if on_cpu else 4
    items = opened.device.max_compute_units * (GROUP * 4 if on_cpu else 2048)
    macros = {
        "GROUP": GROUP,
        "CHAINS": CHAINS,
        "WIDTH": width,
        "VECTOR": f"float{width}",
        "STRIDE": LOADED // width // CHAINS,
    }
    options = [*(f"-D{name}={value}" for name, value in macros.items()), *opened.options]
    program = cl.Program(opened.context, ARITHMETIC + LOADS).build(options)
    out = cl.Buffer(opened.context, cl.mem_flags.WRITE_ONLY, 4 * items)
    ones = np.ones(LOADED, dtype=np.float32)
    values = cl.Buffer(opened.context, cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR, hostbuf=ones)
    queue = opened.queue
    add, load = cl.Kernel(program, "arithmetic"), cl.Kernel(program, "loads")

    def arithmetic(rounds: int) -> Any:
        return add(queue, (items,), (GROUP,), out, np.int32(rounds), np.float32(0.999), np.float32(1e-3))

    def loads(rounds: int) -> Any:
        return load(queue, (items,), (GROUP,), out, values, np.int32(rounds))

    each = items * width * CHAINS
    return {
        "flops_per_second": 2.0 * each * _rounds_per_second(arithmetic),
        "loads_per_second": each * _rounds_per_second(loads),
        "measured_on": opened.name,
        "reason": None,
    }


def _rounds_per_second(launch: Callable[[int], Any]) -> float:
    """The best of some launches, each long enough to be timed."""

    def seconds(rounds: int) -> float:
        begin = time.perf_counter()
        launch(rounds).wait()
        return time.perf_counter() - begin

    seconds(1)
    rounds = 256
    while (spent := seconds(rounds)) < LEAST_SECONDS and rounds < 1 << 24:
        rounds *= max(2, min(16, math.ceil(LEAST_SECONDS / max(spent, 1e-6))))
    return max(rounds / seconds(rounds) for _ in range(REPEATS))


def share(
    field: IndexField | None,
    precision: str,
    evaluations_per_second: float | None,
    ceiling: dict,
    leapfrog: bool = False,
) -> dict:
    """The share of the ceilings that a number of field evaluations a second uses, or None with a reason.

    `field` is None if rays are interpolated and not traced through it; `leapfrog` says that samples are evenly spaced,
    so that the ray equation is counted too.

    A ceiling is for all cores of a device; Warp's CPU device uses one thread a launch, which lowers its share.
    """
    cost = evaluation_cost(field) if field is not None else None
    if cost is not None and leapfrog:
        cost = (cost[0] + LEAPFROG_OPERATIONS, cost[1])
    reason = ceiling["reason"]
    if cost is None:
        reason = "a lookup on a mesh is not counted, nor are rays that are interpolated"
    elif precision != "float32":
        reason = "ceilings are float32's"
    elif evaluations_per_second is None:
        reason = "the kernel's time is not known"
    arithmetic = loads = None
    if reason is None and cost is not None and evaluations_per_second is not None:
        arithmetic = evaluations_per_second * cost[0] / ceiling["flops_per_second"]
        loads = evaluations_per_second * cost[1] / ceiling["loads_per_second"]
    return {
        "flops_per_evaluation": cost[0] if cost else None,
        "loads_per_evaluation": cost[1] if cost else None,
        "arithmetic_share": arithmetic,
        "load_share": loads,
        "reason": reason,
    }
