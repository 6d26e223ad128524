"""The page of a scene's keys, made from the models that check them: every table, every key, type, unit, default, meaning."""

import re
import types
import typing
from typing import Any, Literal

from pydantic import BaseModel
from pydantic_core import PydanticUndefined


def tables() -> dict[str, type[BaseModel]]:
    """Every table of a scene by its dotted name, "" for the top, nested ones after the one that holds them."""
    from aerokernels.scene import Scene

    return {"": Scene, **_nested(Scene, "")}


def _nested(model: type[BaseModel], before: str) -> dict[str, type[BaseModel]]:
    found: dict[str, type[BaseModel]] = {}
    for name, field in model.model_fields.items():
        inner = _table(field.annotation)
        if inner is not None:
            found[before + name] = inner
            found |= _nested(inner, f"{before}{name}.")
    return found


def keys() -> set[str]:
    """Every dotted key, tables included."""
    found = set(tables()) - {""}
    for table, model in tables().items():
        found |= {f"{table}.{name}".lstrip(".") for name in model.model_fields}
    return found


def page() -> str:
    """The page."""
    parts = [
        "# Scene\n",
        "A scene is a TOML file: some tables of keys. This page is made from the models that check a scene, so it holds every key of every "
        'table. A quantity is written with its unit, in quotes (`"905 nm"`, `"10 deg"`), or as a bare number in the SI unit of the '
        "column *unit*. Every key may be left out, except where the default says *required*; *absent* means that the key has no value "
        "unless it is given. `--set table.key=value` changes a key on the command line, and `aerokernels sweep --vary` varies it.\n",
        "The scenes that ship are written to be copied: `aerokernels scenes copy wind-tunnel-mach3`. What the keys of the echo do together is told in "
        "[The echo](../echo.md).\n",
    ]
    from aerokernels.inputs.units import si_unit
    from aerokernels.scene.scene import key_dimension

    for table, model in tables().items():
        words = re.sub(r"^\[[\w.]+\]:\s*", "", (model.__doc__ or "").strip().split("\n\n")[0]) if table else ""
        heading = f"[{table}]" if table else "Top of the file"
        parts.append(f"## {heading}\n")
        if words:
            parts.append(_text(words[0].upper() + words[1:]) + "\n")
        lines = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
        for name, field in model.model_fields.items():
            if _table(field.annotation) is not None:
                continue
            dotted = f"{table}.{name}".lstrip(".")
            dimension = key_dimension(dotted)
            unit = (si_unit(dimension) or "1") if dimension else ""
            row = [
                f"`{dotted}`",
                _type(field.annotation, dimension),
                unit,
                _default(field),
                _text(field.description or ""),
            ]
            lines.append("| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |")
        if len(lines) > 2:
            parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _table(annotation: Any) -> type[BaseModel] | None:
    for part in (annotation, *typing.get_args(annotation)):
        if isinstance(part, type) and issubclass(part, BaseModel):
            return part
    return None


def _type(annotation: Any, dimension: str | None) -> str:
    """What may stand there, in words."""
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _type(parts[0], dimension)
    if origin is Literal:
        return ", ".join(f'"{part}"' for part in parts)
    if origin in (typing.Union, types.UnionType):
        words = [_type(part, dimension) for part in parts if part is not type(None)]
        return " or ".join(dict.fromkeys(words))
    if origin in (tuple, list):
        inner = [part for part in parts if part is not Ellipsis]
        if Ellipsis in parts or origin is list:
            return f"list of {_type(inner[0], dimension)}"
        return f"{len(inner)} of {_type(inner[0], dimension)}"
    if annotation is float:
        return {None: "number", "dimensionless": "number"}.get(dimension, dimension or "number")
    return {int: "whole number", str: "text", bool: "true or false"}.get(
        annotation, getattr(annotation, "__name__", str(annotation))
    )


def _default(field: Any) -> str:
    if field.default is PydanticUndefined and field.default_factory is None:
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "absent"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (tuple, list)):
        return "`[" + ", ".join(f'"{part}"' if isinstance(part, str) else f"{part:g}" for part in value) + "]`"
    if isinstance(value, int):
        return f"`{value}`"
    return f"`{value!r}`".replace("'", '"')


def _text(text: str) -> str:
    parts = re.split(r"(`[^`]*`)", " ".join(text.split()))
    return "".join(part if n % 2 else re.sub(r"([*_<>\[\]])", r"\\\1", part) for n, part in enumerate(parts))
