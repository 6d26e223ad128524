"""The Warp backend: fields uploaded once, rays in chunks over all cores, arrays back in float64."""

import time
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import warp as wp

from ..medium import IndexField
from ..rays import RayBundle
from .backend_info import thread_count
from .field_data import (
    STRUCTS,
    FieldData,
    field_data,
    number_type,
    reach_tables,
    stop_kind,
    trace_members,
)
from .plan import TracePlan
from .status import is_any_rejected
from .warp_devices import start_warp
from .warp_even import build_even_kernel
from .warp_tracer import build_kernel
from .warp_types import types

# Rays in one launch of a host thread; small enough to balance threads, large enough to hide the launch.
CHUNK = 4096
# Per-ray outputs of the kernel, in the order of its arguments.
ARRAY_TYPES = {
    "position": wp.vec3d,
    "direction": wp.vec3d,
    "optical_path": wp.float64,
    "opd": wp.float64,
    "arc_length": wp.float64,
    "step_error": wp.float64,
    "step_count": wp.int32,
    "evaluation_count": wp.int32,
    "status": wp.int32,
}
NUMPY_TYPES = {"step_count": np.int32, "evaluation_count": np.int32, "status": np.int32}

_uploaded: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()


def _fill(struct, name: str, members: dict, precision: str) -> None:
    """Set the scalars and vectors of one of STRUCTS; Warp takes vectors of the very type only."""
    t = types(precision)
    vectors = {
        ("i", 2): wp.vec2i,
        ("i", 3): wp.vec3i,
        ("d", 3): wp.vec3d,
        ("r", 2): t.vec2,
        ("r", 3): t.vec3,
    }
    for member, count, kind in STRUCTS[name]:
        value = members[member]
        setattr(struct, member, value if count == 1 else vectors[kind, count](*value))


def upload(field: IndexField, data: FieldData, precision: str, device: str, with_paper_step: bool) -> dict:
    """The field's arrays on the device, by name; kept as long as the field lives."""
    store = _uploaded.setdefault(field, {})
    key = (precision, device, with_paper_step)
    if key not in store:
        t = types(precision)
        vectors = {
            "corners": t.vec2,
            "gradients": t.vec2,
            "wall": wp.vec4d,
            "wall_boxes": wp.vec4d,
            "wall_links": wp.vec3i,
        }
        scalar: dict[type, type] = {np.int32: wp.int32, np.float32: wp.float32, np.float64: wp.float64}
        store[key] = {
            name: wp.array(
                np.ascontiguousarray(values, number_type(name, precision)),
                dtype=vectors.get(name, scalar[number_type(name, precision)]),
                device=device,
            )
            for name, values in data.arrays.items()
        }
    return store[key]


def prepare(
    field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
) -> SimpleNamespace:
    """Kernel and its arguments but for the rays; `directions` are the rays' own."""
    start_warp()
    start = time.perf_counter()
    data = field_data(field, plan.precision, plan.method == "paper")
    stop_bounds, stop_control = trace_members(field, data, plan, until, wavelength)
    tables, blocks = reach_tables(field, plan, wavelength, directions)
    t = types(plan.precision)
    device_field, bounds, control = t.Field(), t.Bounds(), t.Control()
    _fill(device_field, "field", data.field, plan.precision)
    _fill(bounds, "bounds", data.bounds | stop_bounds, plan.precision)
    _fill(control, "control", data.control | stop_control | blocks, plan.precision)
    for name, array in upload(field, data, plan.precision, plan.device, plan.method == "paper").items():
        setattr(device_field, name, array)
    control.reach = wp.array(tables["reach"], dtype=t.real, device=plan.device)
    control.reach_start = wp.array(tables["reach_start"], dtype=wp.int32, device=plan.device)
    stop, has_body = stop_kind(until), field.body is not None
    rough = None
    if plan.controls_error:
        outputs = outputs | {"step_error"}
    if plan.sample_count:
        kernel = build_even_kernel(plan.precision, field.geometry, field.interpolation, stop, has_body, outputs)
        rough = wp.zeros(1, dtype=wp.int32, device=plan.device)
    else:
        on_mesh = not field.is_uniform
        kernel = build_kernel(
            plan.precision, field.geometry, field.interpolation, on_mesh, plan.method, stop, has_body, outputs
        )
    uploaded = time.perf_counter()
    # The block size of a default launch on the CPU is 1; another one would be compiled again at the launch.
    kernel.module.load(plan.device, 1 if plan.device == "cpu" else None)
    return SimpleNamespace(
        kernel=kernel,
        arguments=[device_field, bounds, control],
        rough=rough,
        seconds={"upload": uploaded - start, "compile": time.perf_counter() - uploaded},
    )


