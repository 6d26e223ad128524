"""Define a sweep: the scene, the keys that vary, and the resulting cases.

A "grid" is every combination of values, one dimension per key, the last key fastest. "zip" takes the first value of
each key, then the second of each, and so on. "lhs:N" is a random Latin hypercube of N cases between two numbers per
key: each of N equal slices of every key's range holds exactly one case.
"""

import hashlib
import itertools
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels import __version__
from aerokernels.flow.reading.formats import files_behind
from aerokernels.jobs.store import to_json
from aerokernels.scene import Scene, SceneError
from aerokernels.scene.changes import changed_scene, key_unit, key_value, with_units

FORMAT = 1
MOST_CASES = 100_000
CASE = "case"  # the dimension of a sweep in mode "zip" or "lhs"


@dataclass(frozen=True)
class Definition:
    """A requested sweep.

    Attributes:
        scene: The scene, the path of its TOML file, or the name of a shipped one.
        settings: Changes to the scene for all cases, by dotted key.
        vary: Values by dotted key, in their plainest form: quantities as SI numbers.
        mode: "grid", "zip" or "lhs".
        sample_count: Cases of a Latin hypercube.
        seed: Seed of the Latin hypercube.
    """

    scene: Scene | str | Path
    settings: Mapping[str, Any]
    vary: Mapping[str, tuple[Any, ...]]
    mode: str = "grid"
    sample_count: int = 0
    seed: int = 0

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
        if self.mode == "grid":
            return tuple(len(values) for values in self.vary.values())
        return (self.sample_count if self.mode == "lhs" else len(next(iter(self.vary.values()))),)

    @property
    def case_count(self) -> int:
        """Number of cases."""
        return math.prod(self.shape)

    def columns(self) -> dict[str, list[Any]]:
        """Return each key's values along its dimension: the given values for a grid, one value per case otherwise."""
        if self.mode != "lhs":
            return {key: list(values) for key, values in self.vary.items()}
        from scipy.stats import qmc

        draw = qmc.LatinHypercube(len(self.vary), seed=self.seed).random(self.sample_count)
        return {key: _between(key, values, draw[:, k]) for k, (key, values) in enumerate(self.vary.items())}

    def cases(self) -> list[dict[str, Any]]:
        """Return the changes that each case makes to the scene, the last key fastest."""
        columns = self.columns().values()
        rows = itertools.product(*columns) if self.mode == "grid" else zip(*columns, strict=True)
        return [dict(zip(self.keys, row, strict=True)) for row in rows]

    def load(self, changes: Mapping[str, Any]) -> Scene:
        """Load the scene of a case.

        Raises:
            SceneError: The scene rejects these values.
        """
        found = changed_scene(self.scene, {**self.settings, **with_units(changes)})
        try:
            _ = found.flow_source
        except ValueError as fault:
            raise SceneError(f"{getattr(self.scene, 'name', self.scene)}: {fault}") from None
        return found

    def described(self) -> dict[str, Any]:
        """Return everything that the numbers depend on, as plain JSON types: sweeps that agree in it are the same.

        Raises:
            SceneError: No case has a valid scene.
        """
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
                "format": FORMAT,
                "version": __version__,
                "scene": base,
                "content": content_hashes(files),
                "vary": self.vary,
                "mode": self.mode,
                "sample_count": self.sample_count,
                "seed": self.seed if self.mode == "lhs" else 0,
            }
        )

    def _first_scene(self) -> Scene:
        """Load the scene of the first case that has a valid one."""
        fault = None
        for changes in self.cases():
            try:
                return self.load(changes)
            except SceneError as found:
                fault = fault or found
        assert fault is not None  # there is at least one case
        raise fault


