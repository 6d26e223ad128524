"""Read Tecplot binary files (.plt), versions 107 to 112: ordered and finite-element zones, shared, passive variables.

The layout follows "Binary Data File Format" in Tecplot's data format guide: a header with the variables and all zones,
then the data of each zone, variable after variable. Values in cells of an ordered zone are padded along all axes but
the last.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import UNFINISHED, Cells, Dataset, ReadError
from aerokernels.flow.reading.readers.tecplot_text import ELEMENTS, assembled, at_time, element_cells, without_static

ZONE = 299.0  # begins a zone in the header, and its data
NAMES = {2: "TRIANGLE", 3: "QUADRILATERAL", 4: "TETRAHEDRON", 5: "BRICK"}  # of the types of zones
KINDS = {1: "f4", 2: "f8", 3: "i4", 4: "i2", 5: "u1"}


@dataclass
class _Zone:
    """A zone's header, and later its arrays."""

    name: str
    strand: int
    time: float
    kind: int
    in_cells: list[bool]
    counts: tuple[int, ...]
    arrays: list[np.ndarray] = field(default_factory=list)
    cells: Cells | None = None

    @property
    def cell_count(self) -> int:
        """Number of cells."""
        return self.counts[1] if self.kind else math.prod(max(n - 1, 1) for n in self.counts)


