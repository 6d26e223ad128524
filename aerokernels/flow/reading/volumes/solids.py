"""Solid cells in chunks: faces, volumes and centroids, for all cell types alike.

A face is treated as the plane through its centroid perpendicular to its area vector. Where the four corners of a face
are not in a plane, both cells that share it use the same plane, so that there is no gap between them. Cells are
rasterised into uniform grids of nodes on all cores, in bounded memory.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from aerokernels.flow.reading.dataset import CORNERS, HEXAHEDRON, POLYHEDRON, PRISM, PYRAMID, TETRAHEDRON, Block, Faces
from aerokernels.process.machine import core_count
from aerokernels.process.threads import in_turn

# Faces by their corners, counter-clockwise seen from outside; a triangle repeats its last corner.
FACES = {
    TETRAHEDRON: [(0, 2, 1, 1), (0, 1, 3, 3), (1, 2, 3, 3), (2, 0, 3, 3)],
    HEXAHEDRON: [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
    PRISM: [(0, 1, 2, 2), (3, 5, 4, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)],
    PYRAMID: [(0, 3, 2, 1), (0, 1, 4, 4), (1, 2, 4, 4), (2, 3, 4, 4), (3, 0, 4, 4)],
}
CORNER_COUNT = {kind: CORNERS[kind] for kind in FACES}
CHUNK = 16_384  # cells processed together: fits in a core's cache


@dataclass(frozen=True, eq=False)
class Solids:
    """Some cells of a block; the first axis of vectors is the component, and the last axis is the cell."""

    cell: np.ndarray  # their numbers in the block, shape (n,)
    area: np.ndarray  # outward area vectors of their faces [m2], shape (3, f, n)
    centre: np.ndarray  # centroids of their faces [m], shape (3, f, n)
    low: np.ndarray  # lowest corner of the box around each [m], shape (3, n)
    high: np.ndarray  # highest corner [m], shape (3, n)
    volume: np.ndarray  # [m3], negative for cells that are inside out, shape (n,)
    middle: np.ndarray  # centroids [m], shape (3, n)


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some cells of one type, by their corners, before their geometry is computed."""

    kind: int  # VTK's number of the type
    cell: np.ndarray  # their numbers in the block, shape (n,)
    corners: np.ndarray  # points of each, shape (k, n)

    def solids(self, across: np.ndarray) -> Solids:
        """Compute faces, volumes and centroids from the coordinates of all points [m], shape (3, point_count)."""
        at = across[:, self.corners]
        table = FACES[self.kind]
        a, b, c, d = (at[:, [face[k] for face in table]] for k in range(4))
        area = 0.5 * _cross(c - a, d - b)
        centre = a + b
        centre += c
        for number, face in enumerate(table):
            if face[2] == face[3]:
                centre[:, number] /= 3.0
            else:
                centre[:, number] += d[:, number]
                centre[:, number] *= 0.25
                centre[:, number] += _from_mean([own[:, number] for own in (a, b, c, d)], centre[:, number])
        result = _finished(self.cell, area, centre, at.min(axis=1), at.max(axis=1), at.mean(axis=1))
        if self.kind != PRISM:
            return result
        # VTK and most other programs list a prism's corners in opposite orientations: accept both.
        turn = np.where(result.volume < 0.0, -1.0, 1.0)
        return replace(result, area=turn * result.area, volume=turn * result.volume)


@dataclass(frozen=True, eq=False)
class _Polyhedra:
    """Polyhedra with the geometry of their faces, and the faces of each cell."""

    area: np.ndarray  # area vectors of the faces, out of the owner, shape (face_count, 3)
    centre: np.ndarray  # shape (face_count, 3)
    box: np.ndarray  # lowest and highest corner of each face, shape (face_count, 2, 3)
    incident: np.ndarray  # faces of the cells, sorted by cell; bits are inverted for faces that point inward
    start: np.ndarray  # first entry of each cell in `incident`, shape (cell_count + 1,)

    @classmethod
    def of(cls, faces: Faces, count: int, points: np.ndarray) -> "_Polyhedra":
        """Compute the geometry of the faces of `count` cells."""
        width, begin = np.diff(faces.start), faces.start[:-1]
        at = points[faces.points]
        mean = np.add.reduceat(at, begin, axis=0) / width[:, None]
        following = np.arange(1, len(at) + 1)
        following[faces.start[1:] - 1] = begin
        spoke = at - np.repeat(mean, width, axis=0)
        triangle = 0.5 * np.cross(spoke, spoke[following])
        area = np.add.reduceat(triangle, begin, axis=0)
        # The centroid of the face: of the triangles around its mean, weighted by area.
        unit = area / np.maximum(np.linalg.norm(area, axis=1), 1e-300)[:, None]
        share = np.einsum("nk,nk->n", triangle, np.repeat(unit, width, axis=0))
        third = (spoke + spoke[following]) / 3.0
        shift = np.add.reduceat(share[:, None] * third, begin, axis=0)
        centre = mean + shift / np.maximum(np.add.reduceat(share, begin), 1e-300)[:, None]
        box = np.stack([np.minimum.reduceat(at, begin, axis=0), np.maximum.reduceat(at, begin, axis=0)], axis=1)
        cell = np.concatenate([faces.owner, faces.neighbour])
        face = np.concatenate([np.arange(len(faces.owner)), ~np.arange(len(faces.neighbour))])
        order = np.argsort(cell, kind="stable")
        return cls(area, centre, box, face[order], np.searchsorted(cell[order], np.arange(count + 1)))

    def solids(self, cell: np.ndarray, face_count: int) -> Solids:
        """Compute volumes and centroids of some cells, of `face_count` faces each."""
        face = self.incident[self.start[cell] + np.arange(face_count)[:, None]]
        inward = face < 0
        face = np.where(inward, ~face, face)
        area = np.where(inward, -1.0, 1.0) * np.moveaxis(self.area[face], -1, 0)
        centre, box = np.moveaxis(self.centre[face], -1, 0), self.box[face]
        low, high = box[:, :, 0].min(axis=0).T, box[:, :, 1].max(axis=0).T
        return _finished(cell, area, centre, low, high, centre.mean(axis=1))


