"""Launch a bundle on the engine of its plan, in chunks that fit the device's memory: upload, trace and download."""

from typing import Any

import numpy as np

from ..derived import cached_on
from ..device_arrays import DeviceArray, rows_where
from ..medium import IndexField
from ..process.clock import stage, staged
from ..rays import RayBundle
from .engines import OUTPUT_TYPES, Engine, Prepared, engine_of
from .engines.device_memory import lacks_memory, memory_of
from .grid_tables import prepare_once
from .plan import TracePlan
from .status import RayStatus

# Kernel arguments: an array on the host, or one on its device.
Numbers = np.ndarray | DeviceArray

# Bytes of a ray's start and of all its outputs.
RAY_BYTES = 6 * 8 + sum(width * np.dtype(kind).itemsize for width, kind in OUTPUT_TYPES.values())
# Most and fewest rays in one chunk.
CHUNK, LEAST_CHUNK = 1 << 21, 64  # speed only
# Chunks that do not fit the free memory are made smaller by this factor.
FEWER = 4  # speed only
# Share of the device's memory that a chunk may take.
MEMORY_SHARE = 0.25


def launch(
    field: IndexField,
    rays: RayBundle,
    plan: TracePlan,
    until,
    wavelength: float,
    outputs: frozenset,
) -> dict[str, Any]:
    """Trace each ray once as its plan says; return per-ray arrays, "step_error" among them if rays are rejected."""
    if plan.backend == "reference":
        from .engines.reference.engine import trace

        with stage("kernel"):
            return trace(field, rays, plan, until, wavelength, outputs)
    engine = engine_of(plan.backend, plan.device)
    # Step bounds are made for the directions of the rays; the leapfrog kernels of Warp need no step bounds.
    needs_none = plan.backend == "warp" and plan.sample_count > 0
    with memory_of(engine.device):
        prepare_once(engine, field.samples)  # of a field without a plan of its own, as the coarser ones of a budget
        directions = rays.held("direction")[:1] if needs_none else rays.direction
        prepared = engine.prepare(field, plan, until, wavelength, outputs, directions)
        order = coherent_order(field, rays.position, rays.direction) if prepared.is_packed else None
        if order is None:
            return in_chunks(prepared, starts_of(rays), outputs)
        ordered = in_chunks(prepared, (rays.position[order], rays.direction[order]), outputs)
    arrays = {name: np.empty_like(array) for name, array in ordered.items()}
    for name, array in ordered.items():
        arrays[name][order] = array
    return arrays


def starts_of(rays: RayBundle) -> tuple[Numbers, Numbers]:
    """Positions and directions of the rays, on the device if they are stored there."""
    return rays.held("position"), rays.held("direction")


