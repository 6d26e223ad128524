"""Set the arguments of kernels, and lay out numbers and structs passed by value as the kernels' compiler does."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..layout import REAL_TYPES, values_of
from .program import WORK_GROUP

# The memory layouts of the structs that are passed by value.
LAYOUTS = {
    (struct, precision): np.dtype(
        [(value.name, value.number_type(precision), (value.parts[1],)) for value in values_of(struct)], align=True
    )
    for struct in ("Field", "Bounds", "Control")
    for precision in REAL_TYPES
}


def pack(struct: str, precision: str, members: dict) -> np.ndarray:
    """Pack the values of one of the kernels' structs in the layout of the kernels' compiler."""
    packed = np.zeros((), dtype=LAYOUTS[struct, precision])
    for name in LAYOUTS[struct, precision].names or ():
        packed[name] = members[name]
    return packed


def _vector_or_struct(array: np.ndarray) -> np.ndarray:
    """Return three numbers in the layout of a double3, and a packed struct as it is."""
    return np.array([*array, 0.0]) if array.shape == (3,) else array


# By type, since a launch has some forty arguments, most of them buffers.
CONVERSIONS: dict[type, Callable[[Any], Any]] = {int: np.int32, float: np.float64, np.ndarray: _vector_or_struct}


def by_value(value):
    """Convert a kernel's argument for OpenCL: an int to int, a float to double, an array of three to double3."""
    convert = CONVERSIONS.get(type(value))
    if convert is not None:
        return convert(value)
    return np.int32(value) if isinstance(value, int) else value


def lasting(given: list) -> list:
    """Return the arguments that a kernel out of use may keep: numbers and structs, but no buffers."""
    return [value if isinstance(value, (int, float, np.ndarray)) else None for value in given]


@dataclass(eq=False)
class Kernel:
    """A kernel object with one owner, whose arguments are set one by one.

    Attributes:
        kernel: PyOpenCL's kernel object.
        lanes: Rays that a work-item moves.
        items: Work-items per ray or group of the launch.
        given: The arguments that are set, which are not set again if unchanged.
        last: The list of arguments of the last launch.
        group: Work-items of a work-group.
        again: Makes another kernel object of the same program.
    """

    kernel: Any
    lanes: int = 1
    items: int = 1
    given: list = field(default_factory=list)
    last: list | None = None
    group: int = WORK_GROUP
    again: Callable[[], "Kernel"] | None = None

    def set(self, arguments: list) -> None:
        """Set the arguments that have changed since the last launch.

        They are set one by one, because calling the kernel would use PyOpenCL's launchers, which PyOpenCL caches on
        disk and which a damaged file would make unusable.
        """
        if arguments is self.last:
            return
        known = self.given if len(self.given) == len(arguments) else [None] * len(arguments)
        for number, (new, old) in enumerate(zip(arguments, known, strict=True)):
            if new is old:
                continue
            kind = type(new)
            if kind is int or kind is float:
                if kind is type(old) and new == old:
                    continue
            self.kernel.set_arg(number, by_value(new))
        self.given[:] = self.last = arguments

    def size(self, count: int) -> tuple[int]:
        """Number of work-items of a launch: whole work-groups, at least one; the kernel ignores the surplus."""
        return (max(1, -(-(-(-count // self.lanes) * self.items) // self.group)) * self.group,)
