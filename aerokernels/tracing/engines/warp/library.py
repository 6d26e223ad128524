"""The device functions and kernels of one precision, each built once."""

import functools
import threading
from collections.abc import Callable, Hashable
from typing import Any

from ....process.opened import OPENED
from .types import types


class KernelLibrary:
    """What the builders in kernels/ have made for one precision, and the types that all of it shares.

    Attributes:
        precision: "float32" or "float64".
        types: Its scalar, vector and struct types, see types.py.
    """

    def __init__(self, precision: str):
        """Nothing is built yet."""
        self.precision = precision
        self.types = types(precision)
        self.built: dict[Hashable, Any] = {}
        self.lock = threading.RLock()  # builders call builders


def library_of(precision: str) -> KernelLibrary:
    """The library of this process, which Warp on all devices shares."""
    library: KernelLibrary = OPENED.once(("Warp kernels", precision), lambda: KernelLibrary(precision))
    return library


def built_once(build: Callable) -> Callable:
    """Decorate a builder, `build(library, *options)`: a library builds the same options once, and keeps the result."""

    @functools.wraps(build)
    def built(library: KernelLibrary, *options: Hashable) -> Any:
        with library.lock:
            key = build, options
            if key not in library.built:
                library.built[key] = build(library, *options)
            return library.built[key]

    return built
