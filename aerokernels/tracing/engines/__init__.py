"""Engines: what computes, behind one small interface. `engine_of` gives the one of a plan."""

from importlib import import_module

from .interface import OUTPUT_TYPES, Engine, Prepared

__all__ = ["OUTPUT_TYPES", "Engine", "Prepared", "engine_of"]

MODULES = {"warp": "..warp_backend", "opencl": "..opencl_backend"}


def engine_of(backend: str, device: str) -> Engine:
    """The engine "warp" or "opencl" on a device; its library is imported here, and no sooner.

    Raises:
        ValueError: The device is not there, or does not open.
    """
    engine: Engine = import_module(MODULES[backend], __package__).Engine(device)
    return engine
