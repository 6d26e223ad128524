"""Upload the arrays of fields and of bundles to an engine's device, and cache them with the field or the bundle."""

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from ...derived import key_of
from ...medium import IndexField
from ...medium.grid import UniformGrid
from ...process.clock import stage
from ..bundle.frame import kernel_arrays, kernel_numbers
from ..bundle.table import BundleTable
from ..leapfrog.cube_polynomials import cube_polynomials
from ..plan import TracePlan
from .field_data import FieldData, array_of, field_data, plan_members, step_bound_tables, trace_members
from .layout import REAL_TYPES, Value, arrays_of

# Structs of a field that are cached for the last plans.
STRUCTS_CACHED = 4  # speed only
# Sets of outputs whose kernel arguments are cached with a bundle's table.
NUMBERS_CACHED = 4  # speed only


class Uploads(ABC):
    """The uploads that the engines share. An engine provides the abstract methods.

    Attributes:
        grid_key: See interface.py; without its first entry, it tells the uploads of engines and devices apart.
        is_gpu: See interface.py.
    """

    grid_key: tuple
    is_gpu: bool

    @property
    def key(self) -> tuple:
        """A key for caches that differs for other engines and devices."""
        return self.grid_key

    @abstractmethod
    def put(self, array: np.ndarray) -> Any:
        """Return a buffer with a copy of the array."""

    @abstractmethod
    def share(self, array: np.ndarray) -> Any:
        """See interface.py."""

    @abstractmethod
    def struct_array(self, member: Value, values: np.ndarray, precision: str) -> Any:
        """Upload an array of a struct to the device."""

    @abstractmethod
    def empty(self, count: int, width: int = 1, kind: type = np.float64) -> Any:
        """See interface.py."""

    @abstractmethod
    def put_into(self, buffer: Any, array: np.ndarray) -> None:
        """See interface.py."""

    @abstractmethod
    def wait(self) -> None:
        """See interface.py."""

    @abstractmethod
    def round_into(self, coefficients: Any, made: Any, count: int, precision: str) -> None:
        """Start to round a grid's coefficients, a buffer of float64, into a buffer of this precision."""

    @abstractmethod
    def place_structs(self, data: FieldData, precision: str, arrays: dict[str, Any], bounds: dict[str, Any]) -> Any:
        """Return the structs Field and Bounds as kernels take them; `arrays` are those of Field on the device."""

    def room(self, shape: tuple[int, ...], kind: type) -> np.ndarray:
        """See interface.py."""
        return np.empty(shape, kind)

    def uploaded(
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
            arrays = self._field_arrays(field, data, plan.precision, with_paper_step)
            if plan.looks_up_cubes:
                arrays = {**arrays, "coefficients": self._cubes(field)}
            structs = self.place_structs(data, plan.precision, arrays, data.bounds | bounds)
            return structs, data.control | control | blocks | self._control_arrays(field, plan.precision, tables)

        if plan.sample_count:
            numbers = plan.step, plan.max_steps, plan.lever_arms, plan.tolerance * wavelength
            key = key_of((plan.precision, plan.method, plan.looks_up_cubes, plan.sampling, *numbers, until))
            place = "structs", *self.grid_key[1:], key
            structs, control = field.derive(place, make, STRUCTS_CACHED)
        else:
            structs, control = make()
        return structs, control | plan_members(plan, outputs)

    def renew(self, field: IndexField, precision: str, on_host: np.ndarray | None) -> None:
        """See interface.py."""
        if precision == "float64":
            return  # the structs refer to the coefficients themselves
        arrays = self._field_arrays(field, field_data(field, precision, False), precision, False)
        if on_host is None:
            count = math.prod(field.samples.coefficient_shape)
            self.round_into(field.samples.held(self.grid_key), arrays["coefficients"], count, precision)
        else:
            self.wait()
            self.put_into(arrays["coefficients"], on_host.astype(REAL_TYPES[precision]))

    def _computed_coefficients(self, field: IndexField, precision: str) -> Any:
        """Return a grid's coefficients if this device has computed them, or has the same memory; else None.

        A CPU leaves it to NumPy to round them: for the kernel one more program would have to be loaded.
        """
        found = field.samples.held(self.grid_key)
        if found is None and not self.is_gpu and isinstance(field.samples, UniformGrid):
            coefficients = field.samples.coefficients
            return self.share(coefficients.reshape(-1)) if coefficients.dtype == REAL_TYPES[precision] else None
        if found is None or precision == "float64":
            return found
        if not self.is_gpu:
            return None
        count = math.prod(field.samples.coefficient_shape)
        made = self.empty(count, kind=REAL_TYPES[precision])
        self.round_into(found, made, count, precision)
        return made

    def bundle_arguments(self, table: BundleTable, outputs: frozenset) -> list:
        """Return the arguments of the kernel deliver_bundle before the rays, with arrays on the device."""
        with stage("upload"):
            arrays = table.derive(self.grid_key[1:], lambda: [self.put(array) for array in kernel_arrays(table)])
        key = "kernel numbers", outputs
        return [*arrays, *table.derive(key, lambda: kernel_numbers(table, outputs), NUMBERS_CACHED)]

    def bundle_unused(self, table: BundleTable) -> dict[tuple[int, type], Any]:
        """Return the buffers for outputs of a bundle that are not requested, see `Prepared`, cached with the table."""
        unused: dict[tuple[int, type], Any] = table.derive((*self.grid_key[1:], "unused"), dict)
        return unused

    def _field_arrays(
        self, field: IndexField, data: FieldData, precision: str, with_paper_step: bool
    ) -> dict[str, Any]:
        """Return the arrays of Field on the device, by name, cached on the field."""

        def upload() -> dict[str, Any]:
            coefficients = self._computed_coefficients(field, precision)
            shared = data.derive((*self.grid_key[1:], precision), lambda: self._shared_arrays(data, precision))
            return {
                member.name: shared[member.name]
                if member.name in shared
                else self.struct_array(member, array_of(field, data, member.name), precision)
                if coefficients is None
                else coefficients
                for member in arrays_of("Field")
            }

        return field.derive((*self.grid_key[1:], precision, with_paper_step), upload)

    def _shared_arrays(self, data: FieldData, precision: str) -> dict[str, Any]:
        """Upload the arrays in `data`, by name, which fields on the same nodes may share."""
        members = [member for member in arrays_of("Field") if member.name in data.arrays]
        return {member.name: self.struct_array(member, data.arrays[member.name], precision) for member in members}

    def _control_arrays(self, field: IndexField, precision: str, tables: dict) -> dict[str, Any]:
        """Return the arrays of Control on the device, by name; they are cached if the field has no step bounds."""

        def upload() -> dict[str, Any]:
            return {
                member.name: self.struct_array(member, tables[member.name], precision)
                for member in arrays_of("Control")
            }

        if tables["step_bound_start"].max() >= 0:
            return upload()
        holder = getattr(field.samples, "places", field)
        arrays: dict[str, Any] = holder.derive((*self.grid_key[1:], "without step bounds", precision), upload)
        return arrays

    def _cubes(self, field: IndexField) -> Any:
        """Return the table of polynomials of cubes, cached on the field."""
        grid = field.samples
        assert isinstance(grid, UniformGrid)
        return field.derive((*self.grid_key[1:], "cubes"), lambda: self.put(cube_polynomials(grid).ravel()))