class _Bytes:
    """The bytes of a file and a cursor in them."""

    def __init__(self, path: Path, data: bytes, at: int):
        self.path, self.data, self.at, self.order = path, data, at, "<"

    def fault(self, what: str) -> ReadError:
        return ReadError(self.path, f"{what} (byte {self.at} of {len(self.data)})", UNFINISHED)

    def take(self, kind: str, count: int = 1) -> np.ndarray:
        """Return the next numbers and move past them."""
        dtype = np.dtype(self.order + kind)
        if count < 0 or self.at + count * dtype.itemsize > len(self.data):
            raise self.fault(f"{count} numbers of {dtype.itemsize} bytes are announced, the file ends before")
        values = np.frombuffer(self.data, dtype, count, self.at)
        self.at += count * dtype.itemsize
        return values

    def whole(self) -> int:
        return int(self.take("i4")[0])

    def real(self) -> float:
        return float(self.take("f4")[0])

    def text(self) -> str:
        """Return a text: one int32 for each character, ended by 0."""
        letters: list[str] = []
        while (letter := self.whole()) != 0:
            if not 0 < letter < 0x110000 or len(letters) > 10_000:
                raise self.fault("a name is not ended, or contains invalid characters")
            letters.append(chr(letter))
        return "".join(letters)


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a Tecplot binary file."""
    data = path.read_bytes()
    if not data.startswith(b"#!TDV") or not data[5:8].isdigit():
        raise ReadError(path, "it does not begin with #!TDV", "give a .plt of Tecplot 360, or its ASCII form")
    version = int(data[5:8])
    if not 107 <= version <= 112:
        raise ReadError(
            path, f"version {version} of the format is not read", "write it as version 107 to 112, or as ASCII"
        )
    fault: ReadError | None = None
    for packing in (False,) if version == 112 else (True, False):  # version 112 dropped this header field
        try:
            return _read(path, data, version, packing, time)
        except ReadError as found:
            fault = fault or found
    assert fault is not None
    raise fault


def _read(path: Path, data: bytes, version: int, packing: bool, time) -> Dataset:
    stream = _Bytes(path, data, 8)
    one = stream.take("i4")[0]
    if one != 1:
        stream.order = ">"
        if one.byteswap() != 1:
            raise stream.fault("its byte order is invalid")
    if version >= 111 and stream.whole() != 0:
        raise stream.fault("it contains only a grid or only a solution")
    stream.text()  # the title
    count = stream.whole()
    if not 0 < count <= 10_000:
        raise stream.fault(f"it announces {count} variables")
    variables = [stream.text() for _ in range(count)]
    zones: list[_Zone] = []
    while (marker := stream.real()) != 357.0:
        if marker == ZONE:
            zones.append(_zone(stream, count, packing))
        elif marker in (399.0, 499.0):
            what = "a geometry" if marker == 399.0 else "a text"
            raise ReadError(path, f"{what} is drawn in it", "write it again without texts and geometries")
        elif marker in (599.0, 699.0, 799.0, 899.0):  # labels, a user's record, auxiliary data, those of a variable
            for _ in range(stream.whole() if marker == 599.0 else marker == 699.0):
                stream.text()
            if marker == 899.0:
                stream.whole()
            if marker > 700.0:
                stream.text(), stream.whole(), stream.text()
        else:
            raise stream.fault(f"the header contains {marker!r} in place of a zone")
    if not zones:
        raise stream.fault("it has no zones")
    for number, zone in enumerate(zones):
        _data(stream, zone, zones[:number], count)
    if stream.at != len(data):
        raise stream.fault("more follows the last zone")
    blocks = []
    for number, zone in enumerate(zones):
        shape = (zone.counts[0], zone.counts[1], zone.counts[2]) if zone.kind == 0 else None
        in_cells = {k for k, cell in enumerate(zone.in_cells) if cell}
        name = f"zone {number + 1}" + (f" ({zone.name})" if zone.name else "")
        blocks.append(assembled(path, variables, zone.arrays, in_cells, shape, zone.cells, name))
    timed = len({zone.time for zone in zones}) > 1
    times = [zone.time if timed else None for zone in zones]
    strands = [zone.strand for zone in zones]
    return at_time(path, variables, blocks, without_static(times, strands, -1), "Tecplot binary", time)


def _zone(stream: _Bytes, count: int, packing: bool) -> _Zone:
    name = stream.text()
    _, strand = (int(own) for own in stream.take("i4", 2))  # the first is the zone's parent
    time = float(stream.take("f8")[0])
    stream.whole()
    kind = stream.whole()
    if kind != 0 and kind not in NAMES:
        raise stream.fault(
            f"zone {name!r} is of type {kind}: ordered zones, triangles, quadrilaterals, tetrahedra and bricks are read"
        )
    if packing and stream.whole() != 0:
        raise stream.fault(f"zone {name!r} is packed point by point")
    in_cells = [False] * count
    if stream.whole():
        in_cells = [bool(place) for place in stream.take("i4", count)]
    if stream.whole():
        raise stream.fault(f"zone {name!r} lists the neighbours of its faces")
    if stream.whole():
        raise stream.fault(f"zone {name!r} has connections of its own")
    if kind == 0:
        counts = tuple(int(n) for n in stream.take("i4", 3))
    else:
        counts = (stream.whole(), stream.whole())
        stream.take("i4", 3)
    if min(counts) < 1 or (max(counts) if kind else math.prod(counts)) > len(stream.data):
        raise stream.fault(f"zone {name!r} announces {counts} points")
    while stream.whole():
        stream.text(), stream.whole(), stream.text()
    return _Zone(name, strand, time, kind, in_cells, counts)


def _data(stream: _Bytes, zone: _Zone, before: list[_Zone], count: int) -> None:
    if stream.real() != ZONE:
        raise stream.fault(f"the data of zone {zone.name!r} do not begin where they should")
    kinds = [int(kind) for kind in stream.take("i4", count)]
    if not set(kinds) <= set(KINDS):
        raise stream.fault(f"zone {zone.name!r} has values of an unknown type")
    passive = stream.take("i4", count) if stream.whole() else np.zeros(count, int)
    shared = stream.take("i4", count) if stream.whole() else np.full(count, -1)
    connectivity = stream.whole()
    if max(connectivity, int(shared.max())) >= len(before):
        raise stream.fault(f"zone {zone.name!r} shares with a zone that is not there")
    stream.take("f8", 2 * int(((passive == 0) & (shared < 0)).sum()))  # the ranges of the values
    nodes = int(np.prod(zone.counts)) if zone.kind == 0 else zone.counts[0]
    for k in range(count):
        size = zone.cell_count if zone.in_cells[k] else nodes
        if shared[k] >= 0:
            zone.arrays.append(before[int(shared[k])].arrays[k])
            if len(zone.arrays[k]) != size:
                raise stream.fault(f"zone {zone.name!r} shares a variable of another size")
        elif passive[k]:
            zone.arrays.append(np.zeros(size))
        else:
            kind = KINDS[kinds[k]]
            values = _cell_values(stream, zone, kind) if zone.in_cells[k] else stream.take(kind, nodes)
            zone.arrays.append(values.astype(np.float64))
    if zone.kind:
        if connectivity >= 0:
            zone.cells = before[connectivity].cells
            return
        element, corners = ELEMENTS[NAMES[zone.kind]]
        index = stream.take("i4", corners * zone.counts[1]).astype(np.int64)
        if index.min() < 0 or index.max() >= nodes:
            raise stream.fault(f"elements of zone {zone.name!r} refer to nodes beyond the {nodes} that there are")
        zone.cells = element_cells(element, index.reshape(-1, corners))


def _cell_values(stream: _Bytes, zone: _Zone, kind: str) -> np.ndarray:
    if zone.kind:
        return stream.take(kind, zone.counts[1])
    counts = [n for n in zone.counts if n > 1] or [1]
    padded = [*counts[:-1], max(counts[-1] - 1, 1)]
    values = stream.take(kind, int(np.prod(padded))).reshape(padded[::-1])
    return values[(slice(None), *(slice(0, n - 1) for n in counts[-2::-1]))].ravel()