def define(
    scene: Scene | str | Path,
    vary: Mapping[str, Iterable[Any]],
    *,
    settings: Mapping[str, Any] | None = None,
    together: bool = False,
    sample: str | int | None = None,
    seed: int = 0,
) -> Definition:
    """Check a request and make the sweep's definition.

    Args:
        scene: The scene, the path of its TOML file, or the name of a shipped one.
        vary: Values by dotted key: numbers in SI units, or texts with a unit such as "905 nm".
        settings: Changes to the scene for all cases.
        together: Whether the keys take their values in parallel ("zip") instead of in every combination.
        sample: "lhs:N", or N: a Latin hypercube of N cases between the two numbers of each key.
        seed: Seed of the Latin hypercube.

    Raises:
        TypeError: `vary` is not a mapping, or a value is not a number, text or list.
        ValueError: Nothing to vary, a key without values or with a repeated value, keys of unequal counts to zip, a
            key without a range to sample, or too many cases.
    """
    if not isinstance(scene, (Scene, str, Path)):
        raise TypeError(f"scene must be a Scene, a path or a shipped scene's name, got {type(scene).__name__}")
    if not isinstance(vary, Mapping):
        raise TypeError(f"vary must map keys to values, as in {{'target.tilt': [0.0, 0.1]}}, got {type(vary).__name__}")
    if not vary:
        raise ValueError("nothing to vary: give keys with values, such as target.tilt with '0 deg' and '10 deg'")
    settings = dict(settings or {})
    axes = {str(key).strip(): _values(str(key).strip(), values) for key, values in vary.items()}
    for key in axes:
        if key in settings:
            raise ValueError(f"{key} is both set and varied: drop one of the two")
    if str(scene) == "-":  # standard input, which can be read only once
        scene = changed_scene(scene, {**settings, **with_units({key: values[0] for key, values in axes.items()})})
    if together and sample is not None:
        raise ValueError("zip and sample exclude each other: a Latin hypercube chooses its values itself; give one")
    if sample is not None:
        definition = Definition(scene, settings, axes, "lhs", _sample_count(sample), int(seed))
        for key, values in axes.items():
            _check_range(key, values)
    else:
        for key, values in axes.items():
            _check_distinct(key, values, together)
        counts = {key: len(values) for key, values in axes.items()}
        if together and len(set(counts.values())) > 1:
            described = ", ".join(f"{key} has {count}" for key, count in counts.items())
            raise ValueError(
                f"zip needs equally many values of each key: {described}; make them equal, or leave zip out"
            )
        definition = Definition(scene, settings, axes, "zip" if together else "grid")
    if definition.case_count > MOST_CASES:
        raise ValueError(
            f"vary {', '.join(axes)}: {definition.case_count:,} cases are more than {MOST_CASES:,}; vary fewer "
            "values, or use a random sample, lhs:N"
        )
    return definition


def checked_scenes(definition: Definition) -> tuple[list[Scene | None], dict[int, str]]:
    """Return the scene of each case, and for each case without a valid scene the reason.

    A value that gives no valid scene in any case is an error. A combination without a valid scene, of values that are
    valid in other combinations, is a failed case.

    Raises:
        SceneError: A value is not valid in any case.
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


def coordinates(definition: Definition, scenes: Sequence[Scene | None]) -> dict[str, tuple[str, np.ndarray, str]]:
    """Return dimension, values and unit of each key's coordinate: numbers if all values are numbers, else texts."""
    found = {}
    for key, values in definition.columns().items():
        numbers = all(map(_is_number, values))
        array = np.array(values) if numbers else np.array([_written(value) for value in values], dtype=object)
        found[key] = (key if definition.mode == "grid" else CASE, array, key_unit(key) if numbers else "1")
    return found


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


def _check_distinct(key: str, values: Sequence[Any], together: bool) -> None:
    seen = set()
    for value in values:
        if repr(value) in seen and not together:
            raise ValueError(f"vary {key}: {_written(value)} is given twice; drop one of them")
        seen.add(repr(value))


def _check_range(key: str, values: Sequence[Any]) -> None:
    """Reject values that are neither the two ends of a range nor texts to choose from."""
    if not any(map(_is_number, values)):
        return
    if len(values) != 2 or not all(map(_is_number, values)) or not values[0] < values[1]:
        described = ",".join(map(_written, values))
        raise ValueError(f"vary {key} = {described}: a sample needs the two ends of a range, low and high")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _between(key: str, values: Sequence[Any], places: np.ndarray) -> list[Any]:
    """Map places in [0, 1) to values of a key: between its two numbers, or one of its texts."""
    if not all(map(_is_number, values)):
        return [values[int(place * len(values))] for place in places]
    low, high = values
    if isinstance(low, int) and isinstance(high, int) and key_unit(key) == "1":
        return [low + int(place * (high - low + 1)) for place in places]  # whole numbers, both ends included
    return [float(low + place * (high - low)) for place in places]


def _sample_count(sample: str | int) -> int:
    text = str(sample)
    count = text.removeprefix("lhs:")
    if isinstance(sample, bool) or not (count.isdecimal() and len(count) < 18) or int(count) < 1:
        raise ValueError(f"sample {text}: write lhs:N for N cases, such as lhs:64")
    return int(count)


def _written(value: Any) -> str:
    return value if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)


def content_hashes(sources: Iterable[Any]) -> dict[str, str]:
    """Return a hash of the content for each of the texts that names a file or a folder.

    The content is that of all files that are read with it: the pieces that it names, the mesh beside it, a whole case.
    """
    found = {}
    for source in sources:
        path = Path(source) if isinstance(source, (str, Path)) and str(source) else None
        if path is not None and path.exists():
            found[str(source)] = _content_hash(path)
    return found


def _content_hash(path: Path) -> str:
    whole = hashlib.sha256()
    for file in files_behind(path):
        whole.update(f"{os.path.relpath(file, path) if file != path else ''}\n".encode(errors="surrogateescape"))
        with file.open("rb") as data:
            whole.update(hashlib.file_digest(data, "sha256").digest())
    return whole.hexdigest()[:32]
