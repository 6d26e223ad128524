"""The OpenCL engine: uploads a field once, builds kernels specialised for a plan, and launches them in order."""

import ctypes
import weakref
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyopencl as cl

from ....device_arrays import is_one_row
from ....device_arrays.pinned import LEAST, Lent
from ....process.clock import stage
from ..field_data import FieldData
from ..interface import GRID_TABLES, PROGRAMS, Prepared
from ..interface import Engine as AnyEngine
from ..layout import ARRAYS, REAL_TYPES, VALUES, Value, number_type, parts_of
from ..transfers import Fetched, FetchedFromGPU, Sent
from .devices import session
from .program import build, build_options, lane_count
from .session import WORK_GROUP, Kernel, Session

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
# The memory layouts of the structs that are passed by value.
LAYOUTS = {
    (struct, precision): np.dtype(
        [(value.name, number_type(value.kind, precision), (parts_of(value.kind)[1],)) for value in VALUES[struct]],
        align=True,
    )
    for struct in ("Field", "Bounds", "Control")
    for precision in REAL_TYPES
}


class Engine(AnyEngine):
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

    def compiled(self, options: dict[str, Any], leapfrog: bool, arguments: list, outputs: frozenset) -> Prepared:
        """See interface.py."""
        precision, name = options["precision"], "leapfrog" if leapfrog else "trace_kernel"
        lanes = lane_count(self.session, precision) if leapfrog else 1
        packets = PACKETS if lanes > 1 else 1
        flags = build_options(**options, lanes=lanes, packets=packets)
        if leapfrog and lanes == 1 and precision == "float32":
            flags = (*flags, FLUSH)
        program = build(self.session, "leapfrog.cl" if leapfrog else "trace.cl", flags)
        group = PACKET_GROUP if lanes > 1 else WORK_GROUP
        kernel = Kernel(self.session, program, name, packets * lanes, group=group)
        rejected = self._counter() if leapfrog else None
        # Without shared lookups, to order rays costs more than it saves.
        shares = lanes > 1 and not options["cubes"]
        prepared = Prepared(self, kernel, arguments, outputs, rejected, is_packed=shares)
        if program not in self.session.launched:  # PoCL finishes compiling at the first launch
            nowhere = self.put(np.zeros(3))
            prepared.launch([nowhere, nowhere], prepared.allocate(0), 0).wait()
            self.session.launched.add(program)
        return prepared

    def place_structs(self, data: FieldData, precision: str, arrays: dict[str, Any], bounds: dict[str, Any]) -> Any:
        """Return the packed structs Field and Bounds, and the arrays of Field, which are separate arguments."""
        packed = pack("Field", precision, data.field), pack("Bounds", precision, bounds)
        return packed, [arrays[member.name] for member in ARRAYS["Field"]]

    def arguments(self, structs: Any, control: dict[str, Any], precision: str) -> list:
        """Return the structs Field, Bounds and Control, and their arrays."""
        packed, arrays = structs
        of_control = [control[member.name] for member in ARRAYS["Control"]]
        return [*packed, pack("Control", precision, control), *arrays, *of_control]

    def tuned(self, arguments: list, numbers: dict[str, Any]) -> list:
        """Return the arguments with a new struct Control, which the kernel gets at its next launch."""
        control = arguments[CONTROL].copy()
        for name, value in numbers.items():
            control[name] = value
        return [*arguments[:CONTROL], control, *arguments[CONTROL + 1 :]]

    def bundle_kernel(self, precision: str, channels: int) -> Kernel:
        """See interface.py."""
        options = build_options(precision=precision, channels=channels)
        return Kernel(self.session, build(self.session, "deliver_bundle.cl", options), "deliver_bundle")

    def kernels(self, names: Iterable[str]) -> dict[str, Kernel]:
        """Return the named kernels, which have no options but the lanes."""
        with stage("compile"):
            return {name: self._named(name) for name in names}

    def _named(self, name: str) -> Kernel:
        """Return a kernel of PROGRAMS."""
        program = build(self.session, f"{next(file for file, names in PROGRAMS.items() if name in names)}.cl")
        items = WORK_GROUP if name == "sum_rays" else 1  # a work-group sums one group of rays
        return Kernel(self.session, program, name, 1, items, LINE_GROUP if name == "spline_lines" else WORK_GROUP)

    def put(self, array: np.ndarray):
        """Return a buffer with a complete copy of the array.

        (COPY_HOST_PTR does this in one call, but NVIDIA's driver then copies only when a kernel uses the buffer.)
        """
        if len(array) > REPEATED and is_one_row(array):
            return self._repeated(np.ascontiguousarray(array[:REPEATED]), len(array))
        array = np.ascontiguousarray(array)
        if self.session.pool is None and array.nbytes:
            flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
            return cl.Buffer(self.session.context, flags, hostbuf=array)
        buffer = self.empty(array.nbytes, kind=np.uint8)
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
        buffer = self.empty(row * count, kind=np.uint8)
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
        """Return an uninitialised buffer of `count` rows of `width` numbers.

        On a GPU it is from the pool, which would waste memory for very large ones.
        """
        size = max(1, count) * width * np.dtype(kind).itemsize
        if self.session.pool is not None and size <= POOLED:
            return self.session.pool.allocate(size)
        return cl.Buffer(self.session.context, cl.mem_flags.READ_WRITE, size)

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

    def room(self, shape: tuple[int, ...], kind: type) -> np.ndarray:
        """Return an uninitialised array for `get`; for a GPU a large one is in pinned memory, within limits."""
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        taken = self.session.pinned.take(size) if self.is_gpu and size >= LEAST else None
        if taken is None:
            return np.empty(shape, kind)
        return np.asarray(Lent(self.session.pinned, taken, shape, np.dtype(kind)))

    def get(self, buffer, array: np.ndarray) -> None:
        """Wait for the launched kernels, and copy the first rows of a buffer into the array."""
        if array.nbytes:
            cl.enqueue_copy(self.session.queue, array, buffer, is_blocking=True)

    def sent(self, array: np.ndarray) -> Sent:
        """See interface.py."""
        if not self.is_gpu:
            return super().sent(array)
        return SentToGPU(self.session, array, self.empty(array.nbytes, kind=np.uint8))

    def fetched(self, arrays: Sequence[np.ndarray]) -> Fetched:
        """See interface.py."""
        return FetchedByEvent(self, arrays) if self.is_gpu else super().fetched(arrays)

    def launch(self, kernel: Kernel, before: list, after: list, count: int, first: int = 0):
        """Start a kernel over all rays, or groups of rays; return its event."""
        outputs = [buffer for value in after for buffer in (value.values() if isinstance(value, dict) else [value])]
        kernel.set([*before, first, first + count, *outputs])
        return cl.enqueue_nd_range_kernel(self.session.queue, kernel.kernel, kernel.size(count), (kernel.group,))

    def wait(self) -> None:
        """Wait for the kernels that this thread launched."""
        self.session.queue.finish()

    def settle(self) -> None:
        """Wait, on a CPU, where each thread has its own queue, for results that other threads may use."""
        if not self.is_gpu:
            self.wait()

    def struct_array(self, member: Value, values: np.ndarray, precision: str):
        """Upload an array of a struct to the device."""
        numbers: np.ndarray = np.asarray(values, number_type(member.kind, precision))
        limit = int(self.memory[1])
        if numbers.nbytes > limit:
            raise ValueError(
                f"the field's {member.name} need {numbers.nbytes / 2**20:.0f} MiB in {precision}, but device "
                f"{self.device!r} allocates at most {limit / 2**20:.0f} MiB at once: use a coarser grid, or another "
                "device"
            )
        return self.put(numbers)


