"""The Warp backend: fields uploaded once, rays in chunks over all cores, arrays back in float64."""

import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import warp as wp

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..rays import RayBundle
from .plan import TracePlan
from .quiet import CONES, cones_of, reach
from .stop import ArcLength, Plane
from .warp_devices import start_warp, thread_count
from .warp_tracer import build_kernel
from .warp_types import types

# Steps of so many cells need no leave from the table of safe steps: four samples a step are then less far apart than
# the support of a sample. On a mesh, which has no table, they are the longest.
STEP_LIMIT = 2.0
MESH_STEP_LIMIT = 4.0
# Greatest tolerance [waves] for which the field's structure may be stepped over.
LAXEST = 0.3
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


def upload(field: IndexField, precision: str, device: str, with_paper_step: bool) -> SimpleNamespace:
    """The field's device structs; kept as long as the field lives."""
    store = _uploaded.setdefault(field, {})
    key = (precision, device, with_paper_step)
    if key not in store:
        store[key] = _upload(field, precision, device, with_paper_step)
    return store[key]


def _upload(field: IndexField, precision: str, device: str, with_paper_step: bool) -> SimpleNamespace:
    t = types(precision)
    scalar = np.float32 if precision == "float32" else np.float64

    def array(values, dtype=t.real, kind=scalar):
        return wp.array(np.ascontiguousarray(values, dtype=kind), dtype=dtype, device=device)

    device_field, bounds, control = t.Field(), t.Bounds(), t.Control()
    samples = field.samples
    device_field.ambient = field.ambient_index
    low, high = field.box
    finite = np.nan_to_num(np.stack([low, high]), posinf=0.0, neginf=0.0)
    bounds.low, bounds.high = wp.vec3d(*finite[0]), wp.vec3d(*finite[1])
    bounds.radius = float(samples.high[0]) if field.geometry == "axisymmetric" else 0.0
    bounds.ambient = field.ambient_index
    empty = np.zeros(1)
    if field.is_uniform:
        device_field.coefficients = array(samples.coefficients.ravel())
        spacing, origin = _per_position_axis(field.geometry, samples.spacing, samples.origin)
        shape = samples.coefficients.shape
        pitch = [1, 1, 1]
        for axis in range(len(shape) - 2, -1, -1):
            pitch[axis] = pitch[axis + 1] * shape[axis + 1]
        pitch = pitch[: len(shape)] + [1] * (3 - len(shape))
        if np.prod(shape) >= 2**31:
            raise ValueError(f"{np.prod(shape)} coefficients do not fit the kernel's 32-bit index: use a coarser grid")
        device_field.pitch = wp.vec3i(*pitch)
        device_field.row = wp.vec3i(*([n - 2 for n in samples.shape] + [0] * (3 - len(samples.shape))))
        cell_rate = 1.0 / spacing
        device_field.slack = 0.0
        device_field.corners, device_field.gradients = array(np.zeros((1, 2)), t.vec2), array(np.zeros((1, 2)), t.vec2)
        device_field.values = array(empty)
        device_field.bin_start = array(empty, wp.int32, np.int32)
        device_field.bin_cell = array(empty, wp.int32, np.int32)
        step_table = samples.paper_step.ravel() if with_paper_step else empty
    else:
        mesh = samples.mesh
        spacing, origin = np.ones(3), np.zeros(3)
        device_field.coefficients = array(empty)
        device_field.corners = array(mesh.corners.reshape(-1, 2), t.vec2)
        device_field.values = array(samples.values[mesh.cells].ravel())
        gradients = samples.gradients if field.interpolation != "bilinear" else np.zeros_like(mesh.vertices)
        device_field.gradients = array(gradients[mesh.cells].reshape(-1, 2), t.vec2)
        bins = mesh.bins
        device_field.bin_start = array(bins.start, wp.int32, np.int32)
        device_field.bin_cell = array(bins.cell, wp.int32, np.int32)
        device_field.bin_count = wp.vec2i(*bins.count)
        device_field.bin_origin = t.vec2(*bins.origin)
        device_field.bin_rate = t.vec2(*(1.0 / bins.size))
        device_field.mesh_low, device_field.mesh_high = (t.vec2(*corner) for corner in mesh.box)
        extent = float(np.abs(np.stack(mesh.box)).max())
        device_field.slack = extent * (4e-7 if precision == "float32" else 1e-13)
        cell_rate = np.full(3, 1.0 / float(np.median(mesh.cell_size)))
        step_table = np.append(samples.paper_step, np.median(samples.paper_step)) if with_paper_step else empty
    device_field.paper_step = array(step_table)
    device_field.inverse_spacing = t.vec3(*(1.0 / spacing))
    bounds.origin, bounds.spacing = wp.vec3d(*origin), wp.vec3d(*spacing)
    control.face_low = t.vec3(*((finite[0] - origin) / spacing))
    control.face_high = t.vec3(*_whole((finite[1] - origin) / spacing))
    control.radius = bounds.radius / spacing[0]
    control.cell_rate = t.vec3(*cell_rate)
    control.extent = 4.0 * float(np.linalg.norm(finite[1] - finite[0]))
    control.step_limit = STEP_LIMIT if field.is_uniform else MESH_STEP_LIMIT
    wall = field.wall_distance
    wall_samples = np.ones((2, 2)) if wall is None else wall.samples
    device_field.wall = wp.array(np.ascontiguousarray(wall_samples, dtype=scalar), dtype=t.real, device=device)
    device_field.wall_origin = t.vec2(*([0.0, 0.0] if wall is None else wall.origin))
    device_field.wall_rate = t.vec2(*([1.0, 1.0] if wall is None else 1.0 / wall.spacing))
    return SimpleNamespace(field=device_field, bounds=bounds, control=control, spacing=spacing, origin=origin)


