"""The interface of every engine: device memory, kernel launches, and fields prepared for kernels.

Kernels have the same names and arguments in Warp and in OpenCL, so code that uses only this interface
is written once for both: a bundle in chunks (launch.py), a pupil and its sums (pupil/run.py).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from ...medium import IndexField
from ..bundle.table import BundleTable
from ..plan import TracePlan
from .layout import STRUCTS

# Tables that kernels may compute from a grid, besides its spline coefficients.
GRID_TABLES = ("roughness", "potential by blocks", "potential peaks")
# The kernels without options of a scene, by the file of OpenCL C in which they are built together.
PROGRAMS = {
    "pupil": ("launch_pupil", "sum_rays", "reduce_sums"),
    "grid_tables": ("spline_lines", "column_maxima", "block_maxima"),
}
# Per-ray outputs of the tracing kernels, in their order: how many numbers per ray, and their type.
OUTPUT_TYPES = {member.name: (member.parts[1], member.number_type()) for member in STRUCTS["RayOutputs"]}


class Engine(Protocol):
    """One library on one device. Buffers are the engine's own objects; one row of a buffer belongs to one ray.

    Attributes:
        device: Name of the device.
        memory: Total memory of the device, and the largest single allocation [bytes].
        is_gpu: Whether the device is a GPU.
        grid_tables: The GRID_TABLES that the device computes faster than NumPy, see tracing/grid_tables.py.
        grid_key: Key under which a grid caches the float64 spline coefficients computed on the device.
    """

    device: str
    memory: tuple[float, float]
    is_gpu: bool
    grid_tables: tuple[str, ...]
    grid_key: tuple

    def prepare(
        self, field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
    ) -> "Prepared":
        """Prepare a field for a plan, a stop and outputs; `directions` are the rays' directions, shape (n, 3).

        The time counts as the stages "upload" and "compile".

        Raises:
            ValueError: The device does not exist, or is too small for the field.
        """

    def tuned(self, arguments: list, numbers: dict[str, Any]) -> list:
        """Return arguments of a `Prepared` with new values of struct Control, by name; `arguments` may be modified."""

    def prepare_bundle(self, table: BundleTable, outputs: frozenset) -> "Prepared":
        """Prepare the patches between traced rays to interpolate these outputs for rays of the same family."""

    def kernels(self, names: Iterable[str]) -> dict[str, Any]:
        """Return the named kernels, which have no options: those of a pupil and of a grid."""

    def another(self, kernel: Any) -> Any:
        """Return the same kernel for launches with other arguments: neither then sets those of the other again."""

    def renew(self, field: IndexField, precision: str, on_host: np.ndarray | None) -> None:
        """Make again what `prepare` has made from a grid's coefficients, whose memory on the device has changed.

        `on_host` is that memory, on a CPU.
        """

    def keeps(self, size: float) -> bool:
        """Whether results of `size` bytes, and the rays, stay on the device until they are read."""

    def bring(self, starts: Sequence[Any]) -> tuple[list[Any], Iterable[slice]]:
        """Return buffers for the rays, and an iterator over the slices of rows that have arrived, in order.

        Only for an engine that `keeps` the rays. A kernel launched on rows already yielded finds them there. `starts`
        are NumPy arrays or DeviceArrays.
        """

    def fetching(self, results: dict[str, Any], starts: Sequence[Any]) -> Any:
        """Return an object that copies results to the host chunk by chunk (device_arrays/fetching.py).

        Only for an engine that `keeps` the results. None if they stay on the device until they are read.
        """

    def put(self, array: np.ndarray) -> Any:
        """Return a buffer with a copy of the array, whose rows are numbers, positions or directions.

        An array that repeats one row in memory may be stored as one row on the device; kernels read it like any other.
        """

    def share(self, array: np.ndarray) -> Any:
        """Return a buffer in the memory of an array of numbers on a CPU, a buffer with a copy of the array on a GPU.

        The array lives as long as the buffer. On a CPU the array holds what kernels wrote once `wait` has returned.
        """

    def put_into(self, buffer: Any, array: np.ndarray) -> None:
        """Copy an array over the first rows of a buffer."""

    def empty(self, count: int, width: int = 1, kind: type = np.float64) -> Any:
        """Return an uninitialised buffer of `count` rows of `width` numbers."""

    def room(self, shape: tuple[int, ...], kind: type) -> np.ndarray:
        """Return an uninitialised array on the host for `get`: on a GPU of memory that it copies to at full speed."""

    def get(self, buffer: Any, array: np.ndarray) -> None:
        """Wait for the launched kernels, and copy the first rows of a buffer into the array."""

    def sent(self, array: np.ndarray) -> "Sent":
        """Return a buffer for an array of numbers that is uploaded repeatedly, the first time by `Sent.send`."""

    def fetched(self, arrays: Sequence[np.ndarray]) -> "Fetched":
        """Return uninitialised buffers for the numbers of arrays, which are copied to the host together, repeatedly.

        Rows of two or three float64 are vectors for the kernels. On a CPU the buffers may share the arrays' memory.
        """

    def recorded(self) -> Callable[[Callable[[], None]], None]:
        """Return a callable that runs the same work repeatedly: launches, `Sent` and `Fetched` on the same buffers.

        A device that can replay the work as one graph does so from the second call on.
        """

    def launch(self, kernel: Any, before: list, after: list, count: int, first: int = 0) -> Any:
        """Start a kernel over `count` rays, or groups of rays, from number `first` on, without waiting for it.

        The kernel's arguments are `before`, the number of the first ray or group, and `after`; a dictionary of
        buffers stands for the struct of outputs.
        """

    def clear(self, buffer: Any) -> None:
        """Set the first number of a buffer of int32 to 0, without waiting on a GPU."""

    def wait(self) -> None:
        """Wait for the kernels that this thread launched."""

    def settle(self) -> None:
        """Wait for the launched kernels if other threads may use their results and would not wait themselves."""


class Sent(Protocol):
    """An array on the host and the buffer to which it is uploaded; see `Engine.sent`.

    Attributes:
        array: Write it before `send`; leave it unchanged until the kernels launched after `send` have ended.
        buffer: The buffer on the device.
    """

    array: np.ndarray
    buffer: Any

    def send(self, values: np.ndarray | None = None) -> None:
        """Start the upload; kernels launched after this call read the new values.

        With `values`, an array like this one, those are uploaded instead: leave them unchanged too. They need not be
        the ones of a recorded upload, see `Engine.recorded`.
        """


class Fetched(Protocol):
    """Buffers and the host arrays that receive them; see `Engine.fetched`.

    Attributes:
        buffers: One for each array; they are valid as long as this object.
        arrays: Those that `wait` returns, always the same ones.
    """

    buffers: Sequence[Any]
    arrays: Sequence[np.ndarray]

    def start(self) -> None:
        """Start to copy the buffers in the state that the kernels launched so far leave them in."""

    def wait(self) -> Sequence[np.ndarray]:
        """Wait for the copies and return the arrays, which are valid until the next `start`."""

    def taken(self) -> Sequence[np.ndarray]:
        """Wait for the last copies; return arrays that stay valid."""


@dataclass(eq=False)
class Prepared:
    """A field prepared on an engine: uploaded, with the kernel for a plan, a stop and outputs.

    Attributes:
        engine: The engine.
        kernel: The tracing kernel.
        arguments: The kernel's arguments before the rays.
        outputs: The outputs that it computes for each ray, besides the status.
        rejected: Buffer in which the kernel counts the rays it rejects; None for a kernel that accepts every ray.
        is_packed: Whether the kernel moves packets of rays, which share lookups if they are in one column of cells.
        unused: Buffers of one row, by their type, in place of outputs that are not computed.
    """

    engine: Engine
    kernel: Any
    arguments: list
    outputs: frozenset
    rejected: Any
    is_packed: bool = False
    unused: dict[tuple[int, type], Any] = field(default_factory=dict)

    def launch(self, starts: list, results: dict, count: int, first: int = 0) -> Any:
        """Start the kernel on rays whose `starts` are on the device; see `Engine.launch`."""
        counted = [] if self.rejected is None else [self.rejected]
        return self.engine.launch(self.kernel, self.arguments, [*starts, results, *counted], count, first)

    @property
    def computed(self) -> frozenset:
        """The names of the outputs that it computes for each ray, status included."""
        return self.outputs | {"status"}

    def allocate(self, count: int, without: Iterable[str] = ()) -> dict[str, Any]:
        """Return buffers for the outputs of `count` rays; outputs that are not computed share one row for each type.

        So do the outputs in `without`, for which the caller has buffers.
        """
        computed = self.computed.difference(without)
        buffers: dict[str, Any] = {}
        for name, alike in OUTPUT_TYPES.items():
            if name in computed:
                buffers[name] = self.engine.empty(count, *alike)
            else:
                if alike not in self.unused:
                    self.unused[alike] = self.engine.empty(1, *alike)
                buffers[name] = self.unused[alike]
        return buffers

    def again(self) -> "Prepared":
        """The same, to be launched with other numbers in turn: see `Engine.another`."""
        return replace(self, kernel=self.engine.another(self.kernel))

    def tune(self, **numbers: Any) -> None:
        """Set new values of members of struct Control for the launches that follow."""
        self.arguments = self.engine.tuned(self.arguments, numbers)

    def take_rejected(self) -> int:
        """Return how many rays the kernel has rejected since the last call, and reset the counter."""
        if self.rejected is None:
            return 0
        count = np.zeros(1, np.int32)
        self.engine.get(self.rejected, count)
        return self.taken(int(count[0]))

    def taken(self, count: int) -> int:
        """Return the counter's value `count`, which the caller has read, and reset the counter on the device."""
        if count:
            self.engine.put_into(self.rejected, np.zeros(1, np.int32))
        return count
