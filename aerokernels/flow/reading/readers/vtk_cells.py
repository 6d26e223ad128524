"""Cells of VTK's data: high-order ones become linear, points that discontinuous elements write once each are merged.

A Lagrange quadrilateral or hexahedron becomes the linear cells between its nodes. Points of different elements at the
same place become one point with the mean of their values: in a resolved flow these differ little. So do points in which
the pieces of a partitioned mesh meet.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import (
    CORNERS,
    DAMAGED,
    FLAT,
    SOLID,
    Block,
    Cells,
    Faces,
    ReadError,
    entries_of,
    starts_of,
)
from aerokernels.flow.reading.volumes.solids import FACES

# By VTK's numbers of types: Lagrange cells, the quadrilaterals or hexahedra between their nodes, dimensions.
TENSOR = {70: (9, 2), 72: (12, 3)}
# Other types keep their corners; at these point counts (first and second order) only nodes between them are lost.
BY_CORNERS = {69: (5, 3, (3, 6, 7)), 71: (10, 4, (4, 10)), 73: (13, 6, (6, 15, 18))}
# Voxel and pixel corners in the order of a hexahedron or quadrilateral.
STRUCTURED = {11: (12, [0, 1, 3, 2, 4, 5, 7, 6]), 8: (9, [0, 1, 3, 2])}
# Quadratic cells, which list their corners first, and the linear cell of each.
QUADRATIC = {21: 3, 35: 3, 22: 5, 34: 5, 23: 9, 28: 9, 30: 9, 24: 10, 25: 12, 29: 12, 33: 12, 26: 13, 31: 13, 32: 13,
             27: 14, 37: 14}  # fmt: skip
NO_FLOW = (0, 1, 2, 3, 4, 51, 60, 68, 75)  # empty cells, points, lines and curves


def cells_of(path: Path | str, data, notes: dict[str, None]) -> tuple[Cells | None, np.ndarray | None]:
    """Return the cells, and the file's cell that each came from if high-order cells were divided, else None."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkVersion
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    def listed(array) -> tuple[np.ndarray, np.ndarray]:
        own = array.GetOffsetsArray(), array.GetConnectivityArray()
        return vtk_to_numpy(own[0]).astype(np.int64), vtk_to_numpy(own[1]).astype(np.int64)

    count = data.GetNumberOfCells()
    if not count:
        return None, None
    if isinstance(data, vtkPolyData):
        polygons = data.GetPolys().GetNumberOfCells()
        if polygons not in (0, count):
            raise ReadError(path, "it mixes polygons with lines or points", "give a surface of polygons, or a grid")
        start, points = listed(data.GetPolys())
        return Cells.polygons(np.diff(start), points) if polygons else None, None
    start, points = listed(data.GetCells())
    # VTK 9.6 renamed the method.
    named_anew = (vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()) >= (9, 6)
    types = data.GetCellTypes() if named_anew else data.GetCellTypesArray()
    kinds = (np.array([data.GetCellType(0)]) if count == 1 else vtk_to_numpy(types)).astype(np.uint8)
    corners = {kind: CORNERS.get(plain, 2) for kind, plain in QUADRATIC.items()}
    corners |= {kind: own for kind, (_, own, _) in BY_CORNERS.items()}
    between = [(kinds == kind) & (np.diff(start) > own) for kind, own in corners.items() if own > 2]
    if second := int(sum(own.sum() for own in between)):
        notes[f"{second} of {len(kinds)} cells are of second order: they are read by their corners alone"] = None
    start, points, kinds = _linear(start, points, kinds)
    start, points, kinds, parent = linear_cells(path, start, points, kinds)
    if len(unknown := np.setdiff1d(kinds, [*NO_FLOW, *FLAT, *SOLID])):
        raise ReadError(
            path, f"it has cells of VTK's type {unknown[0]}, which are not read", "write triangles, quadrilaterals, "
            "polygons, tetrahedra, hexahedra, prisms, pyramids or polyhedra"
        )  # fmt: skip
    if not (kinds == 42).any():
        return Cells(kinds, start, points), parent
    if parent is not None:
        raise ReadError(path, "it has polyhedra and cells of high order", "write linear cells")
    faces, of_cells = data.GetPolyhedronFaces(), data.GetPolyhedronFaceLocations()
    if faces is None or of_cells is None or of_cells.GetNumberOfCells() != len(kinds):
        raise ReadError(path, "its polyhedra have no faces", DAMAGED)
    return Cells(kinds, start, points, _faces(path, listed(faces), listed(of_cells), (start, points, kinds))), None