def _upload_reach(control, field: IndexField, plan: TracePlan, wavelength: float, directions: np.ndarray) -> None:
    """The tables of safe steps of the cones that the directions lie in; none without error control or on a mesh."""
    budget = min(plan.tolerance, LAXEST) * wavelength
    start = np.full(len(CONES), -1, dtype=np.int32)
    lengths = [np.zeros(1)]
    if isinstance(field.samples, UniformGrid) and plan.method in ("adaptive", "straight"):
        for cone in np.unique(cones_of(directions, field.geometry)):
            table = reach(field.samples, field.geometry, budget, CONES[cone])
            start[cone] = sum(part.size for part in lengths)
            lengths.append(table.length.ravel())
            shape = table.length.shape
            control.block_count = wp.vec3i(*shape, *[1] * (3 - len(shape)))
            control.block = table.block
    control.reach = wp.array(np.concatenate(lengths), dtype=types(plan.precision).real, device=plan.device)
    control.reach_start = wp.array(start, dtype=wp.int32, device=plan.device)


def _whole(cells: np.ndarray) -> np.ndarray:
    """Cell counts that are whole but for rounding, made whole."""
    near = np.round(cells)
    return np.where(np.abs(cells - near) < 1e-9 * np.maximum(near, 1.0), near, cells)


def _per_position_axis(geometry: str, spacing, origin) -> tuple[np.ndarray, np.ndarray]:
    if geometry == "volume":
        return np.array(spacing), np.array(origin)
    if geometry == "planar":
        return np.array([spacing[0], *spacing]), np.array([0.0, *origin])
    return np.array([spacing[0], spacing[0], spacing[1]]), np.array([0.0, 0.0, origin[1]])


def prepare(
    field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
) -> SimpleNamespace:
    """Kernel and its arguments but for the rays; `directions` are the rays' own."""
    start_warp()
    start = time.perf_counter()
    kept = upload(field, plan.precision, plan.device, plan.method == "paper")
    t = types(plan.precision)
    bounds, control = t.Bounds(), t.Control()
    for name in ("origin", "spacing", "low", "high", "radius", "ambient"):
        setattr(bounds, name, getattr(kept.bounds, name))
    for name in ("face_low", "face_high", "radius", "cell_rate", "extent", "step_limit"):
        setattr(control, name, getattr(kept.control, name))
    control.step = plan.step or 0.0
    control.budget = plan.tolerance * wavelength
    _upload_reach(control, field, plan, wavelength, directions)
    control.max_steps = plan.max_steps
    stop = "none"
    if isinstance(until, Plane):
        stop = "plane"
        bounds.plane_point, bounds.plane_normal = wp.vec3d(*until.point), wp.vec3d(*until.normal)
        control.plane_normal = t.vec3(*(until.normal * kept.spacing))
        control.plane_offset = float(until.normal @ (until.point - kept.origin))
    elif isinstance(until, ArcLength):
        stop = "arc"
        bounds.length = until.length
    kernel = build_kernel(
        plan.precision,
        field.geometry,
        field.interpolation,
        not field.is_uniform,
        plan.method,
        stop,
        field.body is not None,
        outputs,
    )
    uploaded = time.perf_counter()
    # The block size of a default launch on the CPU is 1; another one would be compiled again at the launch.
    kernel.module.load(plan.device, 1 if plan.device == "cpu" else None)
    return SimpleNamespace(
        kernel=kernel,
        arguments=[kept.field, bounds, control],
        seconds={"upload": uploaded - start, "compile": time.perf_counter() - uploaded},
    )


def launch(kernel, arguments: list, arrays: list, ray_count: int, device: str) -> None:
    """Run a kernel over all rays: one launch on a GPU, chunks over host threads on the CPU."""
    if device != "cpu":
        wp.launch(kernel, dim=ray_count, inputs=[*arguments, 0, *arrays], device=device)
        wp.synchronize_device(device)
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


def allocate(outputs: frozenset, ray_count: int, device: str) -> dict:
    """Device arrays for the outputs asked for; empty ones, which kernels leave alone, for the others."""
    return {
        name: wp.empty(ray_count if name in outputs or name == "status" else 0, dtype=kind, device=device)
        for name, kind in ARRAY_TYPES.items()
    }


def trace(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset):
    """Trace with Warp: per-ray arrays by name, and seconds."""
    ready = prepare(field, plan, until, wavelength, outputs, rays.direction)
    start = time.perf_counter()
    position = wp.array(rays.position, dtype=wp.vec3d, device=plan.device)
    direction = wp.array(rays.direction, dtype=wp.vec3d, device=plan.device)
    results = allocate(outputs, rays.ray_count, plan.device)
    placed = time.perf_counter()
    launch(ready.kernel, ready.arguments, [position, direction, *results.values()], rays.ray_count, plan.device)
    ran = time.perf_counter()
    arrays = {
        name: np.array(array.numpy(), dtype=NUMPY_TYPES.get(name, np.float64))
        for name, array in results.items()
        if name in outputs or name == "status"
    }
    seconds = dict(ready.seconds)
    seconds["upload"] += placed - start
    seconds["kernel"] = ran - placed
    seconds["download"] = time.perf_counter() - ran
    return arrays, seconds
