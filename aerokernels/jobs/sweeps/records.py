"""Store the finished cases of a sweep, and collect them in one labelled dataset.

A folder holds sweep.json, the sweep's definition; cases.jsonl, a line for each finished case; and sweep.nc, the dataset
of all cases once all are finished. A kill at any moment leaves at most half a line at the end, which is dropped.
"""

import contextlib
import errno
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.plain_text import cut, plain_json
from aerokernels.files.writing import FULL, OutputError
from aerokernels.jobs.numbers import NUMBERS, TEXTS
from aerokernels.jobs.store import flat, number_or_nan, to_json, write_text
from aerokernels.jobs.sweeps.definition import CASE, Definition, coordinates
from aerokernels.scene import Scene

if TYPE_CHECKING:
    import xarray

DEFINITION_FILE, CASES_FILE, DATASET_FILE = "sweep.json", "cases.jsonl", "sweep.nc"
_REMEDY = "take another folder, or remove that one"


def read_definition(folder: Path) -> dict[str, Any] | None:
    """Read the definition of the sweep in a folder; return None if there is none."""
    path = folder / DEFINITION_FILE
    if not path.is_file():
        return None
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as fault:
        raise ValueError(f"out={folder}: {path.name} cannot be read ({fault}); {_REMEDY}") from None
    if not isinstance(result, dict) or "vary" not in result:
        raise ValueError(f"out={folder}: {path.name} is not that of a sweep; {_REMEDY}")
    return result


def write_definition(folder: Path, described: Mapping[str, Any]) -> None:
    """Write the definition of a sweep."""
    write_text(folder / DEFINITION_FILE, plain_json(json.dumps(described, indent=2, ensure_ascii=False)) + "\n")