def corner_chunks(block: Block) -> Iterator[Chunk]:
    """Yield the solid cells of a block that are not polyhedra, in chunks."""
    if block.shape is not None:
        yield from _structured(block.shape)
        return
    cells = block.cells
    if cells is None:
        return
    for kind, count in CORNER_COUNT.items():
        own = np.flatnonzero(cells.types == kind)
        for first in range(0, len(own), CHUNK):
            cell = own[first : first + CHUNK]
            yield Chunk(kind, cell, cells.points[cells.start[cell] + np.arange(count)[:, None]])


def corner_counts(block: Block) -> np.ndarray:
    """Return the number of corners of each cell of a block; 0 for polyhedra and for cells that are not solid."""
    if block.shape is not None:
        solid = min(block.shape) > 1
        return np.full(block.cell_count, CORNER_COUNT[HEXAHEDRON] if solid else 0, np.int64)
    count = np.zeros(256, np.int64)
    count[list(CORNER_COUNT)] = list(CORNER_COUNT.values())
    return count[block.cells.types] if block.cells is not None else np.zeros(0, np.int64)


def solid_chunks(block: Block, across: np.ndarray) -> Iterator[Callable[[], Solids]]:
    """Yield functions that compute the solid cells of a block, with points (3, point_count) [m], one for each chunk."""
    for chunk in corner_chunks(block):
        yield partial(chunk.solids, across)
    cells = block.cells
    if cells is None or cells.faces is None or not (own := np.flatnonzero(cells.types == POLYHEDRON)).size:
        return
    faces = _Polyhedra.of(cells.faces, len(cells), across.T)
    width = np.diff(faces.start)[own]
    for face_count in np.unique(width):
        same = own[width == face_count]
        for first in range(0, len(same), CHUNK):
            yield partial(faces.solids, same[first : first + CHUNK], int(face_count))


