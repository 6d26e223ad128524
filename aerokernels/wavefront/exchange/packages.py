"""Packages that wavefronts are handed over to, of which none has to be there."""

from importlib import import_module
from typing import Any


def package(name: str) -> Any:
    """A module of another package.

    Raises:
        ModuleNotFoundError: The package is not there; says how it gets there.
    """
    own = name.split(".")[0]
    try:
        return import_module(name)
    except ModuleNotFoundError as fault:
        if fault.name != own:
            raise  # one that the package itself needs
        told = f"{own} is not installed, which this hands wavefronts over to: pip install 'aerokernels[exchange]'"
        raise ModuleNotFoundError(told, name=own) from None
