"""Read Tecplot ASCII files (.dat): ordered and finite-element zones, POINT and BLOCK packing, nodal and cell values.

VTK's reader returns single precision; this one keeps all digits.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.arrays import PLACE, Direction, coordinates_of, length_of
from aerokernels.flow.reading.dataset import (
    UNFINISHED,
    Block,
    Cells,
    Dataset,
    ReadError,
    chosen_time,
    starts_of,
    whole_number,
)
from aerokernels.flow.reading.readers.point_table import fortran_numbers

# VTK's number of each type of element, and its number of corners.
ELEMENTS = {"TRIANGLE": (5, 3), "QUADRILATERAL": (9, 4), "TETRAHEDRON": (10, 4), "BRICK": (12, 8), "LINESEG": (3, 2)}


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a Tecplot ASCII file."""
    data = path.read_bytes()
    if b"\0" in data:
        raise ReadError(path, "it is not a text: it contains zero bytes", UNFINISHED)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    variables, zones = _parts(path, text)
    held: list[tuple[list[np.ndarray], Cells | None]] = []
    blocks = [zone_block(path, variables, head, own, held) for head, own in zones]
    times = [head.get("SOLUTIONTIME") for head, _ in zones]
    strands = [head.get("STRANDID") for head, _ in zones]
    return at_time(path, variables, blocks, without_static(times, strands, "0"), "Tecplot ASCII", time)


def without_static(times: list, strands: list, static: Any) -> list:
    """Return times of zones, None for zones in the static strand if others are in strands that change in time."""
    if all(strand in (static, None) for strand in strands):
        return times
    return [None if strand == static else time for time, strand in zip(times, strands, strict=True)]


def at_time(path: Path, variables: list[str], blocks: list[Block], times: list, name: str, asked) -> Dataset:
    """Return the zones of one solution time; zones without a time belong to every time."""
    flows = [k for k, block in enumerate(blocks) if not _is_line(block)]
    notes = []
    if 0 < len(flows) < len(blocks):
        notes = [f"zones of lines are left out: {', '.join(block.name for block in blocks if _is_line(block))}"]
        blocks, times = [blocks[k] for k in flows], [times[k] for k in flows]
    place, symmetry = coordinate_columns(variables)
    length, factors = length_of(path, {variables[k]: "" for k in place.values()})
    for index, factor in zip(place, factors, strict=True):
        for block in blocks if factor != 1.0 else []:
            block.points[:, index] *= factor
    values = sorted({float(t) for t in times if t is not None})
    chosen = chosen_time(path, values, asked)
    kept = [block for block, t in zip(blocks, times, strict=True) if t is None or float(t) == chosen]
    geometry = None if symmetry is None else "axisymmetric"
    return Dataset(
        kept, name, geometry, times=values, time=chosen, axis=symmetry, length=length, notes=notes
    )  # fmt: skip


def _is_line(block: Block) -> bool:
    """Return whether a zone is a line: the surface of a profile, say, beside the flow."""
    if block.shape is not None:
        return sum(count > 1 for count in block.shape) < 2
    return block.cells is not None and bool((block.cells.types == 3).all())


def _parts(path: Path, text: str):
    """Return the variables' names, and the header and numbers of each zone."""
    variables: list[str] = []
    zones: list[tuple[list[str], list[str]]] = []  # the lines of the header, and those of numbers
    where = ""
    others = ("TITLE", "FILETYPE", "DATASETAUXDATA", "TEXT", "GEOMETRY", "VARAUXDATA", "CUSTOMLABELS")
    for line in text.splitlines():
        plain = line.strip()
        if not plain or plain.startswith("#"):
            continue
        upper = plain.upper()
        if upper.startswith("ZONE"):
            zones.append(([plain[4:]], []))
            where = "zone"
        elif upper.startswith(others):
            where = "other"
        elif upper.startswith("VARIABLES"):
            variables, where = _names(plain.split("=", 1)[-1]), "variables"
        elif where in ("zone", "numbers") and (plain[0] in "-+." or plain[0].isdigit()):
            zones[-1][1].append(plain)
            where = "numbers"
        elif where == "variables":
            variables += _names(plain)
        elif where == "zone":
            zones[-1][0].extend([] if upper.startswith("AUXDATA") else [plain])
        elif where == "numbers":
            raise ReadError(path, f"{plain[:40]!r} is among the numbers of zone {len(zones)}", UNFINISHED)
    if not variables or not zones:
        raise ReadError(path, "it has no VARIABLES or no ZONE", "give a data file of Tecplot")
    for number, (head, _) in enumerate(zones, start=1):
        if (length := sum(map(len, head))) > 10_000:  # a zone's header has fewer characters
            raise ReadError(path, f"the head of zone {number} has {length} letters", UNFINISHED)
    return variables, [(_pairs(" ".join(head)), "\n".join(body)) for head, body in zones]


def _names(text: str) -> list[str]:
    return [quoted or bare for quoted, bare in re.findall(r'"([^"]*)"|([^\s,"]+)', text)]


