"""Collimated rays along z by OpenCL: tables uploaded, one lookup a ray."""

import time
import weakref

import numpy as np
import pyopencl as cl

from ..medium import IndexField
from .collimated import Columns, kernel_numbers, packed
from .field_data import REAL_TYPES
from .opencl_backend import allocate, chunk_size, enqueue, fetch, seconds_of, to_device
from .opencl_devices import session
from .opencl_program import build, build_options
from .plan import TracePlan

_uploaded: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


def trace_columns(field: IndexField, position: np.ndarray, columns: Columns, plan: TracePlan, outputs: frozenset):
    """Arrays by name and seconds, for rays from `position` (n, 3)."""
    start = time.perf_counter()
    opened = session(plan.device)
    store = _uploaded.setdefault(columns.tables, {})
    key = (plan.precision, id(opened))
    if key not in store:
        store[key] = to_device(opened, packed(columns.tables).astype(REAL_TYPES[plan.precision]))
    uploaded = time.perf_counter()
    options = build_options(precision=plan.precision, method="straight", outputs=outputs)
    program = build(opened, "trace_columns.cl", options)
    kernel = cl.Kernel(program, "trace_columns")
    compiled = time.perf_counter()
    numbers = [
        (np.int32 if isinstance(number, int) else np.float64)(number)
        for number in kernel_numbers(field, columns).values()
    ]
    seconds = {"upload": uploaded - start, "compile": compiled - uploaded, "kernel": 0.0, "download": 0.0}
    arrays: dict[str, np.ndarray] = {}
    ray_count = len(position)
    chunk = chunk_size(opened, ray_count)
    results = allocate(opened, outputs, chunk)
    for first in range(0, ray_count, chunk):
        rows = slice(first, min(first + chunk, ray_count))
        count = rows.stop - rows.start
        begin = time.perf_counter()
        place = to_device(opened, position[rows])
        placed = time.perf_counter()
        arguments = [store[key], *numbers, np.int32(0), np.int32(count), place, *results.values()]
        spent = seconds_of(enqueue(opened, kernel, arguments, count))
        ran = time.perf_counter()
        fetch(opened, results, arrays, outputs, rows, ray_count)
        place.release()
        seconds["upload"] += placed - begin
        seconds["kernel"] += spent
        seconds["download"] += time.perf_counter() - ran
    for buffer in results.values():
        buffer.release()
    return arrays, seconds
