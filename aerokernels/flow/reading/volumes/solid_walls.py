"""The body in a volume: a closed surface of triangles, from the faces of wall patches or from holes in the mesh.

Faces are joined where their corners coincide, given a common orientation, and openings are closed: a body that is cut
off at the end of the field is closed flat there. A surface bounds a body if the flow is outside it; a surface with the
flow inside, such as a tunnel's walls or the outer edge of a mesh, bounds none.
"""

from collections.abc import Sequence

import numpy as np

from aerokernels.flow.reading.dataset import Block, Polygons, ReadError, starts_of, wall_patches
from aerokernels.flow.reading.planes.polygons import joined
from aerokernels.flow.reading.volumes.solids import FACES, NodeGrid, corner_chunks
from aerokernels.medium import SolidBody


def solid_body(reading, moved: Sequence[np.ndarray], grid: NodeGrid) -> SolidBody | None:
    """Return the body of a volume: its walls', or that in the holes of its mesh; None if it has none.

    `moved` are the points of the blocks in the optical frame [m], each (n, 3); the cells were rasterised into `grid`.
    """
    path, dataset = reading.path, reading.dataset
    known = [patch for patch in dataset.patches if patch.polygons is not None]
    walls = [own for patch in wall_patches(path, known, reading.options["walls"]) if (own := patch.polygons)]
    if walls:
        parts = [Polygons(reading.moved(own.points), own.start) for own in walls]
    elif (grid.cell >= 0).all():
        return None
    else:
        parts = [boundary_polygons(block, points) for block, points in zip(dataset.blocks, moved, strict=True)]
    size = float(max(np.ptp(np.concatenate(moved), axis=0).max(), 1e-300))
    try:
        vertices, triangles = _triangles(parts, 1e-9 * size)
        return _body(vertices, triangles, grid, size) if len(triangles) else None
    except ValueError as fault:
        if not walls:  # without wall patches, faces that form no surface leave it open what is a hole
            return None
        raise ReadError(path, f"its walls make no body: {fault}", "repair the boundary's patches") from None


def boundary_polygons(block: Block, points: np.ndarray) -> Polygons:
    """Return the faces of a block that belong to only one cell with flow."""
    faces = None if block.cells is None else block.cells.faces
    if faces is not None:
        first, start = len(faces.neighbour), faces.start
        return Polygons(points[faces.points[start[first] :]], start[first:] - start[first])
    label = np.random.default_rng(7).integers(1, 2**63, len(points), dtype=np.uint64)

    def faces_of(chunk) -> tuple[np.ndarray, np.ndarray]:
        corners = chunk.corners if block.blank is None else chunk.corners[:, ~block.blank[chunk.cell]]
        four = corners[np.array(FACES[chunk.kind])]  # (f, 4, n)
        own = label[four]
        triangle = four[:, 2] == four[:, 3]
        return four, own[:, 0] + own[:, 1] + own[:, 2] + np.where(triangle, np.uint64(0), own[:, 3])

    keys = [faces_of(chunk)[1].ravel() for chunk in corner_chunks(block)]
    if not keys:
        return Polygons(np.empty((0, 3)), np.zeros(1, np.int64))
    result, count = np.unique(np.concatenate(keys), return_counts=True)
    alone = result[count == 1]
    kept = []
    for chunk in corner_chunks(block):
        four, key = faces_of(chunk)
        place = np.minimum(np.searchsorted(alone, key), max(len(alone) - 1, 0))
        face, cell = np.nonzero(alone[place] == key) if len(alone) else (np.empty(0, int), np.empty(0, int))
        kept.append(four[face, :, cell])
    corners = np.concatenate(kept)
    return Polygons(points[corners.ravel()], 4 * np.arange(len(corners) + 1))


