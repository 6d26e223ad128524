"""Nodes of a CGNS file in HDF5, read on demand; their arrays are compared with the sizes of their zones.

By the standard (SIDS) a zone of dimension d has d counts of vertices and d of cells; an unstructured zone has d = 1. An
array has one value for each vertex or cell, by its solution's GridLocation (Vertex if none is stated), and for the rows
of ghosts beyond both ends of each axis that Rind states. VTK's reader allocates by these sizes and reads what the array
holds: of a shorter array the rest is memory that nobody wrote.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import HDF5_MAGIC, ReadError

# Number of points of each type of element.
POINTS = {2: 1, 3: 2, 4: 3, 5: 3, 6: 6, 7: 4, 8: 8, 9: 9, 10: 4, 11: 10, 12: 5, 13: 14, 14: 6, 15: 15, 16: 18, 17: 8,
          18: 20, 19: 27, 21: 13}  # fmt: skip


class Node:
    """A node of a tree.

    Attributes:
        name: Its name.
        label: Its type, as in "Zone_t".
        data: Its data as an array or an HDF5 dataset; None for a node without data.
        type: The type of its data that the file states, as in "R8".
    """

    def __init__(
        self, name: str, label: str, data: Any = None, below: Callable[[], Iterable["Node"]] = tuple, type: str = ""
    ):
        """Create a node; `below` returns its children and is called when they are first needed."""
        self.name, self.label, self.data, self._below, self.type = name, label, data, below, type

    @cached_property
    def below(self) -> list["Node"]:
        """The children of the node."""
        return list(self._below())


@contextmanager
def opened(path: Path) -> Iterator[Node | None]:
    """Open a CGNS file in HDF5 as its root node; None for a file in ADF."""
    with path.open("rb") as stream:
        is_hdf5 = stream.read(len(HDF5_MAGIC)) == HDF5_MAGIC
    if not is_hdf5:
        yield None
        return
    import h5py

    with h5py.File(path, "r") as file:
        yield node_of(file)


def node_of(group: Any) -> Node:
    """Return an HDF5 group and all groups below it as a node."""
    import h5py

    data = group.get(" data")
    return Node(
        str(group.name.rsplit("/", 1)[-1]),
        decoded(group.attrs.get("label", b"")),
        data if isinstance(data, h5py.Dataset) else None,
        lambda: (node_of(own) for own in map(group.__getitem__, group) if isinstance(own, h5py.Group)),
        decoded(group.attrs.get("type", b"")),
    )


def children(node: Node, label: str) -> list[Node]:
    """Return the children of a node that have a given label."""
    return [own for own in node.below if own.label == label]


def child(node: Node, *names: str) -> Node | None:
    """Return the first child with data that has one of these names, or None."""
    return next((own for name in names for own in node.below if own.name == name and own.data is not None), None)


def array_paths(root: Node, *labels: str) -> Iterator[list[Node]]:
    """Yield the nodes above each array of the zones' parts of these labels, from the root to the array itself."""
    for base in children(root, "CGNSBase_t"):
        for zone in children(base, "Zone_t"):
            for part in (own for label in labels for own in children(zone, label)):
                for array in children(part, "DataArray_t"):
                    yield [root, base, zone, part, array]


def class_of(above: list[Node]) -> str:
    """Return the class of an array's data, as the last of its nodes that has one states it; empty if none does."""
    return next((text_of(own) for node in reversed(above) for own in reversed(children(node, "DataClass_t"))), "")


def data_of(node: Node) -> np.ndarray:
    """Return the data of a node, in HDF5's order of axes.

    Raises:
        ValueError: The node has no data.
    """
    if node.data is None:
        raise ValueError(f"node {node.name!r} has no data")
    return np.asarray(node.data[...])


def decoded(value: Any) -> str:
    """Return an HDF5 text attribute as a str."""
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def text_of(node: Node) -> str:
    """Return the data of a node as a text; empty for a node without data."""
    return "" if node.data is None else data_of(node).tobytes().decode("latin-1").strip(" \0")


REMEDY = "write the file again, with each array at its GridLocation and ghosts stated by Rind"
# Types of the file's nodes by those of HDF5: VTK reads an array by the first, into room for the second.
TYPES = {"f4": "R4", "f8": "R8", "i4": "I4", "i8": "I8", "u4": "U4", "u8": "U8"}


