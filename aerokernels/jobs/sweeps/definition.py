"""Define a sweep: the scene, the keys that vary, and the resulting cases.

A "grid" is every combination of values, one dimension per key, the last key fastest. "zip" takes the first value of
each key, then the second of each, and so on.
"""

import contextlib
import hashlib
import itertools
import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels import __version__
from aerokernels.flow.reading.formats import files_behind
from aerokernels.inputs.kinds import is_number, wrong_kind
from aerokernels.jobs.store import to_json
from aerokernels.scene import Scene, SceneError
from aerokernels.scene.scene import changed_scene, key_unit, key_value, with_units

MOST_CASES = 100_000
CASE = "case"  # the dimension of a sweep in mode "zip"


@dataclass(frozen=True)
class Definition:
    """A requested sweep."""

    scene: Scene | str | Path  # the scene, the path of its TOML file, or the name of a shipped one
    settings: Mapping[str, Any]  # changes to the scene for all cases, by dotted key
    vary: Mapping[str, tuple[Any, ...]]  # values by dotted key, in their plainest form: quantities as SI numbers
    mode: str = "grid"  # "grid" or "zip"

    @property
    def label(self) -> str:
        """The scene's name, or its file's without the ending."""
        return self.scene.name if isinstance(self.scene, Scene) else Path(self.scene).stem

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that vary, in the order given."""
        return tuple(self.vary)

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the dataset."""
        return self.keys if self.mode == "grid" else (CASE,)

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the dimensions."""
        counts = tuple(len(values) for values in self.vary.values())
        return counts if self.mode == "grid" else counts[:1]

    @property
    def case_count(self) -> int:
        """Number of cases."""
        return math.prod(self.shape)

    def cases(self) -> list[dict[str, Any]]:
        """Return the changes that each case makes to the scene, the last key fastest."""
        columns = self.vary.values()
        rows = itertools.product(*columns) if self.mode == "grid" else zip(*columns, strict=True)
        return [dict(zip(self.keys, row, strict=True)) for row in rows]

    def load(self, changes: Mapping[str, Any]) -> Scene:
        """Load the scene of a case."""
        result = changed_scene(self.scene, {**self.settings, **with_units(changes)})
        try:
            _ = result.flow_source
        except ValueError as fault:
            raise SceneError(f"{getattr(self.scene, 'name', self.scene)}: {fault}") from None
        return result

    def described(self) -> dict[str, Any]:
        """Return everything that the numbers depend on, as plain JSON types: sweeps that agree in it are the same."""
        scene = self._first_scene()
        files = [scene.flow.source, scene.flow.file.mesh, scene.flow.file.solution]
        for key in ("flow.source", "flow.file.mesh", "flow.file.solution"):
            files += self.vary.get(key, ())
        base = {name: dict(part) for name, part in scene.as_dict().items() if isinstance(part, dict)}  # no title
        for key in self.keys:
            *tables, leaf = key.split(".")
            table = base
            for name in tables:
                table = table.get(name, {})
            table.pop(leaf, None)
        return to_json(
            {
                "format": 1,
                "version": __version__,
                "scene": base,
                "content": content_hashes(files),
                "vary": self.vary,
                "mode": self.mode,
            }
        )

    def _first_scene(self) -> Scene:
        """Load the scene of the first case that has a valid one."""
        *cases, last = self.cases()
        for changes in cases:
            with contextlib.suppress(SceneError):
                return self.load(changes)
        return self.load(last)


def define(
    scene: Scene | str | Path,
    vary: Mapping[str, Iterable[Any]],
    *,
    settings: Mapping[str, Any] | None = None,
    together: bool = False,
) -> Definition:
    """Check a request and make the sweep's definition; arguments as for `sweep`, whose `zip` is `together`."""
    if not isinstance(scene, (Scene, str, Path)):
        raise wrong_kind(scene, "scene", "a Scene, a path or a shipped scene's name")
    if not isinstance(vary, Mapping):
        raise TypeError(f"vary must map keys to values, as in {{'target.tilt': [0.0, 0.1]}}, got {type(vary).__name__}")
    if not vary:
        raise ValueError("nothing to vary: give keys with values, such as target.tilt with '0 deg' and '10 deg'")
    settings = dict(settings or {})
    axes = {str(key).strip(): _values(str(key).strip(), values) for key, values in vary.items()}
    for key, values in axes.items():
        if key in settings:
            raise ValueError(f"{key} is both set and varied: drop one of the two")
        (value, count), *_ = Counter(map(repr, values)).most_common(1)
        if count > 1 and not together:
            raise ValueError(f"vary {key}: {value} is given twice; drop one of them")
    if str(scene) == "-":  # standard input, which can be read only once
        scene = changed_scene(scene, {**settings, **with_units({key: values[0] for key, values in axes.items()})})
    counts = {key: len(values) for key, values in axes.items()}
    if together and len(set(counts.values())) > 1:
        described = ", ".join(f"{key} has {count}" for key, count in counts.items())
        raise ValueError(f"zip needs equally many values of each key: {described}; make them equal, or leave zip out")
    definition = Definition(scene, settings, axes, "zip" if together else "grid")
    if definition.case_count > MOST_CASES:
        raise ValueError(
            f"vary {', '.join(axes)}: {definition.case_count:,} cases are more than {MOST_CASES:,}; vary fewer values"
        )
    return definition


