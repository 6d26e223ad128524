"""What every engine offers: memory on its device, kernels launched on it, and a field made ready for them.

Kernels have the same names and arguments in Warp and in OpenCL (kernel_table.py has them), so what is
written with these few functions is written once: a bundle in chunks (launch.py), a pupil and its sums (pupil_run.py).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...medium import IndexField
from ..bundle.table import BundleTable
from ..plan import TracePlan
from .layout import STRUCTS

# What kernels may work out of a grid, besides its spline.
GRID_TABLES = ("roughness", "potential by blocks", "potential peaks")
# Per-ray outputs of the tracer's kernels, in their order: numbers for a ray, and their type.
OUTPUT_TYPES = {member.name: (member.parts[1], member.number_type()) for member in STRUCTS["RayOutputs"]}


class Engine(Protocol):
    """One way to compute on one device. Buffers are the engine's own objects; a row is what belongs to one ray.

    Attributes:
        device: Name of the device.
        memory: Bytes that the device has, and that it gives in one piece.
        is_gpu: Whether the device is a GPU.
        grid_tables: What it works out of a grid in less time than NumPy, see tracing/grid_tables.py.
        grid_key: Under which a grid holds the coefficients that it worked out, in float64.
    """

    device: str
    memory: tuple[float, float]
    is_gpu: bool
    grid_tables: tuple[str, ...]
    grid_key: tuple

    def prepare(
        self, field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
    ) -> "Prepared":
        """A field made ready for a plan, a stop and outputs; `directions` are those of the rays (n, 3).

        Clocked as "upload" and "compile".

        Raises:
            ValueError: The device is not there, or too small for the field.
        """

    def tuned(self, arguments: list, numbers: dict[str, Any]) -> list:
        """Arguments of a `Prepared` with other numbers of the struct Control, by name; the former may be changed."""

    def prepare_bundle(self, table: BundleTable, outputs: frozenset) -> "Prepared":
        """Patches between traced rays made ready for outputs of rays of their family."""

    def pupil_kernels(self, names: Iterable[str]) -> dict[str, Any]:
        """Those kernels of a pupil, by name, of launch_pupil, sum_moments, sum_phasors and reduce_sums."""

    def grid_kernels(self, names: Iterable[str]) -> dict[str, Any]:
        """Those of GRID_KERNELS, which prepare a grid, by name."""

    def keeps(self, size: float) -> bool:
        """Whether results of so many bytes, and the rays, stay on the device until they are read."""

    def bring(self, starts: Sequence[Any]) -> tuple[list[Any], Iterable[slice]]:
        """Buffers with the rays, of an engine that `keeps` them, and the rows that are there, as soon as they are.

        What is launched on rows that were given finds them. `starts` are NumPy arrays or DeviceArrays.
        """

    def fetching(self, results: dict[str, Any], starts: Sequence[Any]) -> Any:
        """What brings results to the host chunk by chunk (device_arrays/fetching.py); None where they wait to be read.

        Of an engine that `keeps` them.
        """

    def put(self, array: np.ndarray) -> Any:
        """A buffer with a copy of the array, whose rows are numbers, places or directions.

        An array whose rows are one in memory may be one row there, too: kernels read it as all others.
        """

    def share(self, array: np.ndarray) -> Any:
        """A buffer in the memory of an array of numbers, on a processor; on a GPU a buffer with a copy of it.

        The array lives as long as the buffer. What kernels write is there once `wait` has returned.
        """

    def put_into(self, buffer: Any, array: np.ndarray) -> None:
        """Copy an array over the first rows of a buffer."""

    def empty(self, count: int, width: int = 1, kind: type = np.float64) -> Any:
        """A buffer of `count` rows of `width` numbers."""

    def get(self, buffer: Any, array: np.ndarray) -> None:
        """Wait for what was launched, and copy the first rows of a buffer into the array."""

    def sent(self, array: np.ndarray) -> "Sent":
        """A buffer with a copy of an array of numbers, which is sent there again and again."""

    def fetched(self, buffers: Sequence[Any], arrays: Sequence[np.ndarray]) -> "Fetched":
        """What brings buffers into arrays of the same numbers, together, again and again."""

    def recorded(self) -> Callable[[Callable[[], None]], None]:
        """What does the same work again and again: launches, `Sent` and `Fetched` on the same buffers each time.

        Where a device takes all of it as one, it gets it so from the second time on.
        """

    def launch(self, kernel: Any, before: list, after: list, count: int) -> Any:
        """Start a kernel over `count` rays, or groups of rays, without waiting for it.

        The kernel's arguments are `before`, the number of the first of them, and `after`; a dictionary of
        buffers stands for the struct of outputs.
        """

    def wait(self) -> None:
        """Wait for what this thread launched."""

    def settle(self) -> None:
        """Wait for what was launched to make what other threads may be given, where these would not wait for it."""


class Sent(Protocol):
    """An array on the host and a buffer to which it is sent; see `Engine.sent`.

    Attributes:
        array: To be written before it is sent, and left alone until what was launched after that has ended.
        buffer: Where it goes.
    """

    array: np.ndarray
    buffer: Any

    def send(self) -> None:
        """Start to copy it; what is launched from now on finds it there."""


class Fetched(Protocol):
    """Buffers and the arrays that they come to; see `Engine.fetched`."""

    def start(self) -> None:
        """Start to bring them, as what was launched so far leaves them."""

    def wait(self) -> Sequence[np.ndarray]:
        """The arrays, once they are there; they hold until the next `start`."""


@dataclass(eq=False)
class Prepared:
    """A field made ready on an engine: uploaded, with the kernel for a plan, a stop and outputs.

    Attributes:
        engine: Whose.
        kernel: What traces.
        arguments: What it is given before the rays.
        outputs: What it computes for each ray, besides the status.
        rejected: Buffer in which it counts rays that it does not hold for; None where it holds for all.
        is_packed: Whether it moves packets of rays, which share lookups where they are in one column of cells.
    """

    engine: Engine
    kernel: Any
    arguments: list
    outputs: frozenset
    rejected: Any
    is_packed: bool = False

    def launch(self, starts: list, results: dict, count: int) -> Any:
        """Start the kernel on rays whose `starts` are on the device; see `Engine.launch`."""
        counted = [] if self.rejected is None else [self.rejected]
        return self.engine.launch(self.kernel, self.arguments, [*starts, results, *counted], count)

    @property
    def computed(self) -> frozenset:
        """What it computes for each ray, the status among it."""
        return self.outputs | {"status"}

    def allocate(self, count: int, without: Iterable[str] = ()) -> dict[str, Any]:
        """Buffers for the outputs of so many rays; those that are not computed share one row for each type.

        As those do that the caller has buffers for, `without`.
        """
        computed = self.computed.difference(without)
        rows: dict[tuple[int, type], Any] = {}
        buffers: dict[str, Any] = {}
        for name, alike in OUTPUT_TYPES.items():
            if name in computed:
                buffers[name] = self.engine.empty(count, *alike)
            else:
                if alike not in rows:
                    rows[alike] = self.engine.empty(1, *alike)
                buffers[name] = rows[alike]
        return buffers

    def tune(self, **numbers: Any) -> None:
        """Take other numbers of the struct Control from now on."""
        self.arguments = self.engine.tuned(self.arguments, numbers)

    def take_rejected(self) -> int:
        """How many rays the kernel did not hold for since this was last asked."""
        if self.rejected is None:
            return 0
        count = np.zeros(1, np.int32)
        self.engine.get(self.rejected, count)
        return self.taken(int(count[0]))

    def taken(self, count: int) -> int:
        """The same of a number that was read: it is counted from 0 again."""
        if count:
            self.engine.put_into(self.rejected, np.zeros(1, np.int32))
        return count
