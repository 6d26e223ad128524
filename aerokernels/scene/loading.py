"""Find and read a scene file, set single keys, and say what is wrong: one line with file, key, value and remedy."""

import json
import math
import os
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from aerokernels.display.plain_text import cut
from aerokernels.flow.shipped import shipped_names
from aerokernels.inputs.units import quantity, si_unit
from aerokernels.scene.values import dimension_of

_SHIPPED = files("aerokernels") / "scenes"
_COMMON = _SHIPPED / "common" / "laser_rangefinder.toml"  # the tables from [beam] on, which end every shipped scene
CHANGED = "-changed"  # ends the name of a scene whose values were changed


def shipped_scenes() -> tuple[str, ...]:
    """Return the names of the scenes that ship with the package."""
    return tuple(
        sorted(entry.name.removesuffix(".toml") for entry in _SHIPPED.iterdir() if entry.name.endswith(".toml"))
    )


def shipped_scene_text(name: str) -> str:
    """Return the text of a shipped scene, with its comments."""
    if name not in shipped_scenes():
        close = get_close_matches(name, shipped_scenes(), 1)
        hint = f"did you mean {close[0]}? " if close else ""
        raise SceneError(f"{name}: there is no such shipped scene; {hint}choose one of {', '.join(shipped_scenes())}")
    return "\n".join(part.read_text(encoding="utf-8") for part in (_SHIPPED / f"{name}.toml", _COMMON))


def read_summary(place: Path) -> dict[str, Any]:
    """Return the values of the scene in a run's summary.json, without those that are not set."""
    try:
        text = place.read_text(encoding="utf-8")
        result = json.loads(text, object_pairs_hook=lambda pairs: {key: one for key, one in pairs if one is not None})
        return dict(result["scene_values"])
    except OSError as fault:
        raise SceneError(f"{place}: cannot be read, {fault.strerror}: give the summary.json of a run") from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise SceneError(f"{place}: holds no values of a scene: give the summary.json of a run") from None


def read_scene(place: str | Path) -> tuple[str, str, dict[str, Any]]:
    """Read a scene file, a run's summary.json, a shipped scene by its name, or, for "-", the scene on standard input.

    Returns:
        The source's name for messages, the scene's default name, and its tables.
    """
    path, name = Path(place), str(place)
    if path.suffix == ".json":
        return name, path.parent.name, read_summary(path)
    if name == "-":
        read, label, stem = sys.stdin.buffer.read, "standard input", "scene"
    elif os.path.isfile(path):
        read, label, stem = path.read_bytes, str(path), path.stem
    elif name in shipped_scenes():
        read, label, stem = shipped_scene_text(name).encode, f"{name}.toml", name
    else:
        close = get_close_matches(name, shipped_scenes(), 1) or [one for one in shipped_scenes() if name in one]
        hint = f"did you mean {' or '.join(close)}? " if close and name else ""
        hint = f"it is the name of a flow, not of a scene; {hint}" if name in shipped_names() and hint else hint
        what = "is a folder" if os.path.isdir(path) else "there is no such scene file"
        raise SceneError(f"{name}: {what}; {hint}give a TOML file or a shipped scene: {', '.join(shipped_scenes())}")
    try:
        tables = tomllib.loads(read().decode("utf-8-sig"))  # Windows editors may write a byte-order mark
        repr(tables)  # what no message can show is refused here
        return label, stem, tables
    except OSError as fault:
        raise SceneError(f"{label}: cannot be read, {fault.strerror}: check the file and its permissions") from None
    except UnicodeDecodeError as fault:
        raise SceneError(f"{label}: byte {fault.start} is not UTF-8: save the scene as UTF-8 text") from None
    except RecursionError:
        raise SceneError(f"{label}: tables and lists are nested too deeply") from None
    except ValueError as fault:
        raise SceneError(
            f'{label}: not valid TOML, {fault}: write key = value, and texts such as "1.5 m" in quotes'
        ) from None


def resolve_paths(tables: dict[str, Any], place: str | Path) -> None:
    """Resolve paths in a scene file relative to the file; names of shipped flows and absolute paths stay unchanged.

    Paths in changes are applied afterwards and are relative to the working directory.
    """
    if not os.path.isfile(place) or str(place).endswith(".json"):  # the paths in a summary are resolved
        return
    flow, series, folder = tables.get("flow"), tables.get("series"), Path(place).parent
    file = flow.get("file") if isinstance(flow, dict) else None
    for table, key in ((flow, "source"), (file, "mesh"), (file, "solution")):
        if isinstance(table, dict) and isinstance(value := table.get(key), str):
            path = folder / os.path.expanduser(value)
            # os.path.exists accepts a name of any length. Otherwise an error shows the path as it was written.
            if value not in (*shipped_names(), "static", "cone") and os.path.exists(path):
                table[key] = str(path.resolve())
    if isinstance(series, dict) and isinstance(series.get("source"), str):  # which may be a pattern of file names
        series["source"] = str(folder / series["source"])


def override(tables: dict[str, Any], overrides: Mapping[str, Any], label: str) -> None:
    """Set dotted keys in the tables, and tell so in name and title. A text that is a TOML value is parsed."""
    for key, value in overrides.items():
        *path, leaf = str(key).strip().split(".")
        if not all(part.strip() for part in (*path, leaf)):
            raise SceneError(
                f"{label} (changed): {key!r} is not a key: write table.key=value, as in target.distance=1.2"
            )
        table = tables
        for depth, part in enumerate(path):
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                held = ".".join(path[: depth + 1])
                raise SceneError(
                    f"{label} (changed): {key} = {value!r}: {held} is a value, not a table; set {held} itself"
                )
        table[leaf] = toml_value(value) if isinstance(value, str) else value
    words, name = changes_in_words(overrides), tables.get("name")
    title = tables.get("title") or name
    if words and "title" not in overrides and isinstance(title, str):
        tables["title"] = title + words
    if words and "name" not in overrides and isinstance(name, str):
        tables["name"] = f"{name.removesuffix(CHANGED)}{CHANGED}"


def changes_in_words(changes: Mapping[str, Any]) -> str:
    """Return the changes that make another scene, ", with target.distance = 2 m"; how it is computed is left out."""
    changed = [
        f"{key} = {cut(str(value))}"
        for key, value in changes.items()
        if not (key.startswith("trace.") or key.endswith("ray_count") or key in ("name", "title"))
    ]
    return f", with {', '.join(changed)}" if changed else ""


def toml_value(text: str) -> Any:
    """Parse a text as a TOML value, or return it unchanged if it is none: "1e-4" is a number, "10 deg" a text."""
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return parsed["value"] if list(parsed) == ["value"] else text


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
        text = cut(repr(value))
        if unit == " rad" and isinstance(value, str) and value.strip().endswith(("deg", "°")):
            limit = f"{math.degrees(bound):.4g} deg"
        if unit == " rad" and isinstance(value, str) and value.endswith("rad"):
            text = f"{quantity(value, 'angle'):.6g} rad ({math.degrees(quantity(value, 'angle')):.6g} deg)"
            hint = "; a number without a unit is in radians, and '30 deg' is in degrees"
        return f"{key} = {text} must be {words} {limit}{hint}"
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