def check_same(folder: Path, result: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """Reject resuming a different sweep."""
    old, new = dict(flat(result)), dict(flat(asked))
    differing = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    if not differing and list(result["vary"]) == list(asked["vary"]):
        return
    if differing and differing[0].startswith("content."):
        name = differing[0].removeprefix("content.")
        raise ValueError(f"out={folder}: {name} has changed since its sweep began; {_REMEDY}")
    if differing == ["version"]:
        raise ValueError(
            f"out={folder}: its sweep was made by aerokernels {result['version']}, this is {asked['version']}, whose "
            f"numbers may differ; {_REMEDY}"
        )
    if differing:
        key, more = differing[0], f" (and {len(differing) - 1} more differences)" if len(differing) > 1 else ""
        name = key.removeprefix("scene.").removeprefix("vary.")
        was, now = (cut(some.get(key, "absent")) for some in (old, new))
    else:
        name, more = "the order of the keys that vary", ""
        was, now = (", ".join(some["vary"]) for some in (result, asked))
    raise ValueError(f"out={folder}: it holds another sweep: {name} was {was} and is {now}{more}; {_REMEDY}")


class Records:
    """The finished cases of a sweep.

    Attributes:
        done: The outcome of each finished case by its number: {"summary": ...} or {"error": "the reason"}.
    """

    def __init__(self, folder: Path):
        """Read the finished cases in a folder."""
        self.path = folder / CASES_FILE
        self.done: dict[int, dict[str, Any]] = {}
        self._whole = 0  # bytes up to the end of the last whole line
        if self.path.is_file():
            data = self.path.read_bytes()
            self._whole = data.rfind(b"\n") + 1
            for line in data[: self._whole].splitlines():
                # a case with a damaged line is computed again
                with contextlib.suppress(ValueError, RecursionError, TypeError, KeyError):
                    record = json.loads(line)
                    has_outcome = isinstance(record["case"], int) and {"summary", "error"} & set(record)
                    if has_outcome and isinstance(record.get("summary", {}), dict):
                        self.done.setdefault(record["case"], record)

    @contextlib.contextmanager
    def writing(self) -> Iterator["Records"]:
        """Open the file for appending, after cutting off half a line at its end."""
        with self.path.open("ab", buffering=0) as self._file:
            self._file.truncate(self._whole)
            yield self

    def add(self, case: int, outcome: Mapping[str, Any]) -> bool:
        """Store the outcome of a case, on disk when this returns, and return whether there was none yet."""
        if case in self.done:
            return False
        record = {"case": case, **to_json(outcome)}
        line = json.dumps(record, ensure_ascii=False, allow_nan=False).encode() + b"\n"
        try:
            if self._file.write(line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file.fileno())
        except OSError as fault:
            self._file.truncate(self._whole)
            raise (OutputError(self.path, fault) if fault.errno in FULL else fault) from fault
        self._whole += len(line)
        self.done[case] = record
        return True

    def forget_failed(self) -> None:
        """Remove the failed cases, so that they are computed again."""
        kept = {case: record for case, record in self.done.items() if "error" not in record}
        if len(kept) < len(self.done):
            lines = [json.dumps(record, ensure_ascii=False) + "\n" for record in kept.values()]
            write_text(self.path, "".join(lines))
            self.done, self._whole = kept, self.path.stat().st_size


def sweep_dataset(
    definition: Definition,
    described: Mapping[str, Any],
    scene: Scene,
    records: Mapping[int, Mapping[str, Any]],
    provenance: Mapping[str, str],
) -> "xarray.Dataset":
    """Make the dataset of a sweep, from a case's scene and the outcome of each; `provenance` are more attributes.

    The numbers are named as in summary.json, with one dimension per key.
    """
    import xarray

    from aerokernels.jobs.run_files import scene_toml
    from aerokernels.scene.loading import changes_in_words

    dims, shape, count = definition.dims, definition.shape, definition.case_count
    summaries = [records.get(k, {}).get("summary") or {} for k in range(count)]
    errors = [summary.get("errors") or {} for summary in summaries]
    variables: dict[str, Any] = {}
    labels: dict[str, Any] = {}

    def shaped(values: Sequence[Any], dtype: Any = np.float64) -> np.ndarray:
        flat = np.empty(len(values), dtype=dtype)
        flat[:] = values
        return flat.reshape(shape)

    def add(name: str, values: Sequence[Any], words: str, units: str = "1", dtype: Any = object) -> None:
        variables[name] = (dims, shaped(values, dtype), {"units": units, "long_name": words})

    for name, number in NUMBERS.items():
        add(name, [number_or_nan(one.get(name)) for one in summaries], number.words, number.unit, np.float64)
        if any(name in one for one in errors):
            values = [number_or_nan(one.get(name)) for one in errors]
            add(f"{name}_error", values, f"{number.words}: error", number.unit, np.float64)
    for name, dimension, units, words in (
        ("ranges_m", "ranging_method", "m", "range by each method that read the echo"),
        ("error", "cause", "1", "error budget of the Strehl ratio by cause"),
    ):
        columns = list(dict.fromkeys(key for summary in summaries for key in summary.get(name) or {}))
        if columns:
            parts = [shaped([number_or_nan((one.get(name) or {}).get(key)) for one in summaries]) for key in columns]
            variables[name] = ((*dims, dimension), np.stack(parts, axis=-1), {"units": units, "long_name": words})
            labels[dimension] = (dimension, np.array(columns, dtype=object), {"units": "1"})
    for name, words in TEXTS.items():
        add(name, [str(summary.get(name) or "") for summary in summaries], words)
    plans = [json.dumps(summary["plan"]) if summary.get("plan") else "" for summary in summaries]
    add("plan", plans, "how the Strehl ratio's rays were traced, JSON")
    reasons = [failure_of(records.get(k, {})) for k in range(count)]
    add("failures", reasons, "why the case, or a stage of it, failed")
    failed = [not summary for summary in summaries]
    add("failed", failed, "whether the whole case failed", dtype=bool)

    for key, (dimension, places, units) in coordinates(definition).items():
        labels[key] = (dimension, places, {"units": units, "long_name": f"{key} of the scene"})
    if definition.mode != "grid":
        labels[CASE] = (CASE, np.arange(count), {"units": "1", "long_name": "number of the case"})
    attributes: dict[str, Any] = {
        "title": f"sweep of {', '.join(definition.keys)} in {definition.label}{changes_in_words(definition.settings)}",
        "source": f"aerokernels {described['version']}",
        "sweep": json.dumps(described, ensure_ascii=False),
        "scene": scene_toml(scene),
        "case_count": count,
        "failed_count": sum(failed),
        **provenance,
    }
    return xarray.Dataset(variables, labels, attributes)


def failure_of(record: Mapping[str, Any]) -> str:
    """Return why a case failed, or the failures of its stages as "stage: reason; ..."; empty if nothing failed."""
    if "summary" not in record:
        return str(record.get("error", "not computed"))
    return "; ".join(f"{stage}: {why}" for stage, why in (record["summary"].get("failures") or {}).items())
