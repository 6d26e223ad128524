"""Read lists of files and their times: ParaView's collections (.pvd) and file series (.vtu.series and so on).

A collection is XML, with `<DataSet timestep="0.5" part="0" file="a_0.vtu"/>` for each file; the files of one time are
its parts. A file series is JSON, `{"file-series-version": "1.0", "files": [{"name": "a_0.vtu", "time": 0.5}]}`. Lists
may come from untrusted sources: entries outside of the list's own folder are rejected.
"""

import json
import math
import os.path
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from aerokernels.flow.reading.dataset import ReadError
from aerokernels.process.foreign_files import OwnFilesError, own_file

SUFFIXES = (".pvd", ".series")
# Formats that a list may name; a list cannot contain another list.
LISTED = (
    ".vti", ".vtr", ".vts", ".vtu", ".vtp", ".vtk", ".pvti", ".pvtr", ".pvts", ".pvtu", ".vtm", ".vtmb", ".vtpd",
    ".vtpc", ".vth", ".vthb", ".vtkhdf",
)  # fmt: skip
NO_LIST = "the list is damaged: write it again"


class Entry(NamedTuple):
    """A file of a list.

    Attributes:
        time: Its time [s].
        file: Its path.
    """

    time: float
    file: Path


def collection(path: Path) -> list[Entry]:
    """Return the files of a list in the order of their times; files of one time in the order of the list."""
    found = _of_series(path) if path.suffix.lower() == ".series" else _of_collection(path)
    if not found:
        raise ReadError(path, "it lists no data sets", NO_LIST)
    entries, seen = [], set()
    for time, name, part in found:
        if not math.isfinite(time):
            raise ReadError(path, f"it lists {name} at a time that is not a number", NO_LIST)
        file = _within(path, name)
        for key, what in (((time, file), name), ((time, part), f"part {part}")):
            if key in seen:
                raise ReadError(path, f"it lists {what} twice at the time {time:g}", "leave one of the two")
            if key[1] is not None:
                seen.add(key)
        entries.append(Entry(time, file))
    missing = [entry.file for entry in entries if not _is_there(entry.file)]
    if missing:
        name = os.path.relpath(missing[0], path.parent)
        fault = f"it lists {name}, which is not there ({len(missing)} of {len(entries)} files are missing)"
        raise ReadError(path, fault, "restore the files, or take them out of the list")
    return sorted(entries, key=lambda entry: entry.time)


def _is_there(file: Path) -> bool:
    try:
        return file.is_file()
    except OSError:  # a name that is too long for the file system
        return False


def _within(path: Path, name: str) -> Path:
    """Return the path of a file of a list, after checking that it is within the list's folder."""
    plain = name if "\0" in name else os.path.normpath(name)
    if Path(plain).suffix.lower() not in LISTED:
        raise ReadError(path, f"it lists {name!r}, which is not a VTK file", f"take one of {', '.join(LISTED)}")
    try:
        return own_file(path, plain)
    except OwnFilesError as fault:
        raise ReadError.said(str(fault)) from None


def _of_collection(path: Path) -> list[tuple[float, str, Any]]:
    """Return time, name and part of the entries of a .pvd file; None for parts without a number."""
    try:
        root = ElementTree.parse(path).getroot()
        sets = [entry.attrib for entry in root.iter("DataSet")]
        return [
            (
                float(own.get("timestep", 0.0)),
                own["file"],
                (own.get("group", ""), own["part"]) if "part" in own else None,
            )
            for own in sets
        ]
    except KeyError:
        raise ReadError(path, "it is not a list of data sets: one of them names no file", NO_LIST) from None
    except (ElementTree.ParseError, LookupError, ValueError) as fault:
        raise ReadError(path, f"it is not a list of data sets ({fault})", NO_LIST) from None


def _of_series(path: Path) -> list[tuple[float, str, Any]]:
    """Return the same for a file series, which has no parts; without times its files are numbered from 0."""
    try:
        listed = json.loads(path.read_text(encoding="utf-8"))["files"]
        names = [entry["name"] for entry in listed]
        if not all(isinstance(name, str) for name in names):
            raise TypeError("a name that is not a text")
        if not any("time" in entry for entry in listed):
            return [(float(number), name, None) for number, name in enumerate(names)]
        times = [entry["time"] for entry in listed]
        if any(isinstance(time, bool) or not isinstance(time, (int, float)) for time in times):
            raise TypeError("a time that is not a number")
        return [(float(time), name, None) for time, name in zip(times, names, strict=True)]
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError, OverflowError) as fault:
        reason = f"there is no {fault}" if isinstance(fault, KeyError) else str(fault)
        raise ReadError(path, f"it is not a file series ({reason})", NO_LIST) from None