def _faces(path, faces, of_cells, cells) -> Faces:
    """Return the faces of all cells; a face between two cells is listed twice, once for each."""
    (begin, flat), (first, number), (start, points, kinds) = faces, of_cells, cells
    if len(number) and (number.min() < 0 or number.max() >= len(begin) - 1):
        raise ReadError(path, "its polyhedra name faces that are not there", DAMAGED)
    width = np.diff(begin)[number]
    widths, corners = [width], [flat[entries_of(begin[number], width)]]
    owner = [np.repeat(np.arange(len(kinds)), np.diff(first))]
    for kind, table in FACES.items():
        own = np.flatnonzero(kinds == kind)
        for face in table:
            ring = list(dict.fromkeys(face))  # a triangle names its last corner twice
            corners.append(points[start[own][:, None] + ring].ravel())
            widths.append(np.full(len(own), len(ring)))
            owner.append(own)
    ends = starts_of(np.concatenate(widths))
    return Faces(ends, np.concatenate(corners), np.concatenate(owner), np.empty(0, np.int64))


def _linear(start, points, kinds):
    """Convert voxels and pixels to hexahedra and quadrilaterals, and quadratic cells to their corners."""
    for kind, (plain, order) in STRUCTURED.items():
        own = np.flatnonzero(kinds == kind)
        if len(own):
            entry = start[own][:, None] + np.arange(len(order))
            points = points.copy()
            points[entry] = points[entry[:, order]]
            kinds = np.where(kinds == kind, plain, kinds).astype(np.uint8)
    if np.isin(kinds, list(QUADRATIC)).any():
        keep = np.diff(start)
        for kind, plain in QUADRATIC.items():
            keep[kinds == kind] = {3: 2, **CORNERS}[plain]
            kinds = np.where(kinds == kind, plain, kinds).astype(np.uint8)
        points, start = points[entries_of(start[:-1], keep)], starts_of(keep)
    return start, points, kinds


def linear_cells(path, start: np.ndarray, points: np.ndarray, kinds: np.ndarray):
    """Return Lagrange cells as linear ones: start, points and types of the cells, and the original cell of each."""
    high = np.isin(kinds, [*TENSOR, *BY_CORNERS])
    if not high.any():
        return start, points, kinds, None
    width = np.diff(start)
    parts = []  # for each type and width: the cells, their linear parts' type and corners [cell, part, corner]
    for kind, count in np.unique(np.stack([kinds, width])[:, high], axis=1).T:
        own = np.flatnonzero((kinds == kind) & (width == count))
        linear, table = _parts(path, int(kind), int(count))
        parts.append((own, linear, points[start[own][:, None, None] + table]))
    for width_of, kind in np.unique(np.stack([width, kinds])[:, ~high], axis=1).T:
        own = np.flatnonzero(~high & (width == width_of) & (kinds == kind))
        parts.append((own, int(kind), points[start[own][:, None] + np.arange(width_of)][:, None]))
    parent = np.concatenate([np.repeat(own, corners.shape[1]) for own, _, corners in parts])
    order = np.argsort(parent, kind="stable")
    types = np.concatenate([np.full(len(own) * corners.shape[1], kind, np.uint8) for own, kind, corners in parts])
    widths = np.concatenate([np.full(len(own) * corners.shape[1], corners.shape[2]) for own, _, corners in parts])
    flat = np.concatenate([corners.ravel() for _, _, corners in parts])
    at = entries_of(starts_of(widths)[:-1][order], widths[order])
    return starts_of(widths[order]), flat[at], types[order], parent[order]


def _parts(path, kind: int, count: int) -> tuple[int, np.ndarray]:
    """Return the type of a Lagrange cell's linear parts, and their corners as indices into its points."""
    if kind in BY_CORNERS:
        linear, corners, known = BY_CORNERS[kind]
        if count in known:
            return linear, np.arange(corners)[None]
        what = f"Lagrange cells of VTK's type {kind} with {count} points, of high order"
    else:
        linear, axes = TENSOR[kind]
        nodes = round(count ** (1.0 / axes))
        if nodes**axes == count and nodes > 1:
            return linear, _between_nodes(nodes, axes)
        what = f"Lagrange cells of VTK's type {kind} with {count} points, whose order is not the same in all directions"
    raise ReadError(path, f"it has {what}", "write linear cells (of as many points as the flow needs)")


