"""The interface of every engine: device memory, kernel launches, and fields prepared for kernels.

Kernels have the same names and arguments in Warp and in OpenCL, so code that uses only this interface is written once
for both: a bundle in chunks (launch.py), a pupil and its sums (pupil/run.py). Arrays of fields and of bundles are
uploaded here, and cached with the field or the bundle.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.tracing.engines.field_data import kernel_arrays, kernel_numbers
from aerokernels.tracing.tasks.cube_polynomials import cube_polynomials
from aerokernels.tracing.tasks.family import BundleTable

from ...derived import cached_on, key_of
from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...process.clock import stage
from ..plan import TracePlan
from .field_data import FieldData, array_of, field_data, plan_members, step_bound_tables, stop_kind, trace_members
from .layout import ARRAYS, REAL_TYPES, STRUCTS, Value, number_type, parts_of
from .transfers import Fetched, Sent

# Tables that kernels may compute from a grid, besides its spline coefficients.
GRID_TABLES = ("roughness", "potential by blocks", "potential peaks")
# The kernels without options of a scene, by the file of OpenCL C in which they are built together.
PROGRAMS = {
    "pupil": ("launch_pupil", "sum_rays", "reduce_sums"),
    "grid_tables": ("spline_lines", "column_maxima", "block_maxima", "round_coefficients"),
}
# Per-ray outputs of the tracing kernels, in their order: how many numbers per ray, and their type.
OUTPUT_TYPES = {member.name: (parts_of(member.kind)[1], number_type(member.kind)) for member in STRUCTS["RayOutputs"]}
# Structs of a field that are cached for the last plans; sets of outputs and devices cached with a field or a bundle.
STRUCTS_CACHED, ARRAYS_CACHED = 4, 8  # speed only


class Engine(ABC):
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

    @property
    def key(self) -> tuple:
        """A key for caches that differs for other engines and devices."""
        return self.grid_key[1:]

    def prepare(
        self, field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
    ) -> "Prepared":
        """Prepare a field for a plan, a stop and outputs; `directions` are the rays' directions, shape (n, 3).

        The time counts as the stages "upload" and "compile".

        Raises:
            ValueError: The device does not exist, or is too small for the field.
        """
        if plan.controls_error:
            outputs = outputs | {"step_error"}
        with stage("upload"):
            structs, control = self._uploaded(field, plan, until, wavelength, outputs, directions)
            arguments = self.arguments(structs, control, plan.precision)
        options = {
            "precision": plan.precision,
            "geometry": field.geometry,
            "interpolation": field.interpolation,
            "on_mesh": not field.is_uniform,
            "method": plan.compiled_method,
            "stop": stop_kind(until),
            "has_body": field.body is not None,
            "measured": "step_error" in outputs,
            "cubes": plan.looks_up_cubes,
        }
        with stage("compile"):
            return self.compiled(options, plan.sample_count > 0, arguments, outputs)

    @abstractmethod
    def compiled(self, options: dict[str, Any], leapfrog: bool, arguments: list, outputs: frozenset) -> "Prepared":
        """Return the kernel of a scene with its arguments before the rays; `options` are those of layout.py."""

    @abstractmethod
    def place_structs(self, data: FieldData, precision: str, arrays: dict[str, Any], bounds: dict[str, Any]) -> Any:
        """Return the structs Field and Bounds as kernels take them; `arrays` are those of Field on the device."""

    @abstractmethod
    def arguments(self, structs: Any, control: dict[str, Any], precision: str) -> list:
        """Return the arguments of a tracing kernel before the rays, from `place_structs` and the members of Control."""

    @abstractmethod
    def tuned(self, arguments: list, numbers: dict[str, Any]) -> list:
        """Return arguments of a `Prepared` with new values of struct Control, by name; `arguments` may be modified."""

    @abstractmethod
    def bundle_kernel(self, precision: str, channels: int) -> Any:
        """Return the kernel deliver_bundle."""

    def prepare_bundle(self, table: BundleTable, outputs: frozenset) -> "Prepared":
        """Prepare the patches between traced rays to interpolate these outputs for rays of the same family."""
        with stage("upload"):
            arguments = [*_bundle_arrays(table, self), *kernel_numbers(table, outputs)]
        with stage("compile"):
            kernel = self.bundle_kernel(table.precision, table.channels)
        return Prepared(self, kernel, arguments, outputs, None)

    @abstractmethod
    def kernels(self, names: Iterable[str]) -> dict[str, Any]:
        """Return the named kernels of PROGRAMS."""

    def keeps(self, size: float) -> bool:
        """Return whether results of `size` bytes, and the rays, stay on the device until they are read."""
        return False

    def bring(self, starts: Sequence[Any]) -> tuple[list[Any], Iterable[slice]]:
        """Return buffers for the rays, and an iterator over the slices of rows that have arrived, in order.

        A kernel launched on rows already yielded finds them there. `starts` are NumPy arrays or DeviceArrays.
        """
        return [self.put(np.asarray(each)) for each in starts], [slice(0, len(starts[0]))]

    def fetching(self, results: dict[str, Any], starts: Sequence[Any]) -> Any:
        """Return an object that copies results to the host chunk by chunk (device_arrays/fetching.py).

        None if they stay on the device until they are read.
        """
        return None

    @abstractmethod
    def put(self, array: np.ndarray) -> Any:
        """Return a buffer with a copy of the array, whose rows are numbers, positions or directions.

        An array that repeats one row in memory may be stored as one row on the device; kernels read it like any other.
        """

    @abstractmethod
    def share(self, array: np.ndarray) -> Any:
        """Return a buffer in the memory of an array of numbers on a CPU, a buffer with a copy of the array on a GPU.

        The array lives as long as the buffer. On a CPU the array holds what kernels wrote once `wait` has returned.
        """

    @abstractmethod
    def struct_array(self, member: Value, values: np.ndarray, precision: str) -> Any:
        """Upload an array of a struct to the device."""

    @abstractmethod
    def put_into(self, buffer: Any, array: np.ndarray) -> None:
        """Copy an array over the first rows of a buffer."""

    @abstractmethod
    def empty(self, count: int, width: int = 1, kind: type = np.float64) -> Any:
        """Return an uninitialised buffer of `count` rows of `width` numbers."""

    def room(self, shape: tuple[int, ...], kind: type) -> np.ndarray:
        """Return an uninitialised array on the host for `get`: on a GPU of memory that it copies to at full speed."""
        return np.empty(shape, kind)

    @abstractmethod
    def get(self, buffer: Any, array: np.ndarray) -> None:
        """Wait for the launched kernels, and copy the first rows of a buffer into the array."""

    def sent(self, array: np.ndarray) -> Sent:
        """Return a buffer for an array of numbers that is uploaded repeatedly, the first time by `Sent.send`."""
        return Sent(array, self.share(array))

    def fetched(self, arrays: Sequence[np.ndarray]) -> Fetched:
        """Return uninitialised buffers for the numbers of arrays, which are copied to the host together, repeatedly.

        Rows of two or three float64 are vectors for the kernels. On a CPU the buffers share the arrays' memory.
        """
        return Fetched(self, arrays, [self.share(array) for array in arrays])

    def recorded(self) -> Callable[[Callable[[], None]], None]:
        """Return a callable that runs the same work repeatedly: launches, `Sent` and `Fetched` on the same buffers.

        A device that can replay the work as one graph does so from the second call on.
        """
        return lambda work: work()

    @abstractmethod
    def launch(self, kernel: Any, before: list, after: list, count: int, first: int = 0) -> Any:
        """Start a kernel over `count` rays, or groups of rays, from number `first` on, without waiting for it.

        The kernel's arguments are `before`, the number of the first ray or group, and `after`; a dictionary of
        buffers stands for the struct of outputs.
        """

    @abstractmethod
    def clear(self, buffer: Any) -> None:
        """Set the first number of a buffer of int32 to 0, without waiting on a GPU."""

    @abstractmethod
    def wait(self) -> None:
        """Wait for the kernels that this thread launched."""

    def settle(self) -> None:
        """Wait for the launched kernels if other threads may use their results and would not wait themselves."""
        return

    def _uploaded(
        self, field: IndexField, plan: TracePlan, until, wavelength: float, outputs: frozenset, directions: np.ndarray
    ) -> tuple[Any, dict[str, Any]]:
        """Return the structs of `place_structs`, and the members of struct Control, whose arrays are on the device.

        For leapfrog samples both are cached on the field: a pilot and the rays that follow its plan share them.
        """

        def make() -> tuple[Any, dict[str, Any]]:
            with_paper_step = plan.method == "paper"
            data = field_data(field, plan.precision, with_paper_step)
            bounds, control = trace_members(field, data, plan, until, wavelength)
            tables, blocks = step_bound_tables(field, plan, wavelength, directions)
            arrays = _field_arrays(field, self, plan.precision, with_paper_step)
            if plan.looks_up_cubes:
                arrays = {**arrays, "coefficients": _cubes(field, self)}
            structs = self.place_structs(data, plan.precision, arrays, data.bounds | bounds)
            return structs, data.control | control | blocks | self._control_arrays(field, plan.precision, tables)

        if plan.sample_count:
            numbers = plan.step, plan.max_steps, plan.lever_arms, plan.tolerance * wavelength
            key = key_of((plan.precision, plan.method, plan.looks_up_cubes, plan.sampling, *numbers, until))
            structs, control = field.derive(("structs", *self.key, key), make, STRUCTS_CACHED)
        else:
            structs, control = make()
        return structs, control | plan_members(plan, outputs)

    def _control_arrays(self, field: IndexField, precision: str, tables: dict) -> dict[str, Any]:
        """Return the arrays of Control on the device, by name; they are cached if the field has no step bounds."""

        def upload() -> dict[str, Any]:
            return {
                member.name: self.struct_array(member, tables[member.name], precision) for member in ARRAYS["Control"]
            }

        if tables["step_bound_start"].max() >= 0:
            return upload()
        holder = getattr(field.samples, "places", field)
        arrays: dict[str, Any] = holder.derive((*self.key, "without step bounds", precision), upload)
        return arrays

    def computed_coefficients(self, field: IndexField, precision: str) -> Any:
        """Return a grid's coefficients if this device has computed them, or has the same memory; else None.

        A CPU leaves it to NumPy to round them: for the kernel one more program would have to be loaded.
        """
        held = field.samples.held(self.grid_key)
        if held is None and not self.is_gpu and isinstance(field.samples, UniformGrid):
            coefficients = field.samples.coefficients
            return self.share(coefficients.reshape(-1)) if coefficients.dtype == REAL_TYPES[precision] else None
        if held is None or precision == "float64":
            return held
        if not self.is_gpu:
            return None
        count = math.prod(field.samples.coefficient_shape)
        rounded = self.empty(count, kind=np.float32)
        kernel = self.kernels(["round_coefficients"])["round_coefficients"]
        self.launch(kernel, [held], [rounded], count)
        return rounded


@cached_on("field", ARRAYS_CACHED)
def _field_arrays(field: IndexField, engine: Engine, precision: str, with_paper_step: bool) -> dict[str, Any]:
    """Return the arrays of Field on the device, by name."""
    data = field_data(field, precision, with_paper_step)
    coefficients = engine.computed_coefficients(field, precision)
    shared = _shared_arrays(data, engine, precision)
    return {
        member.name: shared[member.name]
        if member.name in shared
        else engine.struct_array(member, array_of(field, data, member.name), precision)
        if coefficients is None
        else coefficients
        for member in ARRAYS["Field"]
    }


@cached_on("data", ARRAYS_CACHED)
def _shared_arrays(data: FieldData, engine: Engine, precision: str) -> dict[str, Any]:
    """Upload the arrays in `data`, by name, which fields on the same nodes may share."""
    members = [member for member in ARRAYS["Field"] if member.name in data.arrays]
    return {member.name: engine.struct_array(member, data.arrays[member.name], precision) for member in members}


@cached_on("field", ARRAYS_CACHED)
def _cubes(field: IndexField, engine: Engine) -> Any:
    """Return the table of polynomials of cubes on the device."""
    assert isinstance(field.samples, UniformGrid)
    return engine.put(cube_polynomials(field.samples).ravel())


@cached_on("table", ARRAYS_CACHED)
def _bundle_arrays(table: BundleTable, engine: Engine) -> list:
    return [engine.put(array) for array in kernel_arrays(table)]


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
    """

    engine: Engine
    kernel: Any
    arguments: list
    outputs: frozenset
    rejected: Any
    is_packed: bool = False

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
        unused: dict[tuple[int, type], Any] = {}
        for name, alike in OUTPUT_TYPES.items():
            if name in computed:
                buffers[name] = self.engine.empty(count, *alike)
            else:
                if alike not in unused:
                    unused[alike] = self.engine.empty(1, *alike)
                buffers[name] = unused[alike]
        return buffers

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
