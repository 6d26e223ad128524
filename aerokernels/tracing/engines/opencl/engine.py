"""The OpenCL engine: uploads a field once, builds kernels specialised for a plan, and launches them in order."""

import weakref
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
import pyopencl as cl

from ....device_arrays import is_one_row
from ....device_arrays.pinned_memory import LEAST, Lent
from ....medium import IndexField
from ....process.clock import stage
from ...bundle.table import BundleTable
from ...plan import TracePlan
from ..field_data import FieldData, stop_kind
from ..interface import GRID_TABLES, PROGRAMS, Prepared
from ..layout import Value, arrays_of
from ..uploads import Uploads
from .arguments import Kernel, pack
from .devices import session
from .launchers import give_back, take_kernel
from .program import WORK_GROUP, build, build_options, lane_count
from .transfers import Fetched, Recorded, Sent, Shared

# On a GPU, numbers below 1e-38 are flushed to zero: roots and quotients then take fewer instructions.
FLUSH = "-cl-denorms-are-zero"
# Greatest buffer that is allocated from a GPU's pool [bytes].
POOLED = 1 << 28
# Packets of rays that a CPU thread interleaves, because each sample waits for the previous one.
PACKETS = 2
# Work-items of a work-group that move packets: so few that a CPU's cores share the rays of a radius or of a lattice.
PACKET_GROUP = 4  # speed only
# Work-items of a work-group that solve one line each: so few that all parts of a GPU share the lines of a grid.
LINE_GROUP = 32  # speed only
# Number of equal rows up to which they are copied from the host; more are doubled on the device.
REPEATED = 1 << 12
# Position of Control among the arguments: after the structs Field and Bounds.
CONTROL = 2
# Kernels in which a work-group shares one group of rays: work-items per group.
SHARED = {"sum_rays": WORK_GROUP}
# Kernels of grids that fill a CPU's vectors with neighbouring lines or places.
IN_LANES = ("spline_lines", "column_maxima")


