"""The Warp engine: uploads a field once, and launches kernels over all cores of a CPU or on a GPU."""

import weakref
from collections.abc import Callable, Iterable, Sequence
from operator import is_
from typing import Any

import numpy as np
import warp as wp

from ....device_arrays import DeviceArray, in_reach, is_one_row
from ....device_arrays.launching import launch, load_module
from ....device_arrays.pinned import LEAST, Fetching, as_kind, bring, pinned_memory, to_host
from ....process.clock import stage
from ....process.machine import core_count, host_memory
from ....process.opened import OPENED
from ....process.quiet_warp import open_device
from ....process.threads import in_threads, thread_count
from ...scheme import GROUP
from ..field_data import FieldData
from ..interface import GRID_TABLES, Prepared
from ..interface import Engine as AnyEngine
from ..layout import STRUCTS, Value, number_type, parts_of
from ..transfers import Fetched, FetchedFromGPU, Sent
from .kernels import grid_tables, pupil
from .kernels.deliver_bundle import build_bundle_kernel
from .kernels.leapfrog import build_leapfrog_kernel
from .kernels.trace import build_kernel
from .library import TYPES, Scene


def _kernels_of(*files: Any) -> dict[str, Any]:
    return {name: each for file in files for name, each in vars(file).items() if isinstance(each, wp.Kernel)}


# The kernels without options, by name.
KERNELS = _kernels_of(pupil, grid_tables)
# Kernels in which a warp of a GPU shares one group of rays.
SHARED = (pupil.sum_rays,)
# Threads per block of kernels of grids: of these a GPU has few threads at a time, which all multiprocessors share.
GRID_BLOCK = 32  # speed only
BLOCKS = dict.fromkeys(_kernels_of(grid_tables).values(), GRID_BLOCK)
# Kernels that take less time for each ray, or for each number, than tracing.
SHORT = (pupil.launch_pupil, pupil.reduce_sums)
# Rays in one launch of a host thread; small enough to balance threads, large enough to hide the cost of the launch.
CHUNK = 4096
# The share of the device's memory that one result may occupy; the number of rays from which they are copied to a GPU
# chunk by chunk.
KEPT_SHARE, MANY = 0.25, 1 << 19
# Bytes of an array from which on several threads copy it to pinned memory, and the GPU from there.
STAGED = 32 << 20  # speed only
# A part of a piece of a GPU's memory begins at a multiple of this number of bytes.
PART = 256
# The share of a GPU's memory that its pool may hold, used and unused memory together: other programs cannot use it.
POOL_SHARE = 0.1
SCALARS: dict[Any, type] = {
    np.dtype(np.float64): wp.float64,
    np.dtype(np.float32): wp.float32,
    np.dtype(np.int32): wp.int32,
    np.dtype(np.uint32): wp.uint32,
}
# Names of the members of each struct that are vectors.
VECTOR_MEMBERS = {
    name: {each.name for each in members if parts_of(each.kind)[1] > 1 and not parts_of(each.kind)[2]}
    for name, members in STRUCTS.items()
}
VECTORS = {2: wp.vec2d, 3: wp.vec3d}


