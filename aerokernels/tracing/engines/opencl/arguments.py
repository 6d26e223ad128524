"""Arguments of kernels that are passed by value: numbers and structs, as the kernels' compiler lays them out."""

import numpy as np
from pyopencl.cltypes import make_double3

from ..layout import REAL_TYPES, values_of

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
