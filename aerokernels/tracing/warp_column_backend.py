"""Collimated rays along z by Warp: tables uploaded, one lookup a ray."""

import time
import weakref

import numpy as np
import warp as wp

from ..medium import IndexField
from .collimated import Columns, kernel_numbers, packed
from .plan import TracePlan
from .warp_backend import allocate, fetch, launch, seconds_of
from .warp_columns import build_column_kernel
from .warp_devices import start_warp
from .warp_types import types

_uploaded: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


def trace_columns(field: IndexField, position: np.ndarray, columns: Columns, plan: TracePlan, outputs: frozenset):
    """Arrays by name and seconds, for rays from `position` (n, 3)."""
    start_warp()
    start = time.perf_counter()
    store = _uploaded.setdefault(columns.tables, {})
    key = (plan.precision, plan.device)
    if key not in store:
        store[key] = wp.array(packed(columns.tables), dtype=types(plan.precision).real, device=plan.device)
    uploaded = time.perf_counter()
    kernel = build_column_kernel(plan.precision, outputs)
    kernel.module.load(plan.device, 1 if plan.device == "cpu" else None)
    compiled = time.perf_counter()
    place = wp.array(np.ascontiguousarray(position), dtype=wp.vec3d, device=plan.device)
    results = allocate(outputs, len(position), plan.device)
    placed = time.perf_counter()
    arguments = [store[key], *kernel_numbers(field, columns).values()]
    results_in_order = [place, *results.values()]
    spent = seconds_of(lambda: launch(kernel, arguments, results_in_order, len(position), plan.device), plan.device)
    ran = time.perf_counter()
    arrays = fetch(results, outputs)
    return arrays, {
        "upload": uploaded - start + placed - compiled,
        "compile": compiled - uploaded,
        "kernel": spent,
        "download": time.perf_counter() - ran,
    }
