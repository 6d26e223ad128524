"""Cache of the device functions and kernels of one precision, each built once."""

import functools
from collections.abc import Callable, Hashable
from typing import Any

from ....process.opened import OPENED, Locked
from .types import types


class KernelLibrary(Locked):
    """The functions and kernels that the builders in kernels/ have made for one precision, and their shared types.

    Attributes:
        precision: "float32" or "float64".
        types: The scalar, vector and struct types of the precision, see types.py.
    """

    def __init__(self, precision: str):
        """Start empty."""
        super().__init__()
        self.precision = precision
        self.types = types(precision)
        self.built: dict[Hashable, Any] = {}


def library_of(precision: str) -> KernelLibrary:
    """Return the library of a precision for this process, which all of Warp's devices share."""
    library: KernelLibrary = OPENED.once(("Warp kernels", precision), lambda: KernelLibrary(precision))
    return library


def built_once(build: Callable) -> Callable:
    """Decorate a builder, `build(library, *options)`: the library caches its result for each set of options."""

    @functools.wraps(build)
    def built(library: KernelLibrary, *options: Hashable) -> Any:
        with library.lock:
            key = build, options
            if key not in library.built:
                library.built[key] = build(library, *options)
            return library.built[key]

    return built
