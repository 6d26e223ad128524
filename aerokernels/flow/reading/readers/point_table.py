"""Read CSV: a table of points, by its columns x, y, z (or r, z) and arrays.

Points on a grid are put back on it. Other points are joined by Delaunay triangles (in a plane) or tetrahedra (in
space), which also fill concave parts and bodies; slivers of nearly no volume are left out. A column of times that are
not all equal divides the table into the points of each time.
"""

import csv
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.arrays import PLACE, coordinates_of, length_of, plain_name, unit_of_array
from aerokernels.flow.reading.dataset import (
    TETRAHEDRON,
    TRIANGLE,
    Block,
    Cells,
    Dataset,
    ReadError,
    check_points,
    chosen_time,
)

DAMAGED = "write it again with a line of names and as many numbers in every line"


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a table of points."""
    table = read_table(path)
    known, symmetry = coordinates_of(table)
    columns = {PLACE[axis]: name for axis, name in known.items()}
    if len(columns) < 2:
        fault = f"no columns are known for coordinates (there are: {', '.join(table)})"
        raise ReadError(path, fault, "call them x, y, z or r, z")
    length, factors = length_of(path, dict.fromkeys(columns.values(), ""))
    points = np.zeros((len(next(iter(table.values()))), 3))
    for (place, name), factor in zip(columns.items(), factors, strict=True):
        points[:, place] = table[name] * factor
    check_points(path, points)
    arrays = {name: values for name, values in table.items() if name not in columns.values()}
    times, chosen, kept = _at_time(path, points, arrays, time)
    block, note = joined(path, points[kept], {name: own[kept] for name, own in arrays.items()})
    geometry = None if symmetry is None else "axisymmetric"
    return Dataset(
        [block], "table of points", geometry, times=times, time=chosen, axis=symmetry, length=length, notes=note
    )


def _at_time(
    path: Path, points: np.ndarray, arrays: dict[str, np.ndarray], asked: Any
) -> tuple[list[float], float | None, slice | np.ndarray]:
    """Return the times of a table [s], the requested one of them, and its rows; its column of times leaves `arrays`."""
    usual = ("time", "timevalue", "flowtime", "physicaltime", "solutiontime", "simulationtime")
    name = next((name for name in arrays if plain_name(name) in usual), "t")
    if name not in arrays:
        return [], None, slice(None)
    if name == "t" and np.ptp(arrays["t"]) != 0.0 and len(np.unique(points, axis=0)) == len(points):
        return [], None, slice(None)  # a temperature
    if bad := int((~np.isfinite(arrays[name])).sum()):
        raise ReadError(path, f"{bad} of its {len(points)} times ({name}) are no numbers", "give each point its time")
    values, number, counts = np.unique(arrays[name], return_inverse=True, return_counts=True)
    if counts.min() < 4:  # points at a time: a column of other times is an array like any other
        return [], None, slice(None)
    del arrays[name]
    times = (unit_of_array(path, name, "", "time").factor * values).tolist()
    chosen = chosen_time(path, times, asked)
    assert chosen is not None
    return times, chosen, slice(None) if len(times) == 1 else number.ravel() == times.index(chosen)


def joined(path, points: np.ndarray, arrays: dict[str, np.ndarray]) -> tuple[Block, list[str]]:
    """Return points as a grid where they form one, else as the cells of a Delaunay triangulation."""
    extent = np.ptp(points, axis=0)
    if (extent > 0.0).sum() < 2:
        raise ReadError(path, "its points are on a line", "give points of a plane or a volume")
    # Coordinates along an axis that are closer than a billionth of the extent count as equal.
    step = np.where(extent > 0.0, 1e-9 * np.maximum(extent, 1e-300), 1.0)
    index = np.round((points - points.min(axis=0)) / step).astype(np.int64)
    places = [np.unique(own, return_inverse=True) for own in index.T]
    shape = (len(places[0][0]), len(places[1][0]), len(places[2][0]))
    if np.prod(shape, dtype=float) == len(points):
        number = np.ravel_multi_index([index.ravel() for _, index in places[::-1]], shape[::-1])
        if len(np.unique(number)) == len(points):
            order = np.argsort(number)
            return Block(points[order], None, shape, {name: own[order] for name, own in arrays.items()}), []
    return _triangulated(path, points, arrays, extent > 0.0)


def _triangulated(path, points, arrays, wide) -> tuple[Block, list[str]]:
    from scipy.spatial import Delaunay, QhullError

    if twice := len(points) - len(np.unique(points, axis=0)):
        fault = f"{twice} points lie in the same place as another"
        raise ReadError(path, fault, "leave them out, or give those of several times a column 'time'")
    flat = points[:, wide]
    try:
        corners = Delaunay((flat - flat.min(axis=0)) / np.ptp(flat, axis=0)).simplices.astype(np.int64)
    except (QhullError, ValueError):
        raise ReadError(path, "its points cannot be joined to cells", "give points of a plane or a volume") from None
    edge = flat[corners[:, 1:]] - flat[corners[:, :1]]
    measure = np.linalg.det(edge)
    corners = np.where((measure < 0.0)[:, None], corners[:, [1, 0, *range(2, corners.shape[1])]], corners)
    keep = np.abs(measure) > 1e-9 * np.median(np.abs(measure))
    kind = TRIANGLE if flat.shape[1] == 2 else TETRAHEDRON
    note = "the points form no grid: they are joined by Delaunay cells, which also fill concave parts and bodies"
    return Block(points, Cells.of_one_type(kind, corners[keep]), point_data=arrays), [note]


def read_table(path: Path, data: bytes | None = None) -> dict[str, np.ndarray]:
    """Return the columns of a table by name."""
    data = path.read_bytes() if data is None else data
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise ReadError(path, f"it is not a text (byte {fault.start})", DAMAGED) from None
    if "\0" in text:
        raise ReadError(path, "it is not a text: it contains zero bytes", DAMAGED)
    written = [(k + 1, line) for k, line in enumerate(text.splitlines()) if line.strip()]
    lines = [(number, line) for number, line in written if not line.lstrip().startswith("#")]
    if lines and all(
        map(is_number, re.split(r"[,;\s]+", lines[0][1].strip(" \t,;")))
    ):  # the names are in a comment above, as numpy.savetxt writes them
        above = [(number, line.lstrip().lstrip("#")) for number, line in written if number < lines[0][0]]
        lines = above[-1:] + lines
    if len(lines) < 2:
        raise ReadError(path, "it has no line of names with lines of numbers below it", DAMAGED)
    head = lines[0][1]
    mark = next((mark for mark in (",", ";", "\t") if mark in head), None)
    names = [
        word.strip().strip('"').strip()
        for word in next(csv.reader([head] if mark else [" ".join(head.split())], delimiter=mark or " "))
    ]
    if names[0] == "" and len(names) > 1:
        names[0] = "index"  # pandas writes the index of rows without a name
    if len(set(names)) < len(names) or not all(names) or all(is_number(name) for name in names):
        raise ReadError(path, f"its first line has no names that are all different: {head[:80]!r}", DAMAGED)
    mark = next((mark for mark in (";", ",", "\t") if mark in lines[1][1]), None)  # may differ from that of the names
    body = [
        line.strip().rstrip(mark or "") if line.count(mark or "\0") == len(names) else line for _, line in lines[1:]
    ]
    if mark == ";":  # then a comma is the decimal mark
        body = [line.replace(",", ".") for line in body]
    try:
        rows = np.loadtxt(body, delimiter=mark, ndmin=2, comments=None)
        if rows.shape[1] != len(names):
            raise ValueError("at row 1;")
    except ValueError as fault:
        row = re.search(r"at row (\d+)(;?)", str(fault))  # "at row 0, column 1" counts from 0, "at row 1; use" from 1
        wrong = int(row[1]) - bool(row[2]) if row else 0
        number, line = lines[1 + wrong]
        raise ReadError(path, f"line {number}: expected {len(names)} numbers, got {line[:60]!r}", DAMAGED) from None
    return {name: rows[:, k].copy() for k, name in enumerate(names)}


def fortran_numbers(text: str) -> np.ndarray:
    """Return the numbers of a text, separated by blanks, also with exponents as only Fortran writes them.

    These have the letter D, or no letter before three digits: 1.5D+00, 1.5-101. ValueError: something else.
    """
    text = text.replace("D", "E").replace("d", "e")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        exponent = r"(?<=[\d.])(?=[+-]\d{3}(?![\d.]))"
        for written in (lambda: text, lambda: re.sub(exponent, "E", text)):  # the second takes longer
            try:
                return np.fromstring(written(), sep=" ")
            except (DeprecationWarning, ValueError) as fault:
                wrong = fault
    raise ValueError(str(wrong))


def is_number(word: str) -> bool:
    """Return whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True