def _between_nodes(nodes: int, axes: int) -> np.ndarray:
    """Return the corners of the linear cells between the nodes of a Lagrange quadrilateral or hexahedron."""
    from vtkmodules.vtkCommonDataModel import vtkHigherOrderHexahedron, vtkHigherOrderQuadrilateral

    place: Any = (vtkHigherOrderQuadrilateral if axes == 2 else vtkHigherOrderHexahedron).PointIndexFromIJK
    table = np.array([place(*index, [nodes - 1] * axes) for index in np.ndindex(*[nodes] * axes)])
    table = table.reshape([nodes] * axes)
    across = [(0, 0), (1, 0), (1, 1), (0, 1)]
    corners = across if axes == 2 else [(i, j, k) for k in (0, 1) for i, j in across]
    cut = [table[tuple(slice(s, nodes - 1 + s) for s in shift)].ravel() for shift in corners]
    return np.stack(cut, axis=1)


def _are_apart(points: np.ndarray) -> bool:
    """Return whether no points share a place, by a quick hash."""
    size = max(float(np.ptp(points, axis=0).max()), 1e-300)
    places = np.round((points - points.min(axis=0)) / (1e-10 * size) + 0.3).astype(np.uint64)
    key = places @ np.random.default_rng(9).integers(1, 2**63, 3, dtype=np.uint64)
    key.sort()
    return not (key[1:] == key[:-1]).any()


def joined(block: Block) -> tuple[Block, str | None]:
    """Return the block with coincident points merged if its elements or pieces have points of their own, and a note.

    Points of blanked cells alone, such as the ghost cells of a piece, do not count in the mean of a place.
    """
    cells, blank = block.cells, block.blank
    if block.shape is not None or cells is None or _are_apart(block.points):
        return block, None
    near = 1e-13 * float(np.ptp(block.points, axis=0).max())  # points this close differ by rounding
    labels = np.empty(block.points.shape, np.int64)
    for axis, places in enumerate(block.points.T):
        order = np.argsort(places)
        labels[order, axis] = np.cumsum(np.diff(places[order], prepend=places[order[0]]) > near)
    _, first, number = np.unique(labels, axis=0, return_index=True, return_inverse=True)
    number, twice = number.ravel(), len(block.points) - len(first)
    said = "elements that have points of their own are written"
    if twice < 0.05 * len(block.points):  # from this share of duplicates on, elements have points of their own
        said = "the pieces of a partitioned mesh are written"
        if not _are_of_pieces(cells, number):
            return block, None
    of_cells = blank is not None and len(blank) == len(cells)
    counts = np.ones(len(block.points))
    if blank is not None and of_cells:
        counts[:] = 0.0
        counts[cells.points[np.repeat(~blank, np.diff(cells.start))]] = 1.0
    weight = np.where(np.bincount(number, counts) > 0.0, 0.0, 1.0)[number] + counts
    total = np.bincount(number, weight)

    def mean(values: np.ndarray) -> np.ndarray:
        columns = values.reshape(len(values), -1).astype(np.float64).T
        with np.errstate(invalid="ignore"):  # NaN in ghost cells
            kept = np.where(weight > 0.0, columns, 0.0)
            result = np.stack([np.bincount(number, own * weight) / total for own in kept], axis=1)
        return result.reshape(-1, *values.shape[1:])

    faces = None if cells.faces is None else replace(cells.faces, points=number[cells.faces.points])
    whole = replace(
        block,
        points=block.points[first],
        cells=replace(cells, points=number[cells.points], faces=faces),
        point_data={name: mean(values) for name, values in block.point_data.items()},
        blank=blank if blank is None or of_cells else mean(blank) > 0.0,
    )
    note = f"{twice} of {len(block.points)} points coincide with another, as {said}"
    return whole, f"{note}: each place has the mean of the values there"


def _are_of_pieces(cells: Cells, number: np.ndarray) -> bool:
    """Return whether all points of one place (of one `number`) belong to pieces that share no other point.

    Coincident points within a piece are damage, or a wall of no thickness: they are not merged.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    width, count = np.diff(cells.start), len(number)
    whole = width > 0
    first = np.repeat(cells.points[cells.start[:-1][whole]], width[whole])
    links = coo_array((np.ones(len(first), np.int8), (first, cells.points)), (count, count))
    pieces = connected_components(links, directed=False)[1]
    return len(np.unique(np.stack([number, pieces]), axis=1).T) == count
