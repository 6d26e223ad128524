"""Lists of files and their times: ParaView's collections (.pvd) and file series (.vtu.series, .vtm.series and so on).

A collection is XML, `<DataSet timestep="0.5" part="0" file="a_0.vtu"/>` for each file; those of one time are its parts.
A file series is JSON, `{"file-series-version": "1.0", "files": [{"name": "a_0.vtu", "time": 0.5}]}`. Either is text
from elsewhere, and files are opened by what it says: those outside of its own folder are refused.
"""

import json
import math
import os.path
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from .dataset import ReadError

SUFFIXES = (".pvd", ".series")
# What a collection may list; another list is none of it.
LISTED = (
    ".vti", ".vtr", ".vts", ".vtu", ".vtp", ".vtk", ".pvti", ".pvtr", ".pvts", ".pvtu", ".vtm", ".vtmb",
)  # fmt: skip
NO_LIST = "the list is damaged: write it again"


class Entry(NamedTuple):
    """A file of a list.

    Attributes:
        time: Its time [s].
        file: Where it lies.
    """

    time: float
    file: Path


def collection(path: Path) -> list[Entry]:
    """The files of a list, in the order of their times; of one time in the list's.

    Raises:
        ReadError: It is no such list, lists nothing, a file that is not there, no file of VTK or outside of its folder,
            a time that is no number, or a file or a part twice at one time.
    """
    found = _of_series(path) if path.suffix.lower() == ".series" else _of_collection(path)
    if not found:
        raise ReadError(path, "it lists no data sets", NO_LIST)
    entries, seen = [], set()
    for time, name, part in found:
        if not math.isfinite(time):
            raise ReadError(path, f"it lists {name} at a time that is no number", NO_LIST)
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
        told = f"it lists {name}, which is not there ({len(missing)} of {len(entries)} files are missing)"
        raise ReadError(path, told, "restore the files, or take them out of the list")
    return sorted(entries, key=lambda entry: entry.time)


def _is_there(file: Path) -> bool:
    try:
        return file.is_file()
    except OSError:  # a name that is too long for one
        return False


def _within(path: Path, name: str) -> Path:
    """Where a file of a list lies."""
    plain = os.path.normpath(name)
    if "\0" in name or os.path.isabs(plain) or plain.split(os.sep)[0] == os.pardir:
        told = f"it lists {name!r}, which lies outside of its own folder"
        remedy = "lists may not open files there: move this one to a folder that holds them all, and name them from it"
        raise ReadError(path, told, remedy)
    if Path(plain).suffix.lower() not in LISTED:
        raise ReadError(path, f"it lists {name!r}, which is no file of VTK", f"take one of {', '.join(LISTED)}")
    return path.parent / plain


def _of_collection(path: Path) -> list[tuple[float, str, Any]]:
    """Time, name and part of what a .pvd lists; parts that are not numbered are None."""
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
        raise ReadError(path, "it is no list of data sets: one of them names no file", NO_LIST) from None
    except (ElementTree.ParseError, LookupError, ValueError) as fault:
        raise ReadError(path, f"it is no list of data sets ({fault})", NO_LIST) from None


def _of_series(path: Path) -> list[tuple[float, str, Any]]:
    """The same of a file series, which has no parts; where no file has a time they are counted from 0 on."""
    try:
        listed = json.loads(path.read_text(encoding="utf-8"))["files"]
        names = [entry["name"] for entry in listed]
        if not all(isinstance(name, str) for name in names):
            raise TypeError("a name that is no text")
        if not any("time" in entry for entry in listed):
            return [(float(number), name, None) for number, name in enumerate(names)]
        times = [entry["time"] for entry in listed]
        if any(isinstance(time, bool) or not isinstance(time, (int, float)) for time in times):
            raise TypeError("a time that is no number")
        return [(float(time), name, None) for time, name in zip(times, names, strict=True)]
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError, OverflowError) as fault:
        reason = f"there is no {fault}" if isinstance(fault, KeyError) else str(fault)
        raise ReadError(path, f"it is no file series ({reason})", NO_LIST) from None
