"""Which quantity a key of a scene takes, out of its model."""

import typing
from typing import Any

from pydantic import BaseModel, BeforeValidator


def dimension_of(model: Any, key: str) -> str | None:
    """The dimension of a dotted key, "angle" for "target.tilt"; None for a key that takes no quantity, or for none."""
    *tables, leaf = key.split(".")
    for name in tables:
        field = getattr(model, "model_fields", {}).get(name)
        model = field.annotation if field is not None else None
    field = getattr(model, "model_fields", {}).get(leaf) if model is not None else None
    if field is None or (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
        return None
    return next(iter(_dimensions([*field.metadata, field.annotation])), None)


def _dimensions(parts: list[Any]) -> list[str]:
    """Dimensions of the validators among an annotation's parts, those of its own parts included."""
    found = []
    for part in parts:
        if isinstance(part, BeforeValidator):
            found += [name for name in [getattr(part.func, "dimension", None)] if name]
        elif typing.get_args(part):
            found += _dimensions([*typing.get_args(part), *getattr(part, "__metadata__", ())])
    return found
