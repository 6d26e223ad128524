"""Change keys of a scene, as sweeps do, and find the unit and plainest value of a key."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from aerokernels.inputs.units import quantity, si_unit
from aerokernels.scene.errors import SceneError, scene_error
from aerokernels.scene.key_units import dimension_of
from aerokernels.scene.loading import override, toml_value
from aerokernels.scene.scene import Scene


def changed_scene(scene: Scene | str | Path, changes: Mapping[str, Any]) -> Scene:
    """Return a scene with other values for some of its keys, checked as a scene file is.

    Args:
        scene: The scene, the path of its TOML file, or the name of a shipped one.
        changes: Values by dotted key, as `Scene.load` takes them.

    Raises:
        SceneError: Anything wrong with the file or the changes, in one line.
    """
    if not isinstance(scene, Scene):
        return Scene.load(scene, changes)
    tables = _without_none(scene.model_dump(mode="json", exclude_unset=True))
    override(tables, changes, scene.name)
    try:
        return Scene.model_validate(tables)
    except ValidationError as fault:
        raise scene_error(fault, tables, scene.name, changes, Scene) from None


def key_dimension(key: str) -> str | None:
    """Return a key's dimension, "angle" for "target.tilt"; None for a key without a dimension or an unknown key."""
    return dimension_of(Scene, key)


def key_unit(key: str) -> str:
    """Return the SI unit of a scene's key; "1" for a key without a dimension or a dimensionless number."""
    dimension = key_dimension(key)
    return (si_unit(dimension) or "1") if dimension else "1"


def key_value(key: str, value: Any) -> Any:
    """Return a key's value in its plainest form: a quantity as an SI number, a TOML text as the value it denotes.

    The scene, not this function, checks whether the key accepts the value.
    """
    if isinstance(value, str):
        dimension = key_dimension(key)
        if dimension is not None:
            try:
                return quantity(value, dimension)
            except ValueError:
                return value  # a word such as "tunnel", or an invalid value that the scene rejects
        return toml_value(value)
    return value


def with_units(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Write the SI numbers of quantities as texts such as "0.2 rad", so that an error about a value shows its unit."""
    found = dict(changes)
    for key, value in changes.items():
        unit = key_unit(key)
        if unit != "1" and isinstance(value, (int, float)) and not isinstance(value, bool):
            found[key] = f"{float(value)!r} {unit}"
    return found


def _without_none(values: Mapping[str, Any]) -> dict[str, Any]:
    """Drop keys without a value: TOML has no null, and an absent key means the same."""
    return {
        key: _without_none(value) if isinstance(value, Mapping) else value
        for key, value in values.items()
        if value is not None
    }


__all__ = ["SceneError", "changed_scene", "key_dimension", "key_unit", "key_value", "with_units"]