class Engine(Uploads):
    """OpenCL on one device; see interface.py."""

    def __init__(self, device: str | None):
        """Open the device.

        Raises:
            OpenCLUnavailable: It cannot be opened.
        """
        self.session = session(device)
        self.device = self.session.name
        self.is_gpu = bool(self.session.device.type & cl.device_type.GPU)
        self.grid_tables: tuple[str, ...] = GRID_TABLES if self.is_gpu else GRID_TABLES[:2]
        self.grid_key = "coefficients", "opencl", self.session
        self.memory = float(self.session.device.global_mem_size), float(self.session.device.max_mem_alloc_size)

    def prepare(
        self, field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
    ) -> Prepared:
        """Prepare a field for a plan, a stop and outputs; `directions` are the rays' directions, shape (n, 3).

        Raises:
            ValueError: A field that does not fit the device.
        """
        if plan.controls_error:
            outputs = outputs | {"step_error"}
        leapfrog = plan.sample_count > 0
        lanes = lane_count(self.session, plan.precision) if leapfrog else 1
        packets = PACKETS if lanes > 1 else 1
        with stage("upload"):
            arguments = self.arguments(field, plan, until, wavelength, outputs, directions)
        options = self._options(
            precision=plan.precision,
            geometry=field.geometry,
            interpolation=field.interpolation,
            on_mesh=not field.is_uniform,
            method=plan.compiled_method,
            stop=stop_kind(until),
            has_body=field.body is not None,
            measured="step_error" in outputs,
            lanes=lanes,
            packets=packets,
            cubes=plan.looks_up_cubes,
        )
        if leapfrog and lanes == 1 and plan.precision == "float32":
            options = (*options, FLUSH)
        with stage("compile"):
            program = build(self.session, "leapfrog.cl" if leapfrog else "trace.cl", options)
            name = "leapfrog" if leapfrog else "trace_kernel"
            kernel = self._kernel(program, name, packets * lanes)
            if lanes > 1:
                kernel.group = PACKET_GROUP
            rejected = self._counter() if leapfrog else None
            # Without shared lookups, to order rays costs more than it saves.
            shares = lanes > 1 and not plan.looks_up_cubes
            prepared = Prepared(self, kernel, arguments, outputs, rejected, is_packed=shares)
            self._finish_compiling(prepared, program)
            return prepared

    def arguments(
        self, field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
    ) -> list:
        """Return the structs Field, Bounds and Control, and their arrays, for `prepare`."""
        (packed, arrays), control = self.uploaded(field, plan, until, wavelength, outputs, directions)
        return [
            *packed,
            pack("Control", plan.precision, control),
            *arrays,
            *(control[member.name] for member in arrays_of("Control")),
        ]

    def place_structs(self, data: FieldData, precision: str, arrays: dict[str, Any], bounds: dict[str, Any]) -> Any:
        """Return the packed structs Field and Bounds, and the arrays of Field, which are separate arguments."""
        packed = _packed_field(data, precision), pack("Bounds", precision, bounds)
        return packed, [arrays[member.name] for member in arrays_of("Field")]

    def tuned(self, arguments: list, numbers: dict[str, Any]) -> list:
        """Return the arguments with a new struct Control, which the kernel gets at its next launch."""
        control = arguments[CONTROL].copy()
        for name, value in numbers.items():
            control[name] = value
        return [*arguments[:CONTROL], control, *arguments[CONTROL + 1 :]]

    def prepare_bundle(self, table: BundleTable, outputs: frozenset) -> Prepared:
        """Prepare the patches between traced rays to interpolate these outputs for rays of the same family."""
        arguments = self.bundle_arguments(table, outputs)
        with stage("compile"):
            options = self._options(precision=table.precision, channels=table.channels)
            kernel = self._kernel(build(self.session, "deliver_bundle.cl", options), "deliver_bundle")
        return Prepared(self, kernel, arguments, outputs, None, unused=self.bundle_unused(table))

    def kernels(self, names: Iterable[str]) -> dict[str, Kernel]:
        """Return the named kernels, which have no options but the lanes."""
        with stage("compile"):
            return {name: self._named(name) for name in names}

    def _named(self, name: str) -> Kernel:
        """Return a kernel of PROGRAMS."""
        program = next(program for program, names in PROGRAMS.items() if name in names)
        width = lane_count(self.session, "float64") if program == "grid_tables" else 1
        options = self._options(precision="float64", lanes=width) if width > 1 else ()
        lanes = width if name in IN_LANES else 1
        kernel = self._kernel(build(self.session, f"{program}.cl", options), name, lanes, SHARED.get(name, 1))
        if lanes > 1:
            kernel.group = PACKET_GROUP
        elif name == "spline_lines":
            kernel.group = LINE_GROUP
        return kernel

    def _options(self, **chosen: Any) -> tuple[str, ...]:
        """Return `build_options` of these choices, made once."""
        key = tuple(chosen.items())
        found: tuple[str, ...] | None = self.session.options_of.get(key)
        if found is None:
            found = self.session.options_of[key] = build_options(**chosen)
        return found

    def _kernel(self, program, name: str, lanes: int = 1, items: int = 1) -> Kernel:
        """Return a kernel of a program; its kernel object is reused after the kernel is garbage-collected."""
        taken, given = take_kernel(self.session, program, name)
        kernel = Kernel(taken, lanes, items, given, again=partial(self._kernel, program, name, lanes, items))
        weakref.finalize(kernel, give_back, self.session, program, name, taken, given).atexit = False
        return kernel

    def another(self, kernel: Kernel) -> Kernel:
        """Return another kernel object for the same work."""
        assert kernel.again is not None
        made = kernel.again()
        made.group = kernel.group
        return made

    def keeps(self, size: float) -> bool:
        """Never: no other library can read OpenCL's buffers."""
        return False

    def bring(self, starts: Sequence[Any]) -> tuple[list[Any], Iterable[slice]]:
        """Return copies of the rays, all of which are complete."""
        return [self.put(np.asarray(each)) for each in starts], [slice(0, len(starts[0]))]

    def fetching(self, results: dict[str, Any], starts: Sequence[Any]) -> None:
        """Return None: no result stays on the device."""

    def put(self, array: np.ndarray):
        """Return a buffer with a complete copy of the array.

        (COPY_HOST_PTR does this in one call, but NVIDIA's driver then copies only when a kernel uses the buffer.)
        """
        if is_one_row(array) and len(array) > REPEATED:
            return self._repeated(np.ascontiguousarray(array[:REPEATED]), len(array))
        array = np.ascontiguousarray(array)
        if self.session.pool is None and array.nbytes:
            flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
            return cl.Buffer(self.session.context, flags, hostbuf=array)
        buffer = self._memory(array.nbytes)
        self.put_into(buffer, array)
        return buffer

    def share(self, array: np.ndarray):
        """Return a buffer in the memory of an array, on a GPU a buffer with a copy of it."""
        if self.is_gpu:
            return self.put(array)
        access = cl.mem_flags.READ_WRITE if array.flags.writeable else cl.mem_flags.READ_ONLY
        return cl.Buffer(self.session.context, access | cl.mem_flags.USE_HOST_PTR, hostbuf=array)

    def _repeated(self, some: np.ndarray, count: int):
        """Return a buffer of `count` equal rows, given some of them; the device copies twice as many each time."""
        row, done = some[0].nbytes, some.nbytes
        buffer = self._memory(row * count)
        self.put_into(buffer, some)
        while done < row * count:
            size = min(done, row * count - done)
            cl.enqueue_copy(self.session.queue, buffer, buffer, byte_count=size, src_offset=0, dst_offset=done)
            done += size
        self.settle()
        return buffer

    def put_into(self, buffer, array: np.ndarray) -> None:
        """Copy an array over the first rows of a buffer."""
        if array.nbytes:
            cl.enqueue_copy(self.session.queue, buffer, np.ascontiguousarray(array), is_blocking=True)

    def empty(self, count: int, width: int = 1, kind: type = np.float64):
        """Return an uninitialised buffer of `count` rows of `width` numbers."""
        return self._memory(max(1, count) * width * np.dtype(kind).itemsize)

    def _counter(self):
        """Return a buffer with one number, 0; on a GPU a waiting copy would take as long as tracing some rays."""
        if not self.is_gpu:
            return self.put(np.zeros(1, np.int32))
        made = self.empty(1, kind=np.int32)
        self.clear(made)
        return made

    def clear(self, buffer) -> None:
        """Set the first number of a buffer of int32 to 0 without waiting."""
        cl.enqueue_fill_buffer(self.session.queue, buffer, np.int32(0), 0, 4)

    def _memory(self, size: int):
        """Return a buffer of `size` bytes; on a GPU from the pool, which would waste memory for very large ones."""
        size = max(size, 1)
        if self.session.pool is not None and size <= POOLED:
            return self.session.pool.allocate(size)
        return cl.Buffer(self.session.context, cl.mem_flags.READ_WRITE, size)

    def room(self, shape: tuple[int, ...], kind: type) -> np.ndarray:
        """Return an uninitialised array for `get`; for a GPU a large one is in pinned memory, within limits."""
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        taken = self.session.pinned.take(size) if self.is_gpu and size >= LEAST else None
        if taken is None:
            return super().room(shape, kind)
        return np.asarray(Lent(self.session.pinned, taken, shape, np.dtype(kind)))

    def get(self, buffer, array: np.ndarray) -> None:
        """Wait for the launched kernels, and copy the first rows of a buffer into the array."""
        if array.nbytes:
            cl.enqueue_copy(self.session.queue, array, buffer, is_blocking=True)

    def sent(self, array: np.ndarray) -> "Sent":
        """See interface.py."""
        buffer = self._memory(array.nbytes) if self.is_gpu else self.share(array)
        return Sent(self.session, array, buffer, is_copied=self.is_gpu)

    def fetched(self, arrays: Sequence[np.ndarray]) -> "Fetched | Shared":
        """See interface.py."""
        if self.is_gpu:
            return Fetched(self.session, arrays, self._memory)
        return Shared(self.session, arrays, [self.share(array) for array in arrays])

    def recorded(self) -> Callable[[Callable[[], None]], None]:
        """Return a callable that starts the same launches and copies again, without setting arguments."""
        return Recorded(self.session)

    def launch(self, kernel: Kernel, before: list, after: list, count: int, first: int = 0):
        """Start a kernel over all rays, or groups of rays; return its event."""
        outputs = [buffer for value in after for buffer in (value.values() if isinstance(value, dict) else [value])]
        arguments, size = [*before, first, first + count, *outputs], kernel.size(count)

        def start() -> Any:
            kernel.set(arguments)
            return cl.enqueue_nd_range_kernel(self.session.queue, kernel.kernel, size, (kernel.group,))

        return self.session.do(start)

    def wait(self) -> None:
        """Wait for the kernels that this thread launched."""
        self.session.queue.finish()

    def settle(self) -> None:
        """Wait, on a CPU, where each thread has its own queue, for results that other threads may use."""
        if not self.is_gpu:
            self.wait()

    def _finish_compiling(self, prepared: Prepared, program) -> None:
        """Launch the kernel without rays, once per program: PoCL finishes compiling at the first launch."""
        if program not in self.session.launched:
            nowhere = self.put(np.zeros(3))
            prepared.launch([nowhere, nowhere], prepared.allocate(0), 0).wait()
            self.session.launched.add(program)

    def struct_array(self, member: Value, values: np.ndarray, precision: str):
        """Upload an array of a struct to the device."""
        numbers: np.ndarray = np.asarray(values, member.number_type(precision))
        limit = int(self.memory[1])
        if numbers.nbytes > limit:
            raise ValueError(
                f"the field's {member.name} need {numbers.nbytes / 2**20:.0f} MiB in {precision}, but device "
                f"{self.device!r} allocates at most {limit / 2**20:.0f} MiB at once: use a coarser grid, or another "
                "device"
            )
        return self.put(numbers)

    def round_into(self, coefficients: Any, made: Any, count: int, precision: str) -> None:
        """See uploads.py."""
        program = build(self.session, "round_coefficients.cl", self._options(precision=precision))
        self.launch(self._kernel(program, "round_coefficients"), [coefficients], [made], count)


def _packed_field(data: FieldData, precision: str) -> np.ndarray:
    """Return the struct Field of some data, cached on the data."""
    packed: np.ndarray = data.derive(("opencl members", precision), lambda: pack("Field", precision, data.field))
    return packed