class Engine(AnyEngine):
    """Warp on one device; see interface.py."""

    def __init__(self, device: str):
        """Open a device."""
        self.device = device
        found = open_device(device)
        # Read once: on a CPU from some twenty files of the system.
        memory = OPENED.once(("memory", device), lambda: float(found.total_memory if found.is_cuda else host_memory()))
        self.memory = memory, memory
        self.is_gpu = bool(found.is_cuda)
        self.grid_key = "coefficients", "warp", device
        self.grid_tables: tuple[str, ...] = GRID_TABLES if found.is_cuda else ()
        self.outputs: list[tuple[list, Any]] = []
        if found.is_cuda:
            OPENED.once(("memory kept", device), lambda: _keep_memory(found))

    def compiled(self, options: dict[str, Any], leapfrog: bool, arguments: list, outputs: frozenset) -> Prepared:
        """See interface.py."""
        scene = Scene(**options)
        kernel = build_leapfrog_kernel(scene) if leapfrog else build_kernel(scene)
        self._load(kernel)
        rejected = wp.zeros(1, dtype=wp.int32, device=self.device) if leapfrog else None
        return Prepared(self, kernel, arguments, outputs, rejected)

    def place_structs(self, data: FieldData, precision: str, arrays: dict[str, Any], bounds: dict[str, Any]) -> Any:
        """Return the structs Field and Bounds."""
        return [_filled("Field", data.field | arrays, precision), _filled("Bounds", bounds, precision)]

    def arguments(self, structs: Any, control: dict[str, Any], precision: str) -> list:
        """Return the structs Field, Bounds and Control, with their arrays."""
        return [*structs, _filled("Control", control, precision)]

    def tuned(self, arguments: list, numbers: dict[str, Any]) -> list:
        """Return the same structs with the last one, Control, changed in place."""
        for name, value in numbers.items():
            setattr(arguments[-1], name, value)
        return arguments

    def bundle_kernel(self, precision: str, channels: int) -> Any:
        """See interface.py."""
        kernel = build_bundle_kernel(Scene(precision, channels=channels))
        self._load(kernel)
        return kernel

    def kernels(self, names: Iterable[str]) -> dict[str, Any]:
        """Return the named kernels; all kernels of a file are compiled together."""
        found = {name: KERNELS[name] for name in names}
        with stage("compile"):
            for kernel in {kernel.module: kernel for kernel in found.values()}.values():
                self._load(kernel)
        return found

    def keeps(self, size: float) -> bool:
        """Whether results of `size` bytes take at most KEPT_SHARE of the device's memory."""
        return size <= KEPT_SHARE * self.memory[0]

    def bring(self, starts: Sequence[Any]) -> tuple[list[wp.array], Iterable[slice]]:
        """Return buffers for the rays; many rays are copied from the host to a GPU chunk by chunk."""
        count = len(starts[0])
        if self.device == "cpu" or count < MANY or any(in_reach(each, self.device) for each in starts):
            found = [each.buffer if in_reach(each, self.device) else self.put(np.asarray(each)) for each in starts]
            return found, [slice(0, count)]
        hosts = [np.asarray(each) for each in starts]
        buffers = [self.put(each) if is_one_row(each) else self.empty(count, 3) for each in hosts]
        many = [number for number, each in enumerate(hosts) if not is_one_row(each)]
        if not many:
            return buffers, [slice(0, count)]
        chunks = bring([np.ascontiguousarray(hosts[number]) for number in many], [buffers[number] for number in many])
        return buffers, chunks

    def fetching(self, results: dict[str, wp.array], starts: Sequence[Any]) -> Fetching | None:
        """Return an object that copies results to the host as they are finished, for many rays from the host."""
        if self.device == "cpu" or len(starts[0]) < MANY or any(isinstance(each, DeviceArray) for each in starts):
            return None
        return Fetching.of(results)

    def put(self, array: np.ndarray) -> wp.array:
        """Return a buffer with a copy of the array; rows of float64 become vectors. Equal rows are stored once."""
        kind = SCALARS[array.dtype]
        if array.ndim == 2 and kind is wp.float64:
            kind = VECTORS[array.shape[1]]
        if not is_one_row(array):
            return self._copied(np.ascontiguousarray(array), kind)
        one = wp.array(array[:1], dtype=kind, device=self.device)
        made = wp.array(
            ptr=one.ptr, dtype=kind, shape=(len(array),), strides=(0,), capacity=one.capacity, device=self.device
        )
        made._ref = one  # keeps the memory alive
        return made

    def share(self, array: np.ndarray) -> wp.array:
        """Return a buffer in the memory of an array, on a GPU a buffer with a copy of it."""
        if self.device != "cpu":
            return self.put(array)
        kind, shape = SCALARS[array.dtype], array.shape
        if array.ndim == 2 and kind is wp.float64:
            kind, shape = VECTORS[array.shape[1]], array.shape[:1]
        made = wp.array(ptr=array.ctypes.data, dtype=kind, shape=shape, capacity=array.nbytes, device="cpu")
        made._ref = array  # keeps the memory alive
        return made

    def put_into(self, buffer: wp.array, array: np.ndarray) -> None:
        """Copy an array over the first rows of a buffer."""
        source = self.put(array)
        wp.copy(buffer, source, count=source.size)  # elements, not rows

    def empty(self, count: int, width: int = 1, kind: type = np.float64) -> wp.array:
        """Return an uninitialised buffer of `count` rows of `width` numbers."""
        dtype = VECTORS[width] if width > 1 else SCALARS[np.dtype(kind)]
        return wp.empty(count, dtype=dtype, device=self.device)

    def get(self, buffer: wp.array, array: np.ndarray) -> None:
        """Wait for the launched kernels, and copy the first rows of a buffer into the array."""
        array[...] = to_host(buffer[: len(array)] if len(array) < len(buffer) else buffer)

    def sent(self, array: np.ndarray) -> Sent:
        """See interface.py."""
        if not self.is_gpu:
            return super().sent(array)
        return SentToGPU(array, wp.empty(array.shape, dtype=SCALARS[array.dtype], device=self.device))

    def fetched(self, arrays: Sequence[np.ndarray]) -> Fetched:
        """See interface.py."""
        return FetchedOnStream(self, arrays) if self.is_gpu else super().fetched(arrays)

    def recorded(self) -> Callable[[Callable[[], None]], None]:
        """Return a callable that records the work as a CUDA graph; on the CPU one that simply does the work."""
        return Recorded(self.device) if self.is_gpu else super().recorded()

    def launch(self, kernel, before: list, after: list, count: int, first: int = 0) -> None:
        """Run a kernel over all rays: one launch on a GPU, without waiting; chunks over host threads on the CPU."""
        before = [wp.vec3d(*value) if isinstance(value, np.ndarray) else value for value in before]
        after = [self._outputs(value) if isinstance(value, dict) else value for value in after]
        if self.device != "cpu":
            dim = pupil.WARP * count if kernel in SHARED else count
            launch(kernel, dim, [*before, first, *after], self.device, BLOCKS.get(kernel))
            return

        def run(begin: int) -> None:
            some = min(chunk, first + count - begin)
            launch(kernel, some, [*before, begin, *after], self.device)

        chunk = max(1, min(CHUNK, -(-count // core_count())))
        if kernel in SHARED or kernel in SHORT:
            # Threads would take longer to start than few rays take.
            chunk = max(chunk, CHUNK // GROUP if kernel in SHARED else CHUNK)
        in_threads(run, range(first, first + count, chunk))

    def clear(self, buffer: wp.array) -> None:
        """Set the numbers of a buffer to 0 without waiting."""
        buffer.zero_()

    def wait(self) -> None:
        """Wait for the launched kernels; on the CPU a launch has ended when it returns."""
        if self.device != "cpu":
            wp.synchronize_stream(self.device)

    def _outputs(self, results: dict[str, wp.array]):
        """Return the struct of the buffers; one of the last two if they are the same, as making one takes 20 us."""
        buffers = list(results.values())
        for known, struct in self.outputs:
            if all(map(is_, known, buffers)):
                return struct
        self.outputs = [(buffers, _filled("RayOutputs", results)), *self.outputs[:1]]
        return self.outputs[0][1]

    def _load(self, kernel) -> None:
        # The block size of a default launch on the CPU is 1; for another one, Warp would compile again at the launch.
        load_module(kernel.module, self.device, 1 if self.device == "cpu" else BLOCKS.get(kernel))

    def struct_array(self, member: Value, values: np.ndarray, precision: str) -> wp.array:
        """Upload an array of a struct to the device."""
        numbers: np.ndarray = np.ascontiguousarray(values, number_type(member.kind, precision))
        return self._copied(numbers, TYPES[precision].kinds[member.kind.rstrip("*")])

    def _copied(self, array: np.ndarray, kind: type) -> wp.array:
        """Return a buffer with a copy of an array, C-contiguous; a large one goes to a GPU through pinned memory."""
        if not self.is_gpu or array.nbytes < STAGED or array.ndim > 1 + hasattr(kind, "_length_"):
            return wp.array(array, dtype=kind, device=self.device)
        made = wp.empty(len(array), dtype=kind, device=self.device)
        for _ in bring([array], [made]):
            pass
        return made


class SentToGPU(Sent):
    """An array in pinned memory and its buffer on a GPU."""

    def __init__(self, array: np.ndarray, buffer: wp.array):
        """Take an array and the buffer to which it is copied."""
        self._there = _beside(buffer, self)
        super().__init__(np.asarray(self._there).reshape(array.shape), buffer)

    def send(self) -> None:
        """Start the upload; a stream is in order, so later launches see it."""
        wp.copy(self.buffer, self._there)


class FetchedOnStream(FetchedFromGPU):
    """Copies arrays from a GPU on the stream of the launches."""

    def __init__(self, engine: Engine, arrays: Sequence[np.ndarray]):
        """Allocate memory for arrays like these."""
        super().__init__(engine, arrays, PART)
        self._whole = wp.empty(self.size // 8, dtype=wp.float64, device=engine.device)
        self._there = _beside(self._whole, self)
        parts: list[wp.array] = []
        for array, start in zip(arrays, self.starts, strict=True):
            kind, count = _kind_of(array)
            place = self._whole.ptr + start
            part = wp.array(ptr=place, dtype=kind, shape=(count,), capacity=array.nbytes, device=engine.device)
            part._ref = self._whole  # keeps the memory alive
            parts.append(part)
        self.place(np.asarray(self._there).view(np.uint8), parts)

    def start(self) -> None:
        """Start the copy, on the stream of the launches."""
        wp.copy(self._there, self._whole)


class Recorded:
    """Repeated work on a GPU: run directly the first time, when it may load modules; replayed as a graph afterwards.

    Threads share a device's stream: what another thread launched while a graph is recorded would become part of the
    graph, and not run. So the graph is recorded only if there is no other thread; until then the work runs directly.
    """

    def __init__(self, device: str):
        """Start without a graph."""
        self.device = device
        self._graph: Any = None
        self._was_done = False

    def __call__(self, work: Callable[[], None]) -> None:
        """Start the work."""
        if not self._was_done or (self._graph is None and thread_count() > 1):
            work()
            self._was_done = True
            return
        if self._graph is None:
            with wp.ScopedCapture(self.device, force_module_load=False) as capture:
                work()
            self._graph = capture.graph
        wp.capture_launch(self._graph)


def _beside(buffer: wp.array, owner: Any) -> wp.array:
    """Return a host array for the numbers of a buffer, as long as its owner lives; pinned if the buffer is on a GPU."""
    kind, size = buffer.dtype, buffer.size
    if not buffer.device.is_cuda:
        return wp.empty(size, dtype=kind, device="cpu")
    # Reuse pinned memory: to pin new memory would take longer than to trace a pupil.
    taken = pinned_memory().take(max(size * wp.types.type_size_in_bytes(kind), LEAST))
    if taken is None:
        return wp.empty(size, dtype=kind, device="cpu", pinned=True)
    weakref.finalize(owner, pinned_memory().give_back, taken).atexit = False
    return as_kind(taken, kind, size)


def _kind_of(array: np.ndarray) -> tuple[type, int]:
    """Return Warp's type of an array's entries, and their number: rows of float64 become vectors."""
    kind = SCALARS[array.dtype]
    return (VECTORS[array.shape[1]], len(array)) if array.ndim == 2 and kind is wp.float64 else (kind, array.size)


def _keep_memory(device: wp.Device) -> None:
    """Let a GPU's pool keep unused memory: to allocate a result from the driver takes longer than to trace its rays.

    This process takes it back when it needs it; other processes cannot.
    """
    limit = int(POOL_SHARE * device.total_memory)
    if device.is_mempool_supported and wp.get_mempool_release_threshold(device) < limit:
        wp.set_mempool_release_threshold(device, limit)


def _filled(name: str, members: dict, precision: str = "float64"):
    """Return one of the kernels' structs, filled; Warp accepts only vectors of exactly the member's type."""
    t = TYPES[precision]
    struct = getattr(t, name)()
    for member in STRUCTS[name]:
        value = members[member.name]
        setattr(struct, member.name, t.kinds[member.kind](*value) if member.name in VECTOR_MEMBERS[name] else value)
    return struct