def _pairs(text: str) -> dict[str, str]:
    pairs = re.findall(r'([A-Za-z][\w ]*?)\s*=\s*("[^"]*"|\((?:[^()]|\([^()]*\))*\)|[^\s,=]+)', text)
    return {re.sub(r"\s", "", key.split()[-1]).upper(): value.strip('"') for key, value in pairs}


def zone_block(path: Path, variables: list[str], head: dict[str, str], text: str, held: list) -> Block:
    """Return the block of a zone, and add its arrays and cells to those of the zones before it, `held`."""
    name = f"zone {len(held) + 1}" + (f" ({head['T']})" if head.get("T") else "")
    stated = (head.get("ZONETYPE") or head.get("ET") or "ORDERED").upper()
    kind = stated.removeprefix("FE")
    if "PASSIVEVARLIST" in head:
        raise ReadError(path, f"{name} has variables without values", "write the file with all data in every zone")
    shared = _shared_variables(path, name, head.get("VARSHARELIST", ""), len(variables), held)
    in_cells = _cell_variables(path, head.get("VARLOCATION", ""), len(variables))
    packing = _packing(path, name, head, text, len(variables) - len(shared), bool(in_cells))
    if in_cells and packing != "BLOCK":
        raise ReadError(path, f"{name} has values in cells without BLOCK packing", UNFINISHED)
    ordered = kind == "ORDERED"
    if ordered:
        shape = tuple(_count(path, name, head.get(key, "1")) for key in "IJK")
        nodes, cells, corners = math.prod(shape), math.prod(max(n - 1, 1) for n in shape), 0
    else:
        if kind not in ELEMENTS:
            raise ReadError(path, f"{name} is of type {stated}", f"known are ORDERED, FE{', FE'.join(ELEMENTS)}")
        nodes = _count(path, name, head.get("NODES") or head.get("N", ""))
        cells = _count(path, name, head.get("ELEMENTS") or head.get("E", ""))
        shape, corners = None, ELEMENTS[kind][1]
    whole = None
    if corners and (word := head.get("CONNECTIVITYSHAREZONE")) is not None:
        whole, corners = _earlier(path, name, word, held)[1], 0
        if whole is None or len(whole) != cells:
            raise ReadError(path, f"{name} shares the elements of a zone with others", UNFINISHED)
    own = [k for k in range(len(variables)) if k not in shared]
    width = [cells if k in in_cells else nodes for k in own]
    numbers = _numbers(path, name, text, sum(width) + cells * corners)
    if packing == "BLOCK":
        cuts = np.cumsum([0, *width])
        parts = [numbers[cuts[k] : cuts[k + 1]] for k in range(len(own))]
    else:
        parts = list(numbers[: nodes * len(own)].reshape(nodes, len(own)).T)
    result = shared | dict(zip(own, parts, strict=True))
    arrays = [result[k] for k in range(len(variables))]
    if any(len(arrays[k]) != (cells if k in in_cells else nodes) for k in shared):
        raise ReadError(path, f"{name} shares a variable of another size", UNFINISHED)
    connectivity = numbers[sum(width) :]
    index = connectivity.astype(np.int64) - 1
    if corners:
        whole = element_cells(ELEMENTS[kind][0], index.reshape(cells, corners))
    listed = np.empty(0, np.int64) if whole is None else whole.points
    if (index + 1 != connectivity).any() or listed.min(initial=0) < 0 or listed.max(initial=0) >= nodes:
        raise ReadError(path, f"elements of {name} refer to nodes beyond the {nodes} that there are", UNFINISHED)
    held.append((arrays, whole))
    return assembled(path, variables, arrays, in_cells, shape, whole, name)


def _shared_variables(path: Path, name: str, text: str, count: int, held: list) -> dict[int, np.ndarray]:
    """Return the variables that a zone has from earlier ones, as in ([1-3]=2, [5]); by default from the one before."""
    result: dict[int, np.ndarray] = {}
    for numbers, zone in re.findall(r"\[([\d,\-\s]+)\]\s*(?:=\s*(\d+))?", text):
        arrays = _earlier(path, name, zone or str(len(held)), held)[0]
        result |= {k: arrays[k] for k in _numbered(path, "VARSHARELIST", numbers, count)}
    if text and not result:
        raise ReadError(path, f"{name} has VARSHARELIST={text[:40]}", UNFINISHED)
    return result


def _earlier(path: Path, name: str, word: str, held: list) -> tuple[list[np.ndarray], Cells | None]:
    """Return the arrays and the cells of an earlier zone by its number, from 1 on."""
    number = whole_number(word)
    if number is None or not 0 < number <= len(held):
        raise ReadError(path, f"{name} shares data with zone {word[:20]}, which is not before it", UNFINISHED)
    return held[number - 1]


def _packing(path: Path, name: str, head: dict[str, str], text: str, variable_count: int, in_cells: bool) -> str:
    """Return "POINT" or "BLOCK", as stated in the zone's header; programs differ in what they mean by neither."""
    if stated := head.get("DATAPACKING") or head.get("F"):
        return stated.upper().removeprefix("FE")
    if in_cells:
        return "BLOCK"
    line = text.split("\n", 1)[0].replace(",", " ").split()
    if len(line) != variable_count:
        what = f"{name} does not state DATAPACKING, and its first line has {len(line)} of {variable_count} variables"
        raise ReadError(path, what, "write DATAPACKING=POINT or DATAPACKING=BLOCK in the zone's header")
    return "POINT"


