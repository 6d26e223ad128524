"""Find the physical dimension of a scene's key in the annotations of its model."""

import typing
from typing import Any

from pydantic import BaseModel, BeforeValidator


def dimension_of(model: Any, key: str) -> str | None:
    """Return a dotted key's dimension, "angle" for "target.tilt"; None if it has no dimension or is unknown."""
    *tables, leaf = key.split(".")
    for name in tables:
        field = getattr(model, "model_fields", {}).get(name)
        model = field.annotation if field is not None else None
    field = getattr(model, "model_fields", {}).get(leaf) if model is not None else None
    if field is None or (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
        return None
    return next(iter(_dimensions([*field.metadata, field.annotation])), None)


def _dimensions(parts: list[Any]) -> list[str]:
    """Collect the dimensions of the validators in an annotation's parts, nested parts included."""
    found = []
    for part in parts:
        if isinstance(part, BeforeValidator):
            found += [name for name in [getattr(part.func, "dimension", None)] if name]
        elif typing.get_args(part):
            found += _dimensions([*typing.get_args(part), *getattr(part, "__metadata__", ())])
    return found
