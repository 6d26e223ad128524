"""Errors of a scene as one line that names the file, the key, the offending value and the remedy."""

import math
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError

from aerokernels.display.plain_text import cut
from aerokernels.inputs.units import si_unit
from aerokernels.scene.values import dimension_of


class SceneError(ValueError):
    """A scene that cannot be used. The message is one line that names the file, the key, the value and the remedy."""

    def __init__(self, message: str):
        """Keep the message on one line."""
        super().__init__(" ".join(message.split()))


def known_keys(model: type[BaseModel], prefix: str = "") -> tuple[str, ...]:
    """Dotted names of all keys of a scene, such as "target.distance"."""
    keys: list[str] = []
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            keys += known_keys(field.annotation, f"{prefix}{name}.")
        else:
            keys.append(prefix + name)
    return tuple(keys)


def scene_error(
    fault: ValidationError, raw: Mapping, file: str, overridden: Iterable[str], model: type[BaseModel]
) -> SceneError:
    """Turn pydantic's first fault into a SceneError that also says how many more there are."""
    faults = fault.errors(include_url=False)
    # Report an unknown key first: other faults, such as a key that seems to be missing, may follow from it.
    first = next((entry for entry in faults if entry["type"] == "extra_forbidden"), faults[0])
    key = ".".join(str(part) for part in first["loc"])
    while key and key not in known_keys(model) and first["type"] not in ("extra_forbidden", "model_type", "missing"):
        shorter = key.rpartition(".")[0]  # for an entry of a list, name the key that holds the list
        if not shorter or shorter not in known_keys(model):
            break
        key = shorter
    value = _value_at(raw, key)
    related = any(f"{key}.".startswith(f"{name}.") or f"{name}.".startswith(f"{key}.") for name in overridden)
    place = f"{file} (changed)" if related else file
    further = len(faults) - 1
    more = f" (and {further} more {'fault' if further == 1 else 'faults'})" if further else ""
    return SceneError(f"{place}: {_describe(first, key, value, model)}{more}")


def _describe(fault: Mapping[str, Any], key: str, value: Any, model: type[BaseModel]) -> str:
    kind, context = fault["type"], fault.get("ctx", {})
    if kind == "extra_forbidden":
        return f"unknown key {key} = {cut(repr(value))}: {_nearest_key(key, known_keys(model), model)}"
    if kind == "missing":
        return f"{key} is missing: {_how_to_add(key, model)}"
    if kind == "model_type":
        return f"{key} = {cut(repr(value))} must be a table: write [{key}] and its keys below it"
    if kind == "literal_error":
        return f"{key} = {cut(repr(value))}: choose one of {context['expected']}"
    if kind == "value_error":
        text = str(context["error"])
        if isinstance(value, Mapping) and key not in known_keys(model):
            return text  # this message names the keys itself
        return f"{key} = {text}" if text.startswith(f"{value!r} ") else f"{key} = {cut(repr(value))}: {text}"
    bounds = {
        "greater_than": ("gt", "above"),
        "greater_than_equal": ("ge", "at least"),
        "less_than": ("lt", "below"),
        "less_than_equal": ("le", "at most"),
    }
    if kind in bounds:
        name, words = bounds[kind]
        bound = context[name]
        dimension = dimension_of(model, key)
        unit = f" {si_unit(dimension)}".rstrip() if dimension else ""
        bare = isinstance(value, (int, float)) or (isinstance(value, str) and value[-1:].isdigit())
        hint = f"; a number without a unit is in radians: is it '{value} deg'?" if bare and unit == " rad" else ""
        limit = f"{bound:g}{unit}" + (f" ({math.degrees(bound):.4g} deg)" if unit == " rad" else "")
        return f"{key} = {cut(repr(value))} must be {words} {limit}{hint}"
    if kind in ("tuple_type", "list_type"):
        return f'{key} = {cut(repr(value))}: write a list in brackets, such as ["piston"]'
    text = fault["msg"]
    return f"{key} = {cut(repr(value))}: {text[:1].lower()}{text[1:]}"


def _how_to_add(key: str, model: type[BaseModel]) -> str:
    field = model.model_fields.get(key)
    if field is None or not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
        return "add it to the scene"
    required = [name for name, inner in field.annotation.model_fields.items() if inner.is_required()]
    return f"add a table [{key}] with {', '.join(required)}"


def _nearest_key(key: str, known: Sequence[str], model: type[BaseModel]) -> str:
    table, _, leaf = key.rpartition(".")
    same_leaf = [name for name in known if name.rpartition(".")[2] == leaf]
    siblings = [name for name in known if name.rpartition(".")[0] == table]
    close = get_close_matches(leaf, [name.rpartition(".")[2] for name in siblings], 1)
    tables = get_close_matches(key, list(model.model_fields), 1)
    if same_leaf:
        here = ", ".join(name.rpartition(".")[2] for name in siblings) if table else ""
        return f"did you mean {' or '.join(same_leaf)}?" + (f" [{table}] has {here}" if here else "")
    if close:
        return f"did you mean {table}.{close[0]}?" if table else f"did you mean {close[0]}?"
    if not table and tables:
        return f"did you mean {tables[0]}?"
    dotted = get_close_matches(key, known, 1)
    if dotted and not siblings:
        return f"did you mean {dotted[0]}?"
    names = [name.rpartition(".")[2] for name in siblings] if table else list(model.model_fields)
    return f"known keys here are {', '.join(names)}"


def _value_at(raw: Any, key: str) -> Any:
    for part in key.split(".") if key else ():
        if isinstance(raw, Mapping):
            raw = raw.get(part)
        else:
            break
    return raw
