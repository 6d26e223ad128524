"""Import of the optional packages that wavefronts are exported to."""

from importlib import import_module
from typing import Any


def package(name: str) -> Any:
    """Import a module of another package.

    Raises:
        ModuleNotFoundError: The package is not installed; the message says how to install it.
    """
    own = name.split(".")[0]
    try:
        return import_module(name)
    except ModuleNotFoundError as fault:
        if fault.name != own:
            raise  # a dependency of the package is missing
        message = f"{own} is not installed, which this export needs: pip install 'aerokernels[exchange]'"
        raise ModuleNotFoundError(message, name=own) from None