def launch_trace(ready: SimpleNamespace, position, direction, results: dict, ray_count: int, device: str) -> None:
    """Run the tracer on rays that are on the device."""
    arrays = [position, direction, *results.values()]
    if ready.rough is not None:
        arrays.append(ready.rough)
    launch(ready.kernel, ready.arguments, arrays, ray_count, device)


def launch(kernel, arguments: list, arrays: list, ray_count: int, device: str) -> None:
    """Run a kernel over all rays: one launch on a GPU, which is not waited for; chunks over host threads on the CPU."""
    if device != "cpu":
        wp.launch(kernel, dim=ray_count, inputs=[*arguments, 0, *arrays], device=device)
        return

    def run(first: int) -> None:
        count = min(chunk, ray_count - first)
        wp.launch(kernel, dim=count, inputs=[*arguments, first, *arrays], device=device)

    threads = thread_count()
    chunk = max(1, min(CHUNK, -(-ray_count // threads)))
    starts = range(0, ray_count, chunk)
    if len(starts) == 1 or threads == 1:
        for first in starts:
            run(first)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, starts))


def seconds_of(start: Callable[[], None], device: str) -> float:
    """Start launches, wait for them, and say how long they took: on a GPU by its own clock."""
    if device == "cpu":
        begin = time.perf_counter()
        start()
        return time.perf_counter() - begin
    stream = wp.get_stream(device)
    before, after = (wp.Event(device, enable_timing=True) for _ in range(2))
    stream.record_event(before)
    start()
    stream.record_event(after)
    return 1e-3 * float(wp.get_event_elapsed_time(before, after))


def allocate(outputs: frozenset, ray_count: int, device: str) -> dict:
    """Device arrays for the outputs asked for; empty ones, which kernels leave alone, for the others."""
    return {
        name: wp.empty(ray_count if name in outputs or name == "status" else 0, dtype=kind, device=device)
        for name, kind in ARRAY_TYPES.items()
    }


def fetch(results: dict, outputs: frozenset) -> dict[str, np.ndarray]:
    """The outputs asked for, and the status, on the host."""
    return {
        name: np.array(array.numpy(), dtype=NUMPY_TYPES.get(name, np.float64))
        for name, array in results.items()
        if name in outputs or name == "status"
    }


def trace(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset):
    """Trace with Warp: per-ray arrays by name, and seconds.

    Where some rays are above the tolerance, "step_error" comes along.
    """
    ready = prepare(field, plan, until, wavelength, outputs, rays.direction)
    start = time.perf_counter()
    position = wp.array(rays.position, dtype=wp.vec3d, device=plan.device)
    direction = wp.array(rays.direction, dtype=wp.vec3d, device=plan.device)
    computed = outputs | {"step_error"} if plan.controls_error else outputs
    results = allocate(computed, rays.ray_count, plan.device)
    placed = time.perf_counter()
    kernel = seconds_of(
        lambda: launch_trace(ready, position, direction, results, rays.ray_count, plan.device), plan.device
    )
    ran = time.perf_counter()
    arrays = fetch(results, outputs)
    if (ready.rough is not None and int(ready.rough.numpy()[0])) or is_any_rejected(arrays["status"]):
        arrays |= fetch(results, computed - outputs)
    seconds = dict(ready.seconds)
    seconds["upload"] += placed - start
    seconds["kernel"] = kernel
    seconds["download"] = time.perf_counter() - ran
    return arrays, seconds
