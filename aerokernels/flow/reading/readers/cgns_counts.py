"""Compare the arrays of a CGNS file in HDF5 with the sizes of their zones before VTK's reader takes them.

By the standard (SIDS) a zone of dimension d has d counts of vertices and d of cells; an unstructured zone has d = 1. An
array has one value for each vertex or cell, by its solution's GridLocation (Vertex if none is stated), and for the rows
of ghosts beyond both ends of each axis that Rind states. VTK's reader allocates by these sizes and reads what the array
holds: of a shorter array the rest is memory that nobody wrote.
"""

from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import Block, ReadError
from aerokernels.flow.reading.readers.cgns_nodes import Node, child, children, data_of, opened, text_of
from aerokernels.flow.reading.readers.cgns_walls import POINTS

REMEDY = "write the file again, with each array at its GridLocation and ghosts stated by Rind"
# Types of the file's nodes by those of HDF5: VTK reads an array by the first, into room for the second.
TYPES = {"f4": "R4", "f8": "R8", "i4": "I4", "i8": "I8", "u4": "U4", "u8": "U8"}


def check_counts(path: Path) -> dict[str, int]:
    """Check the shapes of coordinates and solutions, and return the cells of each unstructured zone by its name.

    A file in ADF is not looked into.

    Raises:
        ReadError: An array whose shape its zone, location and Rind do not give: zone, array, both shapes.
    """
    counts: dict[str, int] = {}
    with opened(path) as root:
        for base in [] if root is None else children(root, "CGNSBase_t"):
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


def check_cells(path: Path, blocks: list[Block], counts: dict[str, int]) -> None:
    """Check that the zones that were read have as many cells as they state."""
    for block in blocks:
        if counts.get(block.name, block.cell_count) != block.cell_count:
            fault = f"zone {block.name!r} states {counts[block.name]} cells, and its elements are {block.cell_count}"
            raise ReadError(path, fault, REMEDY)


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