def _structured(shape: tuple[int, int, int]) -> Iterator[Chunk]:
    ni, nj, nk = shape
    across = ni - 1
    plane = across * (nj - 1)
    step = max(1, CHUNK // max(plane, 1))
    offsets = np.array([0, 1, ni + 1, ni, ni * nj, ni * nj + 1, ni * nj + ni + 1, ni * nj + ni])[:, None]
    i, j = np.meshgrid(np.arange(across), np.arange(nj - 1))
    base = (i + ni * j).ravel()
    for first in range(0, nk - 1, step):
        layers = np.arange(first, min(first + step, nk - 1))
        corner = (base + ni * nj * layers[:, None]).ravel()
        cell = (np.arange(plane) + plane * layers[:, None]).ravel()
        yield Chunk(HEXAHEDRON, cell, corner + offsets)


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    result = np.empty_like(one)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.subtract(one[i] * other[j], one[j] * other[i], out=result[k])
    return result


def _from_mean(ring: list[np.ndarray], mean: np.ndarray) -> np.ndarray:
    """Return the centroids of quadrilaterals minus the means of their corners, shape (3, n).

    The centroid is that of the four triangles around the mean.
    """
    spoke = [corner - mean for corner in ring]
    triangle = [_cross(spoke[k], spoke[(k + 1) % 4]) for k in range(4)]
    area = sum(triangle)
    share = [(own * area).sum(axis=0) for own in triangle]
    whole = 3.0 * sum(share)
    shift = sum(own * (spoke[k] + spoke[(k + 1) % 4]) for k, own in enumerate(share))
    return np.asarray(shift / np.where(whole > 0.0, whole, 1.0))


def _finished(cell, area, centre, low, high, inner) -> Solids:
    """Compute volumes and centroids as sums over the pyramids from an inner point to each face."""
    height = centre - inner[:, None]
    part = (height * area).sum(axis=0) / 3.0
    volume = part.sum(axis=0)
    with np.errstate(all="ignore"):
        shift = 0.75 * (part * height).sum(axis=1) / volume
    return Solids(cell, area, centre, low, high, volume, inner + np.where(np.isfinite(shift), shift, 0.0))


@dataclass(frozen=True, eq=False)
class NodeGrid:
    """A uniform grid of nodes, and the cell that contains each."""

    low: np.ndarray  # the first node [m], shape (3,)
    spacing: np.ndarray  # [m], shape (3,)
    shape: tuple[int, int, int]  # nodes along x, y, z
    cell: np.ndarray = field(init=False)  # -1 for none, z fastest, int32
    lock: Any = field(default_factory=Lock)  # held while nodes are given their cells

    def __post_init__(self):
        """Start with no cell for any node."""
        object.__setattr__(self, "cell", np.full(int(np.prod(self.shape)), -1, dtype=np.int32))

    def positions(self, node: np.ndarray) -> np.ndarray:
        """Return coordinates [m] of nodes by their number, shape (n, 3)."""
        index = np.stack(np.unravel_index(node, self.shape), axis=1)
        return self.low + index * self.spacing


class CellFacts(NamedTuple):
    """Volumes and centroids of all cells of a block."""

    volume: np.ndarray  # [m3], shape (cell_count,)
    middle: np.ndarray  # centroids [m], shape (cell_count, 3)


def rasterise(block: Block, points: np.ndarray, grids: list[NodeGrid], first_cell: int) -> CellFacts:
    """Rasterise the solid cells of a block into grids, where their numbers begin with `first_cell`."""
    count = block.cell_count
    facts = CellFacts(np.zeros(count), np.zeros((count, 3)))
    across = np.ascontiguousarray(points.T)

    def work(result: Callable[[], Solids]) -> None:
        solids = result()
        facts.volume[solids.cell] = solids.volume
        facts.middle[solids.cell] = solids.middle.T
        for grid in grids:
            _rasterise_some(solids, grid, first_cell, block.blank)

    for _ in in_turn(work, solid_chunks(block, across), core_count()):
        pass
    return facts


def _rasterise_some(solids: Solids, grid: NodeGrid, first_cell: int, blank: np.ndarray | None) -> None:
    shape, step, low = np.array(grid.shape)[:, None], grid.spacing[:, None], grid.low[:, None]
    # A node this close to a face, of the cell's size, is on it.
    slack = 1e-9 * (solids.high - solids.low).max(axis=0) + 1e-12 * grid.spacing.max()
    begin = np.clip(np.ceil((solids.low - slack - low) / step), 0, shape).astype(np.int64)
    end = np.clip(np.floor((solids.high + slack - low) / step), -1, shape - 1).astype(np.int64)
    span = np.maximum(end - begin + 1, 0)
    pairs = span.prod(axis=0)
    if blank is not None:
        pairs[blank[solids.cell]] = 0
    some = np.flatnonzero(pairs)
    if not len(some):
        return
    area = solids.area[:, :, some]
    size = np.sqrt((area**2).sum(axis=0))
    turn = np.where(solids.volume[some] < 0.0, -1.0, 1.0)
    normal = area * (turn / np.where(size > 0.0, size, 1.0))
    # normal . (node - middle) <= bound, relative to the middle so that no digits are lost
    middle = solids.middle[:, some]
    bound = (normal * (solids.centre[:, :, some] - middle[:, None])).sum(axis=0) + slack[some]
    cell, begin, span, pairs = first_cell + solids.cell[some], begin[:, some], span[:, some], pairs[some]
    ends = np.cumsum(pairs)
    first = 0
    while first < len(some):
        before = ends[first - 1] if first else 0
        last = max(first + 1, int(np.searchsorted(ends, before + 400_000, "right")))  # pairs tested together
        part = slice(first, last)
        _assign_inside(grid, cell[part], begin[:, part], span[:, part], pairs[part], middle[:, part],
              normal[:, :, part], bound[:, part])  # fmt: skip
        first = last


def _assign_inside(grid, cell, begin, span, pairs, middle, normal, bound) -> None:
    own = np.repeat(np.arange(len(cell)), pairs)
    within = np.arange(len(own)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    others, k = np.divmod(within, span[2][own])
    i, j = np.divmod(others, span[1][own])
    index = [axis + first[own] for axis, first in zip((i, j, k), begin, strict=True)]
    node = (index[0] * grid.shape[1] + index[1]) * grid.shape[2] + index[2]
    place = [(grid.low[axis] - middle[axis])[own] + grid.spacing[axis] * index[axis] for axis in range(3)]
    for face in range(normal.shape[1]):
        distance = place[0] * normal[0, face][own]
        distance += place[1] * normal[1, face][own]
        distance += place[2] * normal[2, face][own]
        inside = np.flatnonzero(distance <= bound[face][own])
        if len(inside) < len(own):
            own, node = own[inside], node[inside]
            place = [axis[inside] for axis in place]
    # A node on a face shared by cells goes to the one with the greatest number, whichever thread comes first.
    with grid.lock:
        grid.cell[node] = np.maximum(grid.cell[node], cell[own])