class SentToGPU(Sent):
    """An array and its buffer on a GPU."""

    def __init__(self, session: Session, array: np.ndarray, buffer: Any):
        """Take an array and its buffer."""
        super().__init__(array, buffer)
        self.session = session
        self.event: Any = None  # of the last upload: PyOpenCL would wait for the copy if the event were deleted

    def send(self) -> None:
        """Start the upload; the queue is in order, so later launches see it."""
        self.event = cl.enqueue_copy(self.session.queue, self.buffer, self.array, is_blocking=False)


class FetchedByEvent(FetchedFromGPU):
    """Copies arrays from a GPU, and waits for no more than the copy."""

    def __init__(self, engine: Engine, arrays: Sequence[np.ndarray]):
        """Allocate memory for arrays like these."""
        self.session = session = engine.session
        super().__init__(engine, arrays, max(session.device.mem_base_addr_align // 8, 1))
        self.bytes, self.whole = _pinned(session, self.size, self), engine.empty(self.size, kind=np.uint8)
        self.event: Any = None
        # A buffer from a pool cannot be divided itself.
        divided = cl.Buffer.from_int_ptr(self.whole.int_ptr, retain=True)
        sizes = [max(array.nbytes, 1) for array in arrays]
        self.place(self.bytes, [divided.get_sub_region(*each) for each in zip(self.starts, sizes, strict=True)])

    def start(self) -> None:
        """Start the copy; the queue is in order."""
        self.event = cl.enqueue_copy(self.session.queue, self.bytes, self.whole, is_blocking=False)

    def wait(self) -> Sequence[np.ndarray]:
        """Wait for the copy, and return the arrays."""
        self.event.wait()
        return self.arrays


def _pinned(session: Session, size: int, owner: Any) -> np.ndarray:
    """Return so many bytes on the host as long as the owner lives, pinned for fast copies if more may be pinned."""
    taken = session.pinned.take(max(size, LEAST))
    if taken is None:
        return np.empty(size, np.uint8)
    weakref.finalize(owner, session.pinned.give_back, taken).atexit = False
    return np.ctypeslib.as_array((ctypes.c_uint8 * size).from_address(taken.ptr))


def pack(struct: str, precision: str, members: dict) -> np.ndarray:
    """Pack the values of one of the kernels' structs in the layout of the kernels' compiler."""
    packed = np.zeros((), dtype=LAYOUTS[struct, precision])
    for name in LAYOUTS[struct, precision].names or ():
        packed[name] = members[name]
    return packed
