"""Old names of packages that are names of functions: `aerokernels.echo` is the function, its package is `lidar`.

Importing an old name (`from aerokernels.echo import GaussianPulse`) warns, and gives what the package has. Python then
binds the module to the name of the function, so the module can be called as the function is.
"""

import sys
import warnings
from importlib import import_module
from types import ModuleType
from typing import Any


class OldModule(ModuleType):
    """A module that has what a package has and that, when called, calls the package's function of the module's name."""

    package: ModuleType

    def __getattr__(self, name: str) -> Any:
        """Return the package's attribute."""
        return getattr(self.package, name)

    def __call__(self, *args: Any, **options: Any) -> Any:
        """Call the function; see its own docstring."""
        return getattr(self.package, self.__name__.rpartition(".")[2])(*args, **options)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by name."""
        return import_module, (self.__name__,)


def stand_in(name: str, package: str) -> None:
    """Make the module of a full name stand in for a package; the module itself calls this with its `__name__`."""
    warnings.warn(f"{name} is a function: import from {package} instead", DeprecationWarning, stacklevel=3)
    module = sys.modules[name]
    module.__class__ = OldModule
    module.__dict__["package"] = import_module(package)
