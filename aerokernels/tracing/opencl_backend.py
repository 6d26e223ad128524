"""The OpenCL backend: fields uploaded once, rays in chunks that fit the device, arrays back in float64."""

import time
import weakref
from types import SimpleNamespace

import numpy as np
import pyopencl as cl

from ..medium import IndexField
from ..rays import RayBundle
from .field_data import (
    FIELD_ARRAYS,
    REAL_TYPES,
    STRUCTS,
    FieldData,
    field_data,
    number_type,
    reach_tables,
    stop_kind,
    trace_members,
)
from .opencl_devices import Session, session
from .opencl_program import WORK_GROUP, build, build_options, lane_count
from .opencl_tables import may_be_packed, packed_table
from .plan import TracePlan
from .status import is_any_rejected

# Per-ray outputs of the kernel, in the order of its arguments: numbers for a ray, and their type.
OUTPUT_TYPES: dict[str, tuple[int, type]] = {
    "position": (3, np.float64),
    "direction": (3, np.float64),
    "optical_path": (1, np.float64),
    "opd": (1, np.float64),
    "arc_length": (1, np.float64),
    "step_error": (1, np.float64),
    "step_count": (1, np.int32),
    "evaluation_count": (1, np.int32),
    "status": (1, np.int32),
}
# Bytes for one ray when all is asked for, and its start.
RAY_BYTES = 6 * 8 + sum(count * np.dtype(kind).itemsize for count, kind in OUTPUT_TYPES.values())
# On a GPU, numbers below 1e-38 are zero: roots and quotients then take fewer instructions.
FLUSH = "-cl-denorms-are-zero"
# Rays in one chunk at most, and the share of the device's free memory that a chunk may take.
CHUNK = 1 << 21
MEMORY_SHARE = 0.25

_uploaded: weakref.WeakKeyDictionary = weakref.WeakKeyDictionary()
_launched: weakref.WeakSet = weakref.WeakSet()


def pack(struct: str, precision: str, members: dict) -> np.ndarray:
    """One of STRUCTS as the kernel's compiler lays it out, to be passed by value."""
    kinds = {"i": np.int32, "d": np.float64, "r": REAL_TYPES[precision]}
    layout = np.dtype([(name, kinds[kind], (count,)) for name, count, kind in STRUCTS[struct]], align=True)
    packed = np.zeros((), dtype=layout)
    for name, _, _ in STRUCTS[struct]:
        packed[name] = members[name]
    return packed


def to_device(opened: Session, values: np.ndarray):
    """A read-only buffer that holds a copy of the values when this returns.

    (COPY_HOST_PTR would do it in one call, but NVIDIA's driver then copies only when a kernel asks for the buffer.)
    """
    values = np.ascontiguousarray(values)
    buffer = cl.Buffer(opened.context, cl.mem_flags.READ_ONLY, values.nbytes)
    cl.enqueue_copy(opened.queue, buffer, values, is_blocking=True)
    return buffer


def _upload(
    field: IndexField, data: FieldData, precision: str, opened: Session, with_paper_step: bool, packed: bool
) -> list:
    """Buffers of FIELD_ARRAYS, the coefficients packed for even samples or not; kept as long as the field lives."""
    store = _uploaded.setdefault(field, {})
    if packed:
        plain = _upload(field, data, precision, opened, with_paper_step, False)
        if (precision, id(opened), "packed") not in store:
            store[precision, id(opened), "packed"] = to_device(opened, packed_table(field, REAL_TYPES[precision]))
        return [store[precision, id(opened), "packed"], *plain[1:]]
    key = (precision, id(opened), with_paper_step)
    if key not in store:
        limit = opened.device.max_mem_alloc_size
        buffers = []
        for name in FIELD_ARRAYS:
            values: np.ndarray = np.asarray(data.arrays[name], number_type(name, precision))
            if values.nbytes > limit:
                raise ValueError(
                    f"the field's {name} take {values.nbytes / 2**20:.0f} MiB in {precision}, device {opened.name!r} "
                    f"gives {limit / 2**20:.0f} MiB in one piece: use a coarser grid, or another device"
                )
            buffers.append(to_device(opened, values))
        store[key] = buffers
    return store[key]


