"""Trace a bundle on the engine of its plan: in a coherent order, and in chunks that fit the device's memory.

Rays whose own error estimate is above the tolerance are traced again: in the requested precision under error control,
then in float64 with the tolerance times a power of RETRACE_SHARE. "fixed" and "paper" take the caller's steps. A ray
whose steps are exhausted in float32 has an infinite error: rounding may have kept them short.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from aerokernels.inputs.checks import warn_caller

from ..derived import cached_on
from ..device_arrays import DeviceArray, rows_beside, rows_where
from ..medium import IndexField
from ..process.clock import stage, staged
from ..rays import RayBundle
from .engines import OUTPUT_TYPES, Engine, Prepared, engine_of
from .engines.info import lacks_memory, memory_of
from .error_limit import error_limit
from .grid_tables import prepare_once
from .plan import TracePlan
from .stop import RayStatus, reached

# Kernel arguments: an array on the host, or one on its device.
Numbers = np.ndarray | DeviceArray

# Bytes of a ray's start and of all its outputs.
RAY_BYTES = 6 * 8 + sum(width * np.dtype(kind).itemsize for width, kind in OUTPUT_TYPES.values())
# Most and fewest rays in one chunk.
CHUNK, LEAST_CHUNK = 1 << 21, 64  # speed only


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
    whole, piece = engine.memory
    # A chunk takes at most a quarter of the device's memory.
    chunk = max(LEAST_CHUNK, int(min(ray_count, CHUNK, 0.25 * whole / RAY_BYTES, piece / (3 * 8))))
    given = tuple(np.asarray(each) for each in starts)
    arrays: dict[str, np.ndarray] = {}
    done = [0]
    while done[0] < ray_count:
        try:
            _trace_chunks(prepared, given, outputs, chunk, arrays, done)
        except Exception as fault:
            if chunk <= LEAST_CHUNK or not lacks_memory(fault):
                raise
            # Chunks that do not fit the free memory are made smaller by this factor (speed only).
            chunk = max(LEAST_CHUNK, chunk // 4)
    return arrays


def _trace_chunks(
    prepared: Prepared,
    starts: tuple[np.ndarray, ...],
    outputs: frozenset,
    size: int,
    arrays: dict[str, np.ndarray],
    done: list[int],
) -> None:
    """Trace the rays from number `done` on, so many at a time; write their results, and their number, as they come."""
    engine, ray_count = prepared.engine, len(starts[0])
    results = prepared.allocate(min(size, ray_count))

    def fetch(name: str, rows: slice) -> None:
        if name not in arrays:
            width, kind = OUTPUT_TYPES[name]
            arrays[name] = engine.room((ray_count, width) if width > 1 else (ray_count,), kind)
            if name == "step_error":
                arrays[name].fill(0.0)  # for the chunks whose rays are all within the tolerance
        engine.get(results[name], arrays[name][rows])

    while done[0] < ray_count:
        rows = slice(done[0], min(done[0] + size, ray_count))
        with stage("upload"):
            given = [engine.put(array[rows]) for array in starts]
        with stage("kernel"):
            prepared.launch(given, results, rows.stop - rows.start)
            engine.wait()
        with stage("download"):
            for name in OUTPUT_TYPES:
                if name in outputs or name == "status":
                    fetch(name, rows)
            if "step_error" in prepared.outputs - outputs and _is_any_rejected(prepared, arrays["status"][rows]):
                fetch("step_error", rows)
        done[0] = rows.stop


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


# Bundles of fewer rays keep their order.
LEAST_RAYS = 4096  # speed only
# Rays of a packet, packets that are sampled, and the cells over which a packet may spread in the bundle's own order.
PACKET, PACKETS, SPREAD = 16, 64, 1.0  # speed only
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
    # Rays run along an axis if their directions have at least this component along it (speed only).
    return axis if steep[axis] >= 0.2 else None


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


# A further attempt requests this share of the last attempt's tolerance, since error control may end a little above the
# requested tolerance. Rays that were further above it get a power of the share, at least LEAST_SHARE: ten times the
# steps.
RETRACE_SHARE = 0.5
LEAST_SHARE = 1e-4


def run_plan(field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, outputs: frozenset) -> dict:
    """Trace rays as a plan says, again where above the tolerance; "step_error" is there if some stay above it."""
    arrays = launch(field, rays, plan, until, wavelength, outputs)
    if not plan.controls_error or plan.backend == "reference" or "step_error" not in arrays:
        return arrays
    retrace_rejected(field, rays, plan, until, wavelength, arrays)
    if "step_error" not in outputs and not len(rows_where(arrays["status"], RayStatus.TOLERANCE_NOT_MET)):
        del arrays["step_error"]
    return arrays


class ToleranceWarning(RuntimeWarning):
    """Some rays were traced again, and their own error estimate is still above the requested tolerance."""


def retrace_rejected(
    field: IndexField, rays: RayBundle, plan: TracePlan, until, wavelength: float, arrays: dict
) -> None:
    """Trace again those rays whose "step_error" is above the tolerance; others are not copied from the device.

    `arrays` are per-ray results by name, "step_error" and "status" among them, which are changed in place.
    """
    limit = error_limit(field, plan.tolerance * wavelength)
    rows = rows_where(arrays["status"], RayStatus.TOLERANCE_NOT_MET, arrays["step_error"], limit)
    if not len(rows):
        return
    # From a device only the results by which rays are judged are read.
    there = rows_beside(arrays["status"], rows)
    part = rays.part(rows if rays.device is None else there)
    status, error = arrays["status"][rows], arrays["step_error"][rows]

    def trace_again(chosen: np.ndarray, attempt: TracePlan) -> None:
        """Trace these rays of the part again; a ray that got worse, or was lost, keeps its previous results."""
        some = part if len(chosen) == len(rows) else part.part(chosen)
        found = launch(field, some, attempt, until, wavelength, frozenset(arrays) - {"status"})
        new_status, new_error = np.asarray(found["status"]), np.asarray(found["step_error"])
        flew_past = status[chosen] == RayStatus.STOP_NOT_REACHED
        is_worth_keeping = flew_past | (reached(status[chosen]) & np.isfinite(error[chosen]))
        ended = reached(new_status) | (new_status == RayStatus.STOP_NOT_REACHED)
        taken = np.flatnonzero(~is_worth_keeping | (ended & (new_error < error[chosen])))
        replaced = chosen[taken]
        status[replaced], error[replaced] = new_status[taken], new_error[taken]
        for name in arrays.keys() - {"status", "step_error"}:
            if len(taken) == len(rows):
                arrays[name][there] = found[name]
            else:
                arrays[name][rows[replaced]] = found[name][taken]

    _trace_rejected(trace_again, plan, status, error, limit)
    holds = error <= plan.tolerance * wavelength
    status[(status == RayStatus.OK) & ~holds] = RayStatus.TOLERANCE_NOT_MET
    status[(status == RayStatus.TOLERANCE_NOT_MET) & holds] = RayStatus.OK
    arrays["status"][there], arrays["step_error"][there] = status, error


def _trace_rejected(
    trace_again: Callable[[np.ndarray, TracePlan], None],
    plan: TracePlan,
    status: np.ndarray,
    error: np.ndarray,
    limit: float,
) -> None:
    """Trace rays again that are above the allowed error `limit` [m], attempt by attempt."""
    # A trace along undisturbed lines remains one; leapfrog is replaced by another method for bent rays.
    asked = "straight" if plan.method == "straight" and not plan.sample_count else "adaptive"
    controlled = replace(plan, method=asked, sample_count=0, sampling=None)
    if plan.looks_up_cubes:  # the spline may be accurate where the polynomials of cubes are not
        chosen = np.flatnonzero(_rejected(status, error, limit) & np.isfinite(error))
        if len(chosen):
            trace_again(chosen, replace(plan, cubes=False))
    if plan.sample_count:
        chosen = np.flatnonzero(_rejected(status, error, limit))
        if len(chosen):
            trace_again(chosen, controlled)
    # An estimate in single precision may be rounding alone: it does not show which steps float64 needs.
    is_known = plan.precision == "float64" and asked == plan.method
    share = np.ones(len(status))  # of the tolerance, by which each ray was traced
    fell = np.ones(len(status), dtype=bool)
    for round_number in range(2 if is_known else 3):
        rejected, before = _rejected(status, error, limit) & fell, error.copy()
        by_steps = asked == "adaptive" and (is_known or round_number)
        powers = _powers(error, limit) if by_steps else 1.0
        share = np.where(rejected, np.maximum(share * RETRACE_SHARE**powers, LEAST_SHARE), share)
        for part in np.unique(share[rejected]):
            chosen = np.flatnonzero(rejected & (share == part))
            trace_again(chosen, replace(controlled, precision="float64", tolerance=part * plan.tolerance))
        if asked == "straight":  # shorter steps do not lower what a straight line neglects
            # A ray along a straight line whose error falls by less than this with shorter steps is not traced again.
            fell = error <= 0.7 * before


def _powers(error: np.ndarray, limit: float) -> np.ndarray:
    """The power of RETRACE_SHARE that brings each ray's error estimate below the allowed error; at least 1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.where(np.isfinite(error), error, limit) / limit
    return np.maximum(np.ceil(np.log(np.maximum(excess, 1.0)) / -np.log(RETRACE_SHARE) + 0.4), 1.0)


