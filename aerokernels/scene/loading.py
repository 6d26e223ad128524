"""Find and read a scene file, and set single keys from the command line."""

import os
import sys
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any

from aerokernels.display.plain_text import cut
from aerokernels.flow.shipped import shipped_names
from aerokernels.scene.errors import SceneError

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


def read_scene(place: str | Path) -> tuple[str, str, dict[str, Any]]:
    """Read a scene file, a shipped scene by its name, or, for "-", the scene on standard input.

    Returns:
        The source's name for messages, the scene's default name, and its tables.
    """
    path, name = Path(place), str(place)
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
    if not os.path.isfile(place):
        return
    flow, series, folder = tables.get("flow"), tables.get("series"), Path(place).parent
    file = flow.get("file") if isinstance(flow, dict) else None
    for table, key in ((flow, "source"), (file, "mesh"), (file, "solution")):
        if isinstance(table, dict) and isinstance(value := table.get(key), str):
            path = folder / os.path.expanduser(value)
            # os.path.exists accepts a name of any length. Otherwise an error shows the path as it was written.
            if value not in (*shipped_names(), "static") and os.path.exists(path):
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
    told = [
        f"{key} = {cut(str(value))}"
        for key, value in changes.items()
        if not (key.startswith("trace.") or key.endswith("ray_count") or key in ("name", "title"))
    ]
    return f", with {', '.join(told)}" if told else ""


def toml_value(text: str) -> Any:
    """Parse a text as a TOML value, or return it unchanged if it is none: "1e-4" is a number, "10 deg" a text."""
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return parsed["value"] if list(parsed) == ["value"] else text