def element_cells(kind: int, corners: np.ndarray) -> Cells:
    """Return cells of an element type; quadrilaterals that repeat their last corner are triangles."""
    if kind == 9 and (twice := corners[:, 3] == corners[:, 2]).any():
        width = np.where(twice, 3, 4)
        flat = corners[np.arange(4) < width[:, None]]
        return Cells(np.where(twice, 5, 9).astype(np.uint8), starts_of(width), flat)
    return Cells.of_one_type(kind, corners)


def assembled(path, variables, arrays, in_cells, shape, cells, name) -> Block:
    """Return a block from its arrays: coordinates by their names, the rest as data."""
    place, _ = coordinate_columns(variables)
    if len(place) < 2 or any(k in in_cells for k in place.values()):
        raise ReadError(path, f"no coordinates are known (there are: {', '.join(variables)})", "call them X, Y, Z")
    points = np.zeros((len(arrays[next(iter(place.values()))]), 3))
    for index, k in place.items():
        points[:, index] = arrays[k]
    data = {v: (k, np.asarray(arrays[k], np.float64)) for k, v in enumerate(variables) if k not in place.values()}
    cell = {v: own for v, (k, own) in data.items() if k in in_cells}
    point = {v: own for v, (k, own) in data.items() if k not in in_cells}
    return Block(points, cells, shape, point, cell, None, name)


def coordinate_columns(variables: list[str]) -> tuple[dict[int, int], Direction | None]:
    """Return the variable of the coordinate along each axis, {axis number: variable number}, and the symmetry axis."""
    known, symmetry = coordinates_of(variables)
    return {PLACE[axis]: variables.index(name) for axis, name in known.items()}, symmetry


def _numbered(path: Path, key: str, numbers: str, count: int) -> set[int]:
    """Return the variables, from 0 on, of a list such as 1, 3-5."""
    result: set[int] = set()
    for part in numbers.split(","):
        low, _, high = part.strip().partition("-")
        first, last = whole_number(low.strip()), whole_number((high or low).strip())
        if first is None or last is None or first < 1:
            raise ReadError(path, f"{key} names variables by {part.strip()[:20]!r}", UNFINISHED)
        if last > count:  # before allocating a set of this size
            raise ReadError(path, f"{key} names variable {last} of {count}", UNFINISHED)
        result |= set(range(first - 1, last))
    return result


def _cell_variables(path: Path, text: str, count: int) -> set[int]:
    result: set[int] = set()
    for numbers, place in re.findall(r"\[([\d,\-\s]+)\]\s*=\s*(\w+)", text):
        if place.upper() == "CELLCENTERED":
            result |= _numbered(path, "VARLOCATION", numbers, count)
    listed = re.fullmatch(r"\(((?:\s*(?:NODAL|CELLCENTERED)\s*,?)+)\)", text.strip(), re.IGNORECASE)
    if listed:
        result |= {k for k, word in enumerate(re.findall(r"\w+", listed[1])) if word.upper() == "CELLCENTERED"}
    if result and max(result) >= count:
        raise ReadError(path, f"VARLOCATION names variable {max(result) + 1} of {count}", UNFINISHED)
    return result


def _count(path: Path, name: str, word: str) -> int:
    count = whole_number(word)
    if count is None or not 0 < count < 2**40:
        raise ReadError(path, f"{name} has the count {word[:20]!r}", UNFINISHED)
    return count


def _numbers(path: Path, name: str, text: str, expected: int) -> np.ndarray:
    """Return the numbers of a zone, of which there must be `expected`; 3*0.5 means three times 0.5."""
    text = text.replace(",", " ")
    counts = None
    if "*" in text:
        words = [re.fullmatch(r"(\d+)\*(\S+)", word) or word for word in text.split()]
        repeats = [1 if isinstance(word, str) else int(word[1]) for word in words]
        _check_count(path, name, sum(repeats), expected)  # before expanding: a damaged count may be huge
        # Greatest ratio of a zone's numbers to written ones: a coordinate changes along the first index.
        if expected > 1000 * len(words):
            raise ReadError(path, f"{name} repeats {len(words)} numbers until they are {expected}", UNFINISHED)
        counts, text = np.array(repeats), " ".join(word if isinstance(word, str) else word[2] for word in words)
    try:
        numbers = fortran_numbers(text)
    except ValueError:
        raise ReadError(path, f"{name} contains something that is not a number", UNFINISHED) from None
    if counts is not None and len(counts) == len(numbers):
        numbers = np.repeat(numbers, counts)
    _check_count(path, name, len(numbers), expected)
    return numbers


def _check_count(path: Path, name: str, held: int, expected: int) -> None:
    if held != expected:
        raise ReadError(path, f"{name} announces {expected} numbers and has {held}", UNFINISHED)
