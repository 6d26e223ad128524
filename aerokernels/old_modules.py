"""Old names of packages that are names of functions: `aerokernels.echo` is the function, its package is `lidar`.

Importing an old name (`from aerokernels.echo import GaussianPulse`) warns, and gives what the package has. Python then
binds the module to the name of the function, so the module can be called as the function is.
"""

import warnings
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

PACKAGES = {"echo": "lidar", "schlieren": "benches", "strehl": "focus", "wavefront": "wavefronts"}


class OldModule(ModuleType):
    """A module that has what a package has and that, when called, calls the package's function of the module's name."""

    def __getattr__(self, name: str) -> Any:
        """Return the package's attribute."""
        return getattr(_package_of(self.__name__), name)

    def __call__(self, *args: Any, **options: Any) -> Any:
        """Call the function; see its own docstring."""
        return getattr(self, self.__name__.rpartition(".")[2])(*args, **options)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by name."""
        return import_module, (self.__name__,)


class OldModules:
    """Finds and loads the modules of old names."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return the specification of the module of an old name; None for any other name."""
        package, _, own = name.rpartition(".")
        return ModuleSpec(name, self) if package == __package__ and own in PACKAGES else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module."""
        return OldModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Warn, and import the package."""
        package = _package_of(module.__name__)
        text = f"{module.__name__} is a function: import from {package.__name__} instead"
        warnings.warn(text, DeprecationWarning, stacklevel=2)


def _package_of(name: str) -> ModuleType:
    return import_module(f"{__package__}.{PACKAGES[name.rpartition('.')[2]]}")