def prepare(
    field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
) -> SimpleNamespace:
    """Kernel and its arguments but for the rays; `directions` are the rays' own.

    Raises:
        OpenCLUnavailable: The device cannot be opened.
        ValueError: A field that does not fit the device.
    """
    start = time.perf_counter()
    opened = session(plan.device)
    data = field_data(field, plan.precision, plan.method == "paper")
    bounds, control = trace_members(field, data, plan, until, wavelength)
    tables, blocks = reach_tables(field, plan, wavelength, directions)
    even = plan.sample_count > 0
    lanes = lane_count(opened, plan.precision) if even else 1
    packed = even and may_be_packed(field, REAL_TYPES[plan.precision], lanes, opened.device.max_mem_alloc_size)
    in_plane = even and field.geometry != "volume" and not np.any(directions[:, :2])
    arguments = [
        pack("field", plan.precision, data.field),
        pack("bounds", plan.precision, {**data.bounds, **bounds}),
        pack("control", plan.precision, {**data.control, **control, **blocks}),
        *_upload(field, data, plan.precision, opened, plan.method == "paper", packed),
        to_device(opened, tables["reach"].astype(REAL_TYPES[plan.precision])),
        to_device(opened, tables["reach_start"]),
    ]
    uploaded = time.perf_counter()
    options = build_options(
        precision=plan.precision,
        geometry=field.geometry,
        interpolation=field.interpolation,
        on_mesh=not field.is_uniform,
        method=plan.compiled_method,
        stop=stop_kind(until),
        has_body=field.body is not None,
        outputs=outputs | {"step_error"} if plan.controls_error else outputs,
        lanes=lanes,
        packed=packed,
        in_plane=in_plane,
    )
    if even and lanes == 1 and plan.precision == "float32":
        options = (*options, FLUSH)
    program = build(opened, "trace_even.cl" if even else "trace.cl", options)
    # A kernel object belongs to one caller: its arguments are set one by one.
    ready = SimpleNamespace(
        session=opened,
        kernel=cl.Kernel(program, "trace_even" if even else "trace_kernel"),
        arguments=arguments,
        lanes=lanes,
        rough=_zero_count(opened) if even else None,
        seconds={},
    )
    finish_compiling(ready, program)
    ready.seconds |= {"upload": uploaded - start, "compile": time.perf_counter() - uploaded}
    return ready


def finish_compiling(ready: SimpleNamespace, program) -> None:
    """Launch the kernel on no rays, once for a program: PoCL compiles the last part of it at the first launch."""
    if program in _launched:
        return
    results = allocate(ready.session, frozenset(), 1)
    empty = to_device(ready.session, np.zeros(3))
    launch_trace(ready, empty, empty, results, 0).wait()
    _launched.add(program)


def chunk_size(opened: Session, ray_count: int) -> int:
    """Rays in one chunk, all of whose arrays are on the device together."""
    free = MEMORY_SHARE * opened.device.global_mem_size / RAY_BYTES
    piece = opened.device.max_mem_alloc_size / (3 * 8)
    return max(WORK_GROUP, min(ray_count, CHUNK, int(free), int(piece)))


def allocate(opened: Session, outputs: frozenset, ray_count: int) -> dict:
    """Buffers for the outputs asked for; for the others small ones, which kernels leave alone."""
    return {
        name: cl.Buffer(
            opened.context,
            cl.mem_flags.READ_WRITE,
            max(1, ray_count if name in outputs or name == "status" else 1) * count * np.dtype(kind).itemsize,
        )
        for name, (count, kind) in OUTPUT_TYPES.items()
    }


