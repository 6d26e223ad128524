"""Store the finished cases of a sweep: one line of JSON per case, on disk as soon as the case is finished.

A folder holds sweep.json, the sweep's definition; cases.jsonl, a line for each finished case; and sweep.nc, the dataset
of all cases once all are finished. A kill at any moment leaves at most half a line at the end, which is dropped.
"""

import contextlib
import errno
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from aerokernels.display.plain_text import cut, plain_json
from aerokernels.files.writing import FULL, OutputError
from aerokernels.jobs.store import to_json, write_text

DEFINITION_FILE, CASES_FILE, DATASET_FILE = "sweep.json", "cases.jsonl", "sweep.nc"
_REMEDY = "take another folder, or remove that one"


def read_definition(folder: Path) -> dict[str, Any] | None:
    """Read the definition of the sweep in a folder; return None if there is none.

    Raises:
        ValueError: The file sweep.json is not that of a sweep.
    """
    path = folder / DEFINITION_FILE
    if not path.is_file():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as fault:
        raise ValueError(f"out={folder}: {path.name} cannot be read ({fault}); {_REMEDY}") from None
    if not isinstance(found, dict) or "vary" not in found:
        raise ValueError(f"out={folder}: {path.name} is not that of a sweep; {_REMEDY}")
    return found


def write_definition(folder: Path, described: Mapping[str, Any]) -> None:
    """Write the definition of a sweep atomically."""
    write_text(folder / DEFINITION_FILE, plain_json(json.dumps(described, indent=2, ensure_ascii=False)) + "\n")


def check_same(folder: Path, found: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """Reject resuming a different sweep.

    Raises:
        ValueError: The folder's sweep is of another scene, of other values or by another version.
    """
    differences = list(_differences(found, asked))
    if not differences:
        return
    key, old, new = differences[0]
    more = f" (and {len(differences) - 1} more differences)" if len(differences) > 1 else ""
    if key.startswith("content."):
        raise ValueError(f"out={folder}: {key.removeprefix('content.')} has changed since its sweep began; {_REMEDY}")
    if key == "version":
        old, new = old.strip('"'), new.strip('"')
        raise ValueError(
            f"out={folder}: its sweep was made by aerokernels {old}, this is {new}, whose numbers may differ; {_REMEDY}"
        )
    raise ValueError(f"out={folder}: it holds another sweep: {key} was {old} and is {new}{more}; {_REMEDY}")


def _differences(old: Any, new: Any, key: str = "") -> Iterator[tuple[str, str, str]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for name in [*old, *(name for name in new if name not in old)]:
            inner = name if not key or key == "scene" else f"{key}.{name}"
            yield from _differences(old.get(name), new.get(name), inner)
        if key == "vary" and list(old) != list(new) and old.keys() == new.keys():
            yield "the order of the keys that vary", ", ".join(old), ", ".join(new)
    elif old != new:
        yield key.removeprefix("vary."), _short(old), _short(new)


def _short(value: Any) -> str:
    return "absent" if value is None else cut(json.dumps(value, ensure_ascii=False))


def _is_record(record: Any) -> bool:
    if not isinstance(record, dict) or type(record.get("case")) is not int:
        return False
    return isinstance(record.get("summary"), dict) or isinstance(record.get("error"), str)


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
                with contextlib.suppress(ValueError, RecursionError):  # a case with a damaged line is computed again
                    record = json.loads(line)
                    if _is_record(record):
                        self.done.setdefault(record["case"], record)

    @contextlib.contextmanager
    def writing(self) -> Iterator["Records"]:
        """Open the file for appending, after cutting off half a line at its end."""
        with self.path.open("ab", buffering=0) as self._file:
            self._file.truncate(self._whole)
            yield self

    def add(self, case: int, outcome: Mapping[str, Any]) -> bool:
        """Store the outcome of a case, on disk when this returns; an outcome that is already stored is not replaced.

        Returns:
            Whether the outcome was new.

        Raises:
            OutputError: The disk is full; the outcomes stored before are safe, and the sweep can be resumed.
        """
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