def check_counts(path: Path, root: Node) -> dict[str, int]:
    """Check the shapes of coordinates and solutions, and return the cells of each unstructured zone by its name."""
    counts: dict[str, int] = {}
    for base in children(root, "CGNSBase_t"):
        dimension = _whole(path, base, 2)[0]
        for zone in children(base, "Zone_t"):
            structured = next((text_of(own) for own in children(zone, "ZoneType_t")), "Structured") == "Structured"
            vertices, cells = _sizes(path, zone, int(dimension) if structured else 0)
            if not structured:
                counts[zone.name] = int(cells[0])
            for grid in children(zone, "GridCoordinates_t"):
                _check_arrays(path, zone, grid, vertices)
            for section in children(zone, "Elements_t"):
                _check_elements(path, zone, section)
            for solution in children(zone, "FlowSolution_t"):
                _check_solution(path, zone, solution, vertices, cells)
    return counts


def _sizes(path: Path, zone: Node, axes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the counts of vertices and of cells along each axis of a zone; an unstructured one has 0 axes."""
    vertices, cells, _ = sizes = _whole(path, zone, 3 * max(axes, 1)).reshape(3, -1)
    alone = (vertices == 1) & (cells == 1)  # along an axis of one vertex some programs count a cell
    if (vertices < 1).any() or (cells < 0).any() or (axes and ((cells != vertices - 1) & ~alone).any()):
        raise ReadError(path, f"zone {zone.name!r} states the sizes {sizes.tolist()}", REMEDY)
    return vertices, cells


def _check_elements(path: Path, zone: Node, section: Node) -> None:
    """Check that a section has the corners of the elements that it announces."""
    own, start = child(section, "ElementConnectivity"), child(section, "ElementStartOffset")
    limits = child(section, "ElementRange")
    if own is None or limits is None:
        raise ReadError(path, f"section {section.name!r} of zone {zone.name!r} has no elements", REMEDY)
    first, last = _whole(path, limits, 2)
    kind, held = int(_whole(path, section, 2)[0]), len(data_of(own).ravel())
    if kind in POINTS:
        wanted = POINTS[kind] * int(last + 1 - first)
    elif start is not None:
        offsets = _whole(path, start, int(last + 2 - first))
        wanted = int(offsets[-1])
    else:  # before CGNS 4 each polygon begins with its number of corners, and each mixed element with its type
        return
    if held != wanted:
        fault = (
            f"section {section.name!r} of zone {zone.name!r} has {held} corners, elements {first} to {last} {wanted}"
        )
        raise ReadError(path, fault, REMEDY)


def _check_solution(path: Path, zone: Node, solution: Node, vertices: np.ndarray, cells: np.ndarray) -> None:
    where = next((text_of(own) for own in children(solution, "GridLocation_t")), "Vertex")
    at = f"{solution.name} of zone {zone.name!r}"
    if where not in ("Vertex", "CellCenter"):
        raise ReadError(path, f"{at} is at {where}", "write it at Vertex or CellCenter")
    if any(own.name in ("PointList", "PointRange") for own in solution.below):
        raise ReadError(path, f"{at} is at a list of places, not at all of them", "write the whole solution")
    _check_arrays(path, zone, solution, vertices if where == "Vertex" else cells, where)


def _check_arrays(path: Path, zone: Node, holder: Node, counts: np.ndarray, where: str = "Vertex") -> None:
    ghosts = np.zeros(2 * len(counts), np.int64)
    for rind in children(holder, "Rind_t"):
        ghosts = _whole(path, rind, len(ghosts))
    if (ghosts < 0).any() or (len(counts) == 1 and ghosts.any()):  # VTK reads no ghosts of unstructured zones
        fault = f"{holder.name} of zone {zone.name!r} has the Rind {ghosts.tolist()}"
        raise ReadError(path, fault, "write the zone without its ghosts")
    wanted = tuple(int(own) for own in (counts + ghosts[::2] + ghosts[1::2])[::-1])  # HDF5 has the last axis first
    for array in children(holder, "DataArray_t"):
        held = getattr(array.data, "shape", ())
        if held != wanted:
            more = f" and Rind {ghosts.tolist()}" if ghosts.any() else ""
            raise ReadError(
                path,
                f"{array.name} in {holder.name} of zone {zone.name!r} has the shape {held}, and {where} with the "
                f"zone's sizes{more} is {wanted}",
                REMEDY,
            )
        assert array.data is not None
        if TYPES.get(array.data.dtype.str[1:]) != array.type:
            fault = f"{array.name} in {holder.name} is of {array.data.dtype}, and its type is {array.type!r}"
            raise ReadError(path, fault, REMEDY)


def _whole(path: Path, node: Node, count: int) -> np.ndarray:
    """Return the whole numbers of a node."""
    found = data_of(node).ravel() if node.data is not None else np.empty(0)
    if len(found) != count or found.dtype.kind not in "iu":
        raise ReadError(path, f"node {node.name!r} ({node.label}) has no {count} whole numbers", REMEDY)
    return found.astype(np.int64)