def _triangles(parts: list[Polygons], near: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices [m] and triangles of polygons, joined where they meet; faces listed twice are left out."""
    points = np.concatenate([part.points for part in parts])
    width = np.concatenate([np.diff(part.start) for part in parts])
    first, vertex = joined(points, near)
    vertices = points[first]
    face = np.repeat(np.arange(len(width)), width)
    # A face is identified by its corners in any order; a face that occurs twice has the flow on both sides.
    label = np.random.default_rng(8).integers(1, 2**63, len(vertices), dtype=np.uint64)
    distinct = np.unique(np.stack([face, vertex], axis=1), axis=0)
    key = np.zeros(len(width), np.uint64)
    np.add.at(key, distinct[:, 0], label[distinct[:, 1]])
    _, back, count = np.unique(key, return_inverse=True, return_counts=True)
    alone = count[back.ravel()] == 1
    start = starts_of(width)
    result = []
    for corners in np.unique(width[alone]):
        own = np.flatnonzero(alone & (width == corners))
        ring = vertex[start[own][:, None] + np.arange(corners)]
        if corners == 3:
            result.append(ring)
        elif corners == 4:
            result += [ring[:, [0, 1, 2]], ring[:, [0, 2, 3]]]
        else:
            middle = len(vertices) + np.arange(len(ring))
            vertices = np.concatenate([vertices, vertices[ring].mean(axis=1)])
            result += [np.stack([ring[:, k], ring[:, (k + 1) % corners], middle], axis=1) for k in range(corners)]
    triangles = np.concatenate(result) if result else np.empty((0, 3), np.int64)
    a, b, c = triangles.T
    return vertices, triangles[(a != b) & (b != c) & (c != a)]


def _body(vertices: np.ndarray, triangles: np.ndarray, grid: NodeGrid, size: float) -> SolidBody | None:
    """Return the closed surfaces with the flow outside, as one body."""
    triangles, part = _turned_alike(triangles)
    result = []
    for number in range(part.max() + 1):
        own = triangles[part == number]
        whole, own = _closed(vertices, own)
        corner = whole[own]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        volume = float(np.einsum("nk,nk->n", corner[:, 0] - whole.mean(axis=0), normal).sum() / 6.0)
        # Of the field's size cubed: a smaller volume bounds no body.
        if abs(volume) <= 1e-9 * size**3:
            continue
        if _flow_outside(corner[: (part == number).sum()], np.sign(volume), grid):
            result.append((whole, own))
    if not result:
        return None
    shift = starts_of([len(whole) for whole, _ in result])
    everything = np.concatenate([whole for whole, _ in result])
    used, corners = np.unique(
        np.concatenate([own + first for (_, own), first in zip(result, shift, strict=False)]), return_inverse=True
    )
    return SolidBody(everything[used], corners.reshape(-1, 3))


def _edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()


def _turned_alike(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles with a common orientation of neighbours, and the number of each one's surface."""
    count = len(triangles)
    a, b = _edges(triangles)
    low, high = np.minimum(a, b), np.maximum(a, b)
    order = np.lexsort((high, low))
    same = (low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1])
    if (same[1:] & same[:-1]).any():
        raise ValueError("three faces share an edge")
    one, other = order[:-1][same], order[1:][same]
    alike = a[one] != a[other]  # each goes along the edge the other way
    first, second = one // 3, other // 3
    # The graph has a node for every triangle as listed, and one for it reversed; consistent orientations are joined.
    row = np.concatenate([first, first + count])
    column = np.concatenate([np.where(alike, second, second + count), np.where(alike, second + count, second)])
    label = _components(row, column, 2 * count)
    plain, turned = label[:count], label[count:]
    if (plain == turned).any():
        raise ValueError("a surface has one side only")
    part = np.unique(np.minimum(plain, turned), return_inverse=True)[1].ravel()
    return np.where((plain > turned)[:, None], triangles[:, ::-1], triangles), part


def _components(row: np.ndarray, column: np.ndarray, count: int) -> np.ndarray:
    """Return the connected component of each of `count` nodes, from pairs that are joined."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    joined = coo_matrix((np.ones(len(row), bool), (row, column)), shape=(count, count))
    return connected_components(joined, directed=False)[1]


def _closed(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a surface with each of its openings closed by a fan of triangles around the mean of its rim."""
    a, b = _edges(triangles)
    count = len(vertices)
    open_edges = np.flatnonzero(~np.isin(a * count + b, b * count + a))
    if not len(open_edges):
        return vertices, triangles
    begin, end = b[open_edges], a[open_edges]  # in the direction of the closing triangles
    if len(np.unique(begin)) < len(begin):
        raise ValueError("the rim of a wall touches itself")
    number = np.unique(np.concatenate([begin, end]), return_inverse=True)[1].reshape(2, -1)
    rims = int(number.max()) + 1
    rim = _components(number[0], number[1], rims)[number[0]]
    total = np.bincount(rim)
    middle = np.stack([np.bincount(rim, vertices[begin, k]) / total for k in range(3)], axis=1)
    fans = np.stack([begin, end, count + rim], axis=1)
    return np.concatenate([vertices, middle]), np.concatenate([triangles, fans])


def _flow_outside(corner: np.ndarray, outward: float, grid: NodeGrid) -> bool:
    """Return whether the flow is outside a surface, from which nodes near its triangles are in cells."""
    normal = outward * np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normal, axis=1)
    step = normal / np.maximum(area, 1e-300)[:, None] * float(np.linalg.norm(grid.spacing))
    middle = corner.mean(axis=1)
    votes = 0.0
    for side in (1.0, -1.0):
        index = np.rint((middle + side * step - grid.low) / grid.spacing).astype(np.int64)
        there = np.all((index >= 0) & (index < grid.shape), axis=1)
        node = np.ravel_multi_index(tuple(index[there].T), grid.shape)
        votes += side * float(area[there] @ (grid.cell[node] >= 0))
    return votes >= 0.0
