"""aerokernels: light through the refractive index of supersonic air flow.

Each public name is imported when it is first used, so that importing the package takes no time; `__init__.pyi` lists
them with their modules.
"""

import re
import sys
from importlib import import_module
from pathlib import Path

from .old_modules import OldModules

__version__ = "0.1.0"

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULE_OF = {name: module for module, name in re.findall(r"^from \.([\w.]*) import (\w+) as", _STUB, re.MULTILINE)}
__all__ = sorted(_MODULE_OF)
sys.meta_path.append(OldModules())  # type: ignore[arg-type]


def __getattr__(name: str):
    """Import a public name from its module."""
    if name not in _MODULE_OF:
        from difflib import get_close_matches

        near = get_close_matches(name, __all__, 1)
        hint = f": did you mean {near[0]}?" if near else ""
        raise AttributeError(f"module 'aerokernels' has no attribute {name!r}{hint}")
    module = _MODULE_OF[name]
    value = getattr(import_module(f".{module}", __name__), name) if module else import_module(f".{name}", __name__)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return [*__all__, "__version__"]
