"""Kernels and their arguments; numbers and structs that are passed by value, as the kernels' compiler has them."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyopencl.cltypes import make_double3

from ..layout import REAL_TYPES, values_of
from .program import WORK_GROUP

# The structs that are passed by value, as the kernels' compiler lays them out.
LAYOUTS = {
    (struct, precision): np.dtype(
        [(value.name, value.number_type(precision), (value.parts[1],)) for value in values_of(struct)], align=True
    )
    for struct in ("Field", "Bounds", "Control")
    for precision in REAL_TYPES
}


def pack(struct: str, precision: str, members: dict) -> np.ndarray:
    """The values of one of the kernels' structs as the kernel's compiler lays them out, to be passed by value."""
    packed = np.zeros((), dtype=LAYOUTS[struct, precision])
    for name in LAYOUTS[struct, precision].names or ():
        packed[name] = members[name]
    return packed


def by_value(value):
    """A kernel's argument as OpenCL takes it: whole numbers are int, others double, three in an array double3."""
    if isinstance(value, int):
        return np.int32(value)
    if isinstance(value, float):
        return np.float64(value)
    if isinstance(value, np.ndarray) and value.shape == (3,):
        return make_double3(*value)
    return value


@dataclass(frozen=True, eq=False)
class Kernel:
    """A kernel object, which belongs to one caller: its arguments are set one by one.

    Attributes:
        kernel: PyOpenCL's.
        lanes: Rays that a work-item moves.
        items: Work-items that one of what it is launched over takes.
        given: The arguments of its last launch: those that are the same need not be set again.
    """

    kernel: Any
    lanes: int = 1
    items: int = 1
    given: list = field(default_factory=list)

    def set(self, arguments: list) -> None:
        """Set those of the arguments that are not what they were.

        One by one: calling the kernel would go through PyOpenCL's launchers, which it keeps on disk, and which a
        damaged disk makes unusable.
        """
        known = self.given if len(self.given) == len(arguments) else [None] * len(arguments)
        for number, (new, old) in enumerate(zip(arguments, known, strict=True)):
            if new is not old and not (type(new) is type(old) and isinstance(new, (int, float)) and new == old):
                self.kernel.set_arg(number, by_value(new))
        self.given[:] = arguments

    def size(self, count: int) -> tuple[int]:
        """Work-items of a launch: whole work-groups, at least one; the kernel itself knows where to stop."""
        return (max(1, -(-(-(-count // self.lanes) * self.items) // WORK_GROUP)) * WORK_GROUP,)
