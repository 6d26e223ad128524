"""Compute engines behind one small interface (interface.py); choice.py lists and orders them.

`engine_of` returns the engine of a plan. The reference engine (reference/) traces whole bundles on its own and does not
implement the interface.
"""

import os
from importlib import import_module

from ...process.opened import OPENED
from .choice import available_backends, choose_backend
from .info import BackendInfo
from .interface import OUTPUT_TYPES, Engine, Prepared

__all__ = ["OUTPUT_TYPES", "BackendInfo", "Engine", "Prepared", "available_backends", "choose_backend", "engine_of"]


def engine_of(backend: str, device: str) -> Engine:
    """Return the engine "warp" or "opencl" on a device, importing its library only at this point.

    Raises:
        ValueError: The device does not exist, or does not open.
    """
    key = "engine", backend, device, os.getpid()  # no device survives a fork
    engine: Engine = OPENED.once(key, lambda: import_module(f".{backend}.engine", __package__).Engine(device))
    return engine
