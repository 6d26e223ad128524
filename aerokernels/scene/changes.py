"""Change keys of a scene, as sweeps do, and find the unit and plainest value of a key."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.units import quantity, si_unit
from aerokernels.scene.errors import SceneError, scene_error
from aerokernels.scene.loading import override, toml_value
from aerokernels.scene.scene import Scene
from aerokernels.scene.values import dimension_of


def changed_scene(scene: Scene | str | Path, changes: Mapping[str, Any]) -> Scene:
    """Return a scene with other values by dotted key, checked as a scene file is."""
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


_LASER = ("atmosphere", "beam", "detector", "strehl", "target")
_STEPS = ("trace.allow_truncation", "trace.max_steps", "trace.method", "trace.step")
# Tables and keys that change no number of a command. The field of `strehl` includes the lines to the target.
UNUSED = {
    "run": ("series",),
    "strehl": ("atmosphere", "detector", "series"),
    "schlieren": (*_LASER, "pupil", "receiver", "series", *_STEPS),
    "series": (*_LASER, "flow.source", "flow.density", "flow.interpolation", "grid", *_STEPS),
}


def warn_of_unused(scene: Scene, command: str) -> None:
    """Warn in one line of the tables and keys that differ from their defaults without an effect on the command.

    A scene without a flow is refused where the flow is read, in one line as well.
    """
    if scene.flow.source is None and command != "series":
        return
    idle = [f"[{name}]" if "." not in name else name for name in UNUSED[command] if _is_set(scene, name)]
    if idle:
        warn_caller(f"{scene.name}: {', '.join(idle)} {'has' if len(idle) == 1 else 'have'} no effect here")


def _is_set(scene: Scene, name: str) -> bool:
    """Whether a table, or a key of a table, differs from its default."""
    table, _, leaf = name.partition(".")
    model: BaseModel = getattr(scene, table)
    if not leaf:
        return model != type(model)()
    return getattr(model, leaf) not in (None, type(model).model_fields[leaf].get_default())