def checked_scenes(definition: Definition) -> tuple[list[Scene | None], dict[int, str]]:
    """Return the scene of each case, and for each case without a valid scene the reason.

    A value that gives no valid scene in any case is an error. A combination without a valid scene, of values that are
    valid in other combinations, is a failed case.
    """
    scenes: list[Scene | None] = []
    faults: dict[int, str] = {}
    cases = definition.cases()
    for index, changes in enumerate(cases):
        try:
            scenes.append(definition.load(changes))
        except SceneError as fault:
            scenes.append(None)
            faults[index] = str(fault)
    good = [{(key, repr(value)) for key, value in cases[k].items()} for k in range(len(cases)) if k not in faults]
    taken = set().union(*good) if good else set()
    for index, text in faults.items():
        if any((key, repr(value)) not in taken for key, value in cases[index].items()):
            raise SceneError(text)
    return scenes, faults


def coordinates(definition: Definition) -> dict[str, tuple[str, np.ndarray, str]]:
    """Return dimension, values and unit of each key's coordinate: numbers if all values are numbers, else texts."""
    result = {}
    for key, values in definition.vary.items():
        numbers = all(map(is_number, values))
        array = np.array(values) if numbers else np.array(list(map(str, values)), dtype=object)
        result[key] = (key if definition.mode == "grid" else CASE, array, key_unit(key) if numbers else "1")
    return result


def _values(key: str, values: Any) -> tuple[Any, ...]:
    """Return the values of a key in their plainest form."""
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise TypeError(f"vary[{key!r}] must be a list of values, got {values!r}: write [{values!r}]")
    plainly = []
    for value in values:
        value = value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value
        value = str(value) if isinstance(value, Path) else list(value) if isinstance(value, tuple) else value
        if not isinstance(value, (str, bool, int, float, list)):
            raise TypeError(f"vary[{key!r}]: {value!r} is not a number, text or list")
        if value == "":
            raise ValueError(f"vary {key}: an empty value; leave it out")
        plainly.append(key_value(key, value))
    if not plainly:
        raise ValueError(f"vary {key}: no values; give at least one")
    return tuple(plainly)


def content_hashes(sources: Iterable[Any]) -> dict[str, str]:
    """Return a hash of the content for each of the texts that names a file or a folder.

    The content is that of all files that are read with it: the pieces that it names, the mesh beside it, a whole case.
    """
    result = {}
    for source in sources:
        path = Path(source) if isinstance(source, (str, Path)) and str(source) else None
        if path is not None and path.exists():
            result[str(source)] = _content_hash(path)
    return result


def _content_hash(path: Path) -> str:
    whole = hashlib.sha256()
    for file in files_behind(path):
        whole.update(f"{os.path.relpath(file, path) if file != path else ''}\n".encode(errors="surrogateescape"))
        with file.open("rb") as data:
            whole.update(hashlib.file_digest(data, "sha256").digest())
    return whole.hexdigest()[:32]
