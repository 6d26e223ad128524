"""aerokernels: light through the refractive index of supersonic air flow.

Each public name is imported when it is first used, so that importing the package takes no time; `__init__.pyi` lists
them with their modules.
"""

import re
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from .old_modules import OldModules

__version__ = "0.1.0"

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULE_OF = {name: module for module, name in re.findall(r"^from \.([\w.]*) import (\w+) as", _STUB, re.MULTILINE)}
__all__ = sorted(_MODULE_OF)
sys.meta_path.append(OldModules())  # type: ignore[arg-type]


def attributes_of(package: str, module_of: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package, which imports public names from their modules when they are first used."""

    def attribute(name: str) -> Any:
        if name not in module_of:
            from difflib import get_close_matches

            hint = "".join(f": did you mean {near}?" for near in get_close_matches(name, module_of, 1))
            raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")
        module = import_module(f".{module_of[name] or name}", package)
        value = getattr(module, name) if module_of[name] else module
        setattr(sys.modules[package], name, value)
        return value

    return attribute


__getattr__ = attributes_of(__name__, _MODULE_OF)


def __dir__() -> list[str]:
    """Return the public names."""
    return [*__all__, "__version__"]