def _rejected(status: np.ndarray, error: np.ndarray, limit: float) -> np.ndarray:
    """Which rays must be traced again: above the limit [m], or outside what the method can estimate (infinite)."""
    # A ray that passes beside its stop by an error above the limit may meet it.
    return ~(error <= limit) & (reached(status) | (status == RayStatus.STOP_NOT_REACHED) | np.isinf(error))


def report_rejected(plan: TracePlan, count: int, ray_count: int, greatest: float | None, wavelength: float):
    """Warn of rays that are still above the tolerance, and return the plan with a sentence about them.

    `greatest` is their greatest error estimate [m]; None where it was not kept.
    """
    if not count:
        return plan
    size = "" if greatest is None else f", the greatest of them {greatest / wavelength:.2g} waves"
    # From this many waves on, an error estimate means only that there is no bound.
    if greatest is not None and not greatest <= 1e6 * wavelength:
        size = ", some of them without bound"
    sentence = (
        f"{count} of {ray_count} rays have error estimates above the tolerance of {plan.tolerance:g} waves{size}, "
        "though they were traced again in float64: their status is TOLERANCE_NOT_MET"
    )
    warn_caller(f"{sentence}; loosen the tolerance, or read step_error", ToleranceWarning)
    return replace(plan, reasons=(*plan.reasons, sentence))
