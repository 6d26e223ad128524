"""Write a scene as it was run as TOML in SI units, which is stored with every result."""

import json
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
    # JSON texts, numbers and lists are valid TOML too; TOML has no null, and an absent key means the same.
    return "\n".join(f"{key} = {_value(value)}" for key, value in values.items() if value is not None)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_value(own)}" for key, own in value.items() if own is not None) + "}"
    return json.dumps(value, ensure_ascii=False)
