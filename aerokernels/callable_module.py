"""Make modules callable whose name is also that of a public function.

`aerokernels.echo` is always the module, whatever was imported before and in which order, so that `from aerokernels.echo
import plane_target_echo` and `import aerokernels.echo as ranging` work as usual. `aerokernels.echo(scene)` calls the
function of that name in the module, `aerokernels.echo.echo`. The same holds for `schlieren` and `strehl`.
"""

import inspect
import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any


class CallableModule(ModuleType):
    """A module that, when called, calls its function of the same name."""

    @property
    def _function(self) -> Callable[..., Any]:
        return self.__dict__[self.__name__.rpartition(".")[2]]

    def __call__(self, *args: Any, **options: Any) -> Any:
        """Call the function; see its own docstring."""
        return self._function(*args, **options)

    @property
    def __signature__(self) -> inspect.Signature:
        """Signature of the function."""
        return inspect.signature(self._function)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by name: like a function, the module can be sent to another process."""
        return import_module, (self.__name__,)


def make_callable(name: str) -> None:
    """Make the module of that full name callable; the module itself calls this with its `__name__`."""
    sys.modules[name].__class__ = CallableModule
