"""Write a scene as it was run as TOML in SI units, which is stored with every result."""

import json
import re
from collections.abc import Mapping
from typing import Any

from aerokernels.scene import Scene


def scene_toml(scene: Scene) -> str:
    """Return all keys of a scene, defaults included, as a TOML text that loads to an equal scene."""
    tables = {key: value for key, value in scene.as_dict().items() if isinstance(value, Mapping)}
    single = {key: value for key, value in scene.as_dict().items() if not isinstance(value, Mapping)}
    parts = [_lines(single), *(f"[{name}]\n{_lines(table)}" for name, table in tables.items())]
    return "\n\n".join(part for part in parts if part) + "\n"


def _lines(values: Mapping[str, Any]) -> str:
    return "\n".join(_assignments(values))


def _assignments(values: Mapping[str, Any]) -> list[str]:
    # TOML has no null, and an absent key means the same.
    return [
        f"{key if re.fullmatch('[A-Za-z0-9_-]+', key) else _value(key)} = {_value(value)}"
        for key, value in values.items()
        if value is not None
    ]


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{{', '.join(_assignments(value))}}}"
    # JSON texts, numbers and lists are valid TOML too, but for the delete character, which TOML wants escaped.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
