"""Convert high-order cells to linear ones, and merge the points that discontinuous elements write once per element.

A Lagrange quadrilateral or hexahedron becomes the linear cells between its nodes. Points of different elements at the
same place become one point with the mean of their values: in a resolved flow these differ little. So do points in which
the pieces of a partitioned mesh meet.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import (
    GREATEST_COORDINATE,
    HEXAHEDRON,
    PRISM,
    QUAD,
    TETRAHEDRON,
    TRIANGLE,
    Block,
    Cells,
    ReadError,
)

TENSOR = {70: (QUAD, 2), 72: (HEXAHEDRON, 3)}  # VTK's Lagrange cells, the linear cells between their nodes, dimensions
# Other types keep their corners; at these point counts (first and second order) only nodes between them are lost.
BY_CORNERS = {69: (TRIANGLE, 3, (3, 6, 7)), 71: (TETRAHEDRON, 4, (4, 10)), 73: (PRISM, 6, (6, 15, 18))}
SAME = 1e-13  # of a mesh's size: points this close differ by rounding
LEAST_SHARE = 0.05  # of the points: from this share of duplicates on, elements have points of their own


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
    begin = np.concatenate([[0], np.cumsum(widths)])[:-1][order]
    start = np.concatenate([[0], np.cumsum(widths[order])])
    at = np.arange(start[-1]) + np.repeat(begin - start[:-1], widths[order])
    return start, flat[at], types[order], parent[order]


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


def _is_damaged(block: Block) -> bool:
    """Return whether coordinates or point numbers are invalid; later stages reject such blocks."""
    assert block.cells is not None
    numbers = [block.cells.points, *([] if block.cells.faces is None else [block.cells.faces.points])]
    with np.errstate(invalid="ignore"):
        placed = bool((np.abs(block.points) < GREATEST_COORDINATE).all())
    return not placed or any(len(own) and (own.min() < 0 or own.max() >= len(block.points)) for own in numbers)


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
    cells = block.cells
    if block.shape is not None or cells is None or _is_damaged(block) or _are_apart(block.points):
        return block, None
    near = SAME * float(np.ptp(block.points, axis=0).max())
    labels = np.empty(block.points.shape, np.int64)
    for axis, places in enumerate(block.points.T):
        order = np.argsort(places)
        labels[order, axis] = np.cumsum(np.diff(places[order], prepend=places[order[0]]) > near)
    _, first, number = np.unique(labels, axis=0, return_index=True, return_inverse=True)
    number, twice = number.ravel(), len(block.points) - len(first)
    said = "elements that have points of their own are written"
    if twice < LEAST_SHARE * len(block.points):
        said = "the pieces of a partitioned mesh are written"
        if not _are_of_pieces(cells, number):
            return block, None
    counts = _counting(block)
    weight = np.where(np.bincount(number, counts) > 0.0, 0.0, 1.0)[number] + counts
    total = np.bincount(number, weight)

    def mean(values: np.ndarray) -> np.ndarray:
        columns = values.reshape(len(values), -1).astype(np.float64).T
        with np.errstate(invalid="ignore"):  # NaN in ghost cells
            kept = np.where(weight > 0.0, columns, 0.0)
            found = np.stack([np.bincount(number, own * weight) / total for own in kept], axis=1)
        return found.reshape(-1, *values.shape[1:])

    blank = block.blank
    if blank is not None and len(blank) == len(block.points) != len(cells):
        blank = mean(blank) > 0.0
    faces = None if cells.faces is None else replace(cells.faces, points=number[cells.faces.points])
    made = replace(
        block,
        points=block.points[first],
        cells=replace(cells, points=number[cells.points], faces=faces),
        point_data={name: mean(values) for name, values in block.point_data.items()},
        blank=blank,
    )
    return made, (
        f"{twice} of {len(block.points)} points coincide with another, as {said}: each place has the mean of the "
        "values there"
    )


def _counting(block: Block) -> np.ndarray:
    """Return 1 for points of cells that are not blanked, else 0, shape (point_count,)."""
    assert block.cells is not None
    counts = np.ones(len(block.points))
    if block.blank is not None and len(block.blank) == len(block.cells):
        counts[:] = 0.0
        counts[block.cells.points[np.repeat(~block.blank, np.diff(block.cells.start))]] = 1.0
    return counts


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