def in_chunks(prepared: Prepared, starts: tuple[Numbers, ...], outputs: frozenset) -> dict[str, Any]:
    """Launch a kernel over rays, chunk by chunk; return per-ray arrays, on the device where the engine keeps them.

    The status always is among them, and "step_error" where rays are rejected.
    """
    engine, ray_count = prepared.engine, len(starts[0])
    if engine.keeps(ray_count * RAY_BYTES):
        try:
            return _kept(prepared, starts, outputs)
        except Exception as fault:
            if not lacks_memory(fault):
                raise
    # Other programs may use most of the device's memory: chunks become smaller until they fit.
    chunk = chunk_size(engine.memory, ray_count)
    chunks = _Chunks(prepared, tuple(np.asarray(each) for each in starts), outputs)
    while not chunks.has_all:
        try:
            chunks.trace(chunk)
        except Exception as fault:
            if chunk <= LEAST_CHUNK or not lacks_memory(fault):
                raise
            chunk = max(LEAST_CHUNK, chunk // FEWER)
    return chunks.arrays


class _Chunks:
    """Rays that are traced chunk by chunk; the arguments are those of `in_chunks`."""

    def __init__(self, prepared: Prepared, starts: tuple[np.ndarray, ...], outputs: frozenset):
        self.prepared, self.starts, self.outputs = prepared, starts, outputs
        self.arrays: dict[str, np.ndarray] = {}
        self.done, self.has_all = 0, False

    def trace(self, size: int) -> None:
        """Trace the rays that are left, so many at a time."""
        prepared, engine, ray_count = self.prepared, self.prepared.engine, len(self.starts[0])
        results = prepared.allocate(min(size, ray_count))
        while not self.has_all:
            rows = slice(self.done, min(self.done + size, ray_count))
            with stage("upload"):
                given = [engine.put(array[rows]) for array in self.starts]
            with stage("kernel"):
                prepared.launch(given, results, rows.stop - rows.start)
                engine.wait()
            with stage("download"):
                self._fetch(results, rows)
            self.done, self.has_all = rows.stop, rows.stop >= ray_count

    def _fetch(self, results: dict[str, Any], rows: slice) -> None:
        """Copy the results of a chunk to the host."""
        for name in OUTPUT_TYPES:
            if name in self.outputs or name == "status":
                self._fetch_one(name, results, rows)
        if "step_error" in self.prepared.outputs - self.outputs:
            if _is_any_rejected(self.prepared, self.arrays["status"][rows]):
                if "step_error" not in self.arrays:
                    self._make("step_error").fill(0.0)  # for the chunks whose rays are all within the tolerance
                self._fetch_one("step_error", results, rows)

    def _fetch_one(self, name: str, results: dict[str, Any], rows: slice) -> None:
        array = self.arrays[name] if name in self.arrays else self._make(name)
        self.prepared.engine.get(results[name], array[rows])

    def _make(self, name: str) -> np.ndarray:
        """Add an uninitialised array for all rays."""
        ray_count, (width, kind) = len(self.starts[0]), OUTPUT_TYPES[name]
        made = self.prepared.engine.room((ray_count, width) if width > 1 else (ray_count,), kind)
        self.arrays[name] = made
        return made


class Trials:
    """Trace a few rays repeatedly by leapfrog, with different numbers of samples and scales of the error."""

    def __init__(
        self, field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset
    ):
        """Upload the rays and compile the kernel; the plan has samples."""
        engine = engine_of(plan.backend, plan.device)
        self.names = [name for name in OUTPUT_TYPES if name in outputs or name == "status"]
        self.plan, self.count = plan, rays.ray_count
        self.prepared = engine.prepare(field, plan, until, wavelength, outputs, rays.direction)
        with stage("upload"):
            self.starts = _put(rays, engine)

    def __call__(self, *asked: tuple[int, float, float]) -> list[dict[str, np.ndarray]]:
        """Return the outputs for each (number of samples, quadrature scale, trajectory scale), see TracePlan."""
        names, count = self.names, self.count
        with stage("upload"):
            reading = self.prepared.engine.fetched([_empty(name, count) for _ in asked for name in names])
            buffers = iter(reading.buffers)
            results = [
                self.prepared.allocate(count, without=names) | {name: next(buffers) for name in names} for _ in asked
            ]
        with stage("kernel"):
            for (samples, quadrature, trajectory), outputs in zip(asked, results, strict=True):
                self.prepared.tune(
                    sample_count=samples, quadrature_error_scale=quadrature, trajectory_error_scale=trajectory
                )
                self.prepared.launch(self.starts, outputs, count)
            reading.start()
            arrays = iter(reading.taken())
            return [{name: next(arrays) for name in names} for _ in asked]


@cached_on("rays")
def _put(rays: RayBundle, engine: Engine) -> list:
    return [engine.put(np.asarray(array)) for array in (rays.position, rays.direction)]


def _empty(name: str, ray_count: int) -> np.ndarray:
    """Return an empty array for an output of `ray_count` rays."""
    width, kind = OUTPUT_TYPES[name]
    return np.empty((ray_count, width) if width > 1 else ray_count, dtype=kind)


def _kept(prepared: Prepared, starts: tuple[Numbers, ...], outputs: frozenset) -> dict[str, Any]:
    """Launch rays on an engine that keeps all results, without waiting for copies that are under way to the host."""
    engine, ray_count = prepared.engine, len(starts[0])
    wanted = [name for name in OUTPUT_TYPES if name in outputs or name == "status"]
    with stage("upload"):
        results = prepared.allocate(ray_count)
        given, chunks = engine.bring(starts)
        fetching = engine.fetching({name: results[name] for name in wanted}, starts)
    with stage("kernel"):
        for rows in staged("upload", chunks):
            prepared.launch(given, results, rows.stop - rows.start, rows.start)
            if fetching is not None:
                fetching.rows(rows)
        engine.wait()
    coming = {} if fetching is None else fetching.coming()
    arrays = {name: DeviceArray(results[name], coming.get(name)) for name in wanted}
    if "step_error" in prepared.outputs - outputs:
        if _is_any_rejected(prepared, arrays["status"]):
            arrays["step_error"] = DeviceArray(results["step_error"])
    return arrays


def _is_any_rejected(prepared: Prepared, status: Numbers) -> bool:
    """Whether a kernel rejected rays, by its counter since the last call, or else by the status that it gave them."""
    if prepared.rejected is not None:
        return prepared.take_rejected() > 0
    return len(rows_where(status, RayStatus.TOLERANCE_NOT_MET)) > 0


def chunk_size(memory: tuple[float, float], ray_count: int) -> int:
    """Number of rays in a chunk, so that all its arrays fit the device; `memory` is an Engine's."""
    whole, piece = memory
    return max(LEAST_CHUNK, int(min(ray_count, CHUNK, MEMORY_SHARE * whole / RAY_BYTES, piece / (3 * 8))))


# Bundles of fewer rays keep their order.
LEAST_RAYS = 4096  # speed only
# Rays of a packet, packets that are sampled, and the cells over which a packet may spread in the bundle's own order.
PACKET, PACKETS, SPREAD = 16, 64, 1.0  # speed only
# Rays run along an axis if their directions have at least this component along it.
LEAST_COMPONENT = 0.2  # speed only
# Bits of a cell's number that distinguish cells within a wide cell, and bits of the wide cell's number.
FINE_BITS, WIDE_BITS = 3, 12  # speed only


def coherent_order(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
    """Row numbers of rays (n, 3) in a coherent order, shape (n,); None if they already are or ordering does not pay."""
    count = len(position)
    if count < LEAST_RAYS or not field.is_uniform:
        return None
    first = np.linspace(0, count - PACKET, PACKETS).astype(np.int64)
    some = (first[:, None] + np.arange(PACKET)).ravel()
    axis = _main_axis(field, direction[some])
    if axis is None:
        return None
    spread = np.ptp(_cells(field, position[some], direction[some], axis).reshape(PACKETS, PACKET, -1), axis=1)
    if np.median(spread.max(axis=1)) <= SPREAD:
        return None
    cells = _cells(field, position, direction, axis)
    key = np.zeros(count, np.int64)
    for column in cells.T:
        key = key << WIDE_BITS | column >> FINE_BITS
    for column in cells.T:
        key = key << FINE_BITS | column & (1 << FINE_BITS) - 1
    return np.argsort(key, kind="stable")


def _main_axis(field: IndexField, direction: np.ndarray) -> int | None:
    """The axis that all rays run along, among those along which the box ends; None where there is none."""
    low, high = field.box
    steep = np.abs(direction).min(axis=0) * (np.isfinite(low) & np.isfinite(high))
    if field.geometry == "axisymmetric":
        steep[:2] = 0.0
    axis = int(np.argmax(steep))
    return axis if steep[axis] >= LEAST_COMPONENT else None


def _cells(field: IndexField, position: np.ndarray, direction: np.ndarray, axis: int) -> np.ndarray:
    """Cells in which lines cross both faces across an axis, along the field's other axes, shape (n, 2 or 4)."""
    dimension = len(field.spacing)
    low, last = np.asarray(field.samples.low), np.array(field.samples.shape) - 2
    own = axis - (3 - dimension)
    found = []
    for face in (low[own], np.asarray(field.samples.high)[own]):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            place = position + ((face - position[:, axis]) / direction[:, axis])[:, None] * direction
            local = field.local_coordinates(place)
        for other in range(dimension):
            if other != own:
                cell = np.nan_to_num((local[:, other] - low[other]) / field.spacing[other])
                found.append(np.clip(cell, 0, min(last[other], (1 << WIDE_BITS) - 1)).astype(np.int64))
    return np.stack(found, axis=1)
