"""The OpenCL engine: fields uploaded once, kernels built for what they are to do, launches in order."""

import weakref
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import pyopencl as cl

from ....device_arrays import is_one_row
from ....medium import IndexField
from ....process.clock import stage
from ...bundle.frame import kernel_arrays
from ...bundle.frame import kernel_numbers as bundle_numbers
from ...bundle.table import BundleTable
from ...cube_polynomials import cubes_of
from ...plan import TracePlan
from ..field_data import FieldData, array_of, field_data, step_bound_tables, stop_kind, trace_members
from ..interface import GRID_TABLES, Prepared
from ..layout import REAL_TYPES, Value, arrays_of
from .arguments import Kernel, pack
from .devices import session
from .launchers import give_back, take_kernel
from .program import WORK_GROUP, build, build_options, lane_count
from .tables import cell_polynomials, may_be_packed
from .transfers import Fetched, Sent

# On a GPU, numbers below 1e-38 are zero: roots and quotients then take fewer instructions.
FLUSH = "-cl-denorms-are-zero"
# Greatest buffer that comes from a GPU's pool [bytes].
POOLED = 1 << 28
# Packets of rays that a CPU's thread moves in turns: each sample waits for the one before.
PACKETS = 2
# Equal rows that are copied to the device as they are.
REPEATED = 1 << 12
# Where Control and the coefficients stand among the arguments: behind the structs Field and Bounds.
CONTROL, FIRST_ARRAY = 2, 3
# Kernels of a pupil: work-items that each of what it is launched over takes.
PUPIL_KERNELS = {"launch_pupil": 1, "sum_moments": WORK_GROUP, "sum_phasors": WORK_GROUP, "reduce_sums": 1}


