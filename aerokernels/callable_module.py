"""Modules that can be called: where the contract gives a function and the module it lives in one name.

`aerokernels.echo` is the module, whatever was imported before and in which order: `from aerokernels.echo import
plane_target_echo` and `import aerokernels.echo as ranging` are what they look like. `aerokernels.echo(scene)` calls the
function of that name in it, `aerokernels.echo.echo`. So it is with `schlieren` and `strehl`.
"""

import inspect
import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any


class CallableModule(ModuleType):
    """A module that, when it is called, calls the function in it that has its name."""

    @property
    def _function(self) -> Callable[..., Any]:
        return self.__dict__[self.__name__.rpartition(".")[2]]

    def __call__(self, *args: Any, **options: Any) -> Any:
        """Call the function; see its own docstring."""
        return self._function(*args, **options)

    @property
    def __signature__(self) -> inspect.Signature:
        """The function's signature."""
        return inspect.signature(self._function)

    def __reduce__(self) -> tuple[Any, ...]:
        """By its name: a function could be sent to another process, so can this."""
        return import_module, (self.__name__,)


def make_callable(name: str) -> None:
    """Make the module of that full name callable; it calls this itself, with its `__name__`."""
    sys.modules[name].__class__ = CallableModule