def whole_size(item_count: int) -> tuple[int]:
    """Work-items of a launch: whole work-groups, at least one."""
    return (max(1, -(-item_count // WORK_GROUP)) * WORK_GROUP,)


def enqueue(opened: Session, kernel, arguments: list, item_count: int):
    """Start a kernel over items rounded up to whole work-groups; the kernel itself knows where to stop."""
    return kernel(opened.queue, whole_size(item_count), (WORK_GROUP,), *arguments)


def launch_trace(ready: SimpleNamespace, position, direction, results: dict, ray_count: int):
    """Start the tracer on rays that are on the device; returns its event."""
    arguments = [*ready.arguments, np.int32(0), np.int32(ray_count), position, direction, *results.values()]
    if ready.rough is not None:
        arguments.append(ready.rough)
    return enqueue(ready.session, ready.kernel, arguments, -(-ray_count // ready.lanes))


def seconds_of(event) -> float:
    """Wait for a kernel and say how long it took, by the device's own clock."""
    event.wait()
    return 1e-9 * (event.profile.end - event.profile.start)


def _zero_count(opened: Session):
    """A whole number on the device that a kernel may count with."""
    buffer = cl.Buffer(opened.context, cl.mem_flags.READ_WRITE, 4)
    cl.enqueue_copy(opened.queue, buffer, np.zeros(1, np.int32), is_blocking=True)
    return buffer


def rough_count(ready: SimpleNamespace) -> int:
    """How many rays so far are beyond what even samples can do; 0 for other methods."""
    count = np.zeros(1, np.int32)
    if ready.rough is not None:
        cl.enqueue_copy(ready.session.queue, count, ready.rough, is_blocking=True)
    return int(count[0])


def fetch(opened: Session, results: dict, arrays: dict, outputs: frozenset, rows: slice, ray_count: int) -> None:
    """Copy a chunk's outputs into the rows of the arrays, which are made for all rays where they are missing."""
    for name, (count, kind) in OUTPUT_TYPES.items():
        if name in outputs or name == "status":
            shape = (ray_count, count) if count > 1 else (ray_count,)
            if name not in arrays:
                arrays[name] = np.empty(shape, dtype=kind)
            cl.enqueue_copy(opened.queue, arrays[name][rows], results[name], is_blocking=True)


def trace(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset):
    """Trace with OpenCL: per-ray arrays by name, and seconds.

    Where some rays are above the tolerance, "step_error" comes along.
    """
    ready = prepare(field, plan, until, wavelength, outputs, rays.direction)
    opened = ready.session
    arrays: dict[str, np.ndarray] = {}
    seconds = dict(ready.seconds, kernel=0.0, download=0.0)
    rough = 0
    chunk = chunk_size(opened, rays.ray_count)
    results = allocate(opened, outputs | {"step_error"} if plan.controls_error else outputs, chunk)
    for first in range(0, rays.ray_count, chunk):
        rows = slice(first, min(first + chunk, rays.ray_count))
        start = time.perf_counter()
        position = to_device(opened, rays.position[rows])
        direction = to_device(opened, rays.direction[rows])
        placed = time.perf_counter()
        kernel = seconds_of(launch_trace(ready, position, direction, results, rows.stop - rows.start))
        ran = time.perf_counter()
        fetch(opened, results, arrays, outputs, rows, rays.ray_count)
        rough, before = rough_count(ready), rough
        if rough > before or is_any_rejected(arrays["status"][rows]):
            if "step_error" not in arrays:
                arrays["step_error"] = np.zeros(rays.ray_count)
            cl.enqueue_copy(opened.queue, arrays["step_error"][rows], results["step_error"], is_blocking=True)
        for buffer in (position, direction):
            buffer.release()
        seconds["upload"] += placed - start
        seconds["kernel"] += kernel
        seconds["download"] += time.perf_counter() - ran
    for buffer in results.values():
        buffer.release()
    return arrays, seconds