class Engine:
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
        """A field made ready for a plan, a stop and outputs; `directions` are those of the rays (n, 3).

        Raises:
            ValueError: A field that does not fit the device.
        """
        if plan.controls_error:
            outputs = outputs | {"step_error"}
        leapfrog = plan.sample_count > 0
        lanes = lane_count(self.session, plan.precision) if leapfrog else 1
        packets = PACKETS if lanes > 1 else 1
        packs = leapfrog and not plan.few_rays and may_be_packed(field, REAL_TYPES[plan.precision], int(self.memory[1]))
        in_plane = leapfrog and field.geometry != "volume" and not np.any(directions[:, :2])
        with stage("upload"):
            arguments = self.arguments(field, plan, until, wavelength, outputs, directions, packs)
            if plan.looks_up_cubes:
                arguments[FIRST_ARRAY] = self._cubes(field)
        options = build_options(
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
            packed=packs,
            cubes=plan.looks_up_cubes,
            in_plane=in_plane,
        )
        if leapfrog and lanes == 1 and plan.precision == "float32":
            options = (*options, FLUSH)
        with stage("compile"):
            program = build(self.session, "leapfrog.cl" if leapfrog else "trace.cl", options)
            kernel = self._kernel(program, "leapfrog" if leapfrog else "trace_kernel", packets * lanes)
            rejected = self.put(np.zeros(1, np.int32)) if leapfrog else None
            shares = lanes > 1 and not plan.looks_up_cubes  # rays by themselves: to order them costs more than it saves
            prepared = Prepared(self, kernel, arguments, outputs, rejected, is_packed=shares)
            self._finish_compiling(prepared, program)
            return prepared

    def arguments(
        self,
        field: IndexField,
        plan: TracePlan,
        until,
        wavelength: float,
        outputs: frozenset,
        directions: np.ndarray,
        packs: bool = False,
    ) -> list:
        """The structs Field, Bounds and Control, and their arrays, as `prepare` has them; see `_upload` for `packs`."""
        data = field_data(field, plan.precision, plan.method == "paper")
        bounds, control = trace_members(field, data, plan, until, wavelength, outputs)
        tables, blocks = step_bound_tables(field, plan, wavelength, directions)
        return [
            _packed_field(data, plan.precision),
            pack("Bounds", plan.precision, data.bounds | bounds),
            pack("Control", plan.precision, data.control | control | blocks),
            *self._upload(field, data, plan.precision, plan.method == "paper", packs),
            *self._tables(field, plan.precision, tables),
        ]

    def tuned(self, arguments: list, numbers: dict[str, Any]) -> list:
        """A new struct, which the kernel is given when it is launched next."""
        control = arguments[CONTROL].copy()
        for name, value in numbers.items():
            control[name] = value
        return [*arguments[:CONTROL], control, *arguments[CONTROL + 1 :]]

    def _tables(self, field: IndexField, precision: str, tables: dict) -> list:
        """Buffers of the arrays of Control; of a field without such tables they are kept."""

        def upload() -> list:
            return [self._buffer(member, tables[member.name], precision) for member in arrays_of("Control")]

        if tables["step_bound_start"].max() >= 0:
            return upload()
        holder = getattr(field.samples, "shared_places", None) or field
        kept: list = holder.derive(("opencl without tables", self.session, precision), upload)
        return kept

    def prepare_bundle(self, table: BundleTable, outputs: frozenset) -> Prepared:
        """Patches between traced rays made ready for outputs of rays of their family."""
        with stage("upload"):
            arrays = table.derive(("opencl", self.session), lambda: [self.put(array) for array in kernel_arrays(table)])
        with stage("compile"):
            options = build_options(precision=table.precision, channels=table.channels)
            kernel = self._kernel(build(self.session, "deliver_bundle.cl", options), "deliver_bundle")
        return Prepared(self, kernel, [*arrays, *bundle_numbers(table, outputs)], outputs, None)

    def pupil_kernels(self, names: Iterable[str]) -> dict[str, Kernel]:
        """Those kernels of a pupil, by name."""
        with stage("compile"):
            return {
                name: self._kernel(build(self.session, f"{name}.cl"), name, items=PUPIL_KERNELS[name]) for name in names
            }

    def grid_kernels(self, names: Iterable[str]) -> dict[str, Kernel]:
        """Those kernels that prepare a grid, by name."""
        with stage("compile"):
            return {name: self._kernel(build(self.session, f"{name}.cl"), name) for name in names}

    def _kernel(self, program, name: str, lanes: int = 1, items: int = 1) -> Kernel:
        """A kernel of a program, which is there for others once it is gone."""
        taken = take_kernel(self.session, program, name)
        kernel = Kernel(taken, lanes, items)
        weakref.finalize(kernel, give_back, self.session, program, name, taken).atexit = False
        return kernel

    def keeps(self, size: float) -> bool:
        """Never: what OpenCL holds no other library reads."""
        return False

    def bring(self, starts: Sequence[Any]) -> tuple[list[Any], Iterable[slice]]:
        """Copies of the rays, which are there at once."""
        return [self.put(np.asarray(each)) for each in starts], [slice(0, len(starts[0]))]

    def fetching(self, results: dict[str, Any], starts: Sequence[Any]) -> None:
        """Nothing: no result stays on the device."""

    def put(self, array: np.ndarray):
        """A buffer that holds a copy of the array when this returns.

        (COPY_HOST_PTR does it in one call, but NVIDIA's driver then copies only when a kernel asks for the buffer.)
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
        """A buffer in the memory of an array, or with a copy of it."""
        if self.is_gpu:
            return self.put(array)
        access = cl.mem_flags.READ_WRITE if array.flags.writeable else cl.mem_flags.READ_ONLY
        return cl.Buffer(self.session.context, access | cl.mem_flags.USE_HOST_PTR, hostbuf=array)

    def _repeated(self, some: np.ndarray, count: int):
        """A buffer of `count` equal rows, of which some are given: copied on the device, twice as many each time."""
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
        """A buffer of `count` rows of `width` numbers."""
        return self._memory(max(1, count) * width * np.dtype(kind).itemsize)

    def _memory(self, size: int):
        """A buffer of so many bytes; a GPU's come from its pool, unless they are so large that it would waste some."""
        size = max(size, 1)
        if self.session.pool is not None and size <= POOLED:
            return self.session.pool.allocate(size)
        return cl.Buffer(self.session.context, cl.mem_flags.READ_WRITE, size)

    def get(self, buffer, array: np.ndarray) -> None:
        """Wait for what was launched, and copy the first rows of a buffer into the array."""
        if array.nbytes:
            cl.enqueue_copy(self.session.queue, array, buffer, is_blocking=True)

    def sent(self, array: np.ndarray) -> "Sent":
        """See interface.py."""
        return Sent(self.session.queue if self.is_gpu else None, array, self.share(array))

    def fetched(self, buffers: Sequence[Any], arrays: Sequence[np.ndarray]) -> "Fetched":
        """See interface.py."""
        return Fetched(self.session, buffers, arrays, self._memory)

    def recorded(self) -> Callable[[Callable[[], None]], None]:
        """What does the work as it is."""
        return lambda work: work()

    def launch(self, kernel: Kernel, before: list, after: list, count: int):
        """Start a kernel over all rays, or groups of rays; returns its event."""
        outputs = [buffer for value in after for buffer in (value.values() if isinstance(value, dict) else [value])]
        kernel.set([*before, 0, count, *outputs])
        return cl.enqueue_nd_range_kernel(self.session.queue, kernel.kernel, kernel.size(count), (WORK_GROUP,))

    def wait(self) -> None:
        """Wait for what this thread launched."""
        self.session.queue.finish()

    def settle(self) -> None:
        """Wait for what other threads may be given, where each thread has a queue of its own."""
        if not self.is_gpu:
            self.wait()

    def _finish_compiling(self, prepared: Prepared, program) -> None:
        """Launch the kernel on no rays, once for a program: PoCL compiles the last part of it at the first launch."""
        if program not in self.session.launched:
            nowhere = self.put(np.zeros(3))
            prepared.launch([nowhere, nowhere], prepared.allocate(0), 0).wait()
            self.session.launched.add(program)

    def _buffer(self, member: Value, values: np.ndarray, precision: str):
        """An array of a struct on the device."""
        numbers: np.ndarray = np.asarray(values, member.number_type(precision))
        limit = int(self.memory[1])
        if numbers.nbytes > limit:
            raise ValueError(
                f"the field's {member.name} take {numbers.nbytes / 2**20:.0f} MiB in {precision}, device "
                f"{self.device!r} gives {limit / 2**20:.0f} MiB in one piece: use a coarser grid, or another device"
            )
        return self.put(numbers)

    def _upload(self, field: IndexField, data: FieldData, precision: str, with_paper_step: bool, packs: bool) -> list:
        """Buffers of the arrays of Field, coefficients packed for leapfrog or not; kept as long as the field lives."""

        def upload() -> list:
            there = self._coefficients(field, precision)
            others = data.derive(("opencl", self.session, precision), lambda: self._others(data, precision))
            return [
                others[member.name]
                if member.name in others
                else self._buffer(member, array_of(field, data, member.name), precision)
                if there is None
                else there
                for member in arrays_of("Field")
            ]

        unpacked: list = field.derive(("opencl", self.session, precision, with_paper_step), upload)
        if not packs:
            return unpacked
        coefficients, kind = field.samples.coefficients, REAL_TYPES[precision]
        table = field.derive(
            ("opencl packed", self.session, precision), lambda: self.put(cell_polynomials(coefficients, kind))
        )
        return [table, *unpacked[1:]]

    def _others(self, data: FieldData, precision: str) -> dict[str, Any]:
        """Buffers of the arrays of Field that come with its data, by name: fields of other values have the same."""
        members = [member for member in arrays_of("Field") if member.name in data.arrays]
        return {member.name: self._buffer(member, data.arrays[member.name], precision) for member in members}

    def _cubes(self, field: IndexField):
        """The table of polynomials of cubes; kept as long as the field lives."""
        return field.derive(("opencl cubes", self.session), lambda: self.put(cubes_of(field)))

    def _coefficients(self, field: IndexField, precision: str) -> Any:
        """A grid's coefficients where this device has worked them out; None elsewhere."""
        found = field.samples.held(self.grid_key)
        if found is None or precision == "float64":
            return found
        count = int(np.prod(field.samples.coefficient_shape))
        made = self.empty(count, kind=REAL_TYPES[precision])
        program = build(self.session, "round_coefficients.cl", build_options(precision=precision))
        self.launch(self._kernel(program, "round_coefficients"), [found], [made], count)
        self.settle()
        return made


def _packed_field(data: FieldData, precision: str) -> np.ndarray:
    """The struct Field of some data."""
    packed: np.ndarray = data.derive(("opencl members", precision), lambda: pack("Field", precision, data.field))
    return packed
