"""Engines compute behind one small interface (interface.py); choice.py has their list and order.

`engine_of` gives the one of a plan; the oracle of reference/ traces whole bundles by itself.
"""

from importlib import import_module

from .choice import available_backends, choose_backend
from .info import BackendInfo
from .interface import OUTPUT_TYPES, Engine, Prepared

__all__ = ["OUTPUT_TYPES", "BackendInfo", "Engine", "Prepared", "available_backends", "choose_backend", "engine_of"]


def engine_of(backend: str, device: str) -> Engine:
    """The engine "warp" or "opencl" on a device; its library is imported here, and no sooner.

    Raises:
        ValueError: The device is not there, or does not open.
    """
    engine: Engine = import_module(f".{backend}.engine", __package__).Engine(device)
    return engine
