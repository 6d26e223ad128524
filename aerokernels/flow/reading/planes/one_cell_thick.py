"""Reduce volumes that are one cell thick to planes: two-dimensional flows in three-dimensional formats.

Of two parallel layers of points with the same densities the lower one is kept. A flow that differs between the layers,
and a wedge, stays a volume.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..dataset import HEXAHEDRON, POLYGON, PRISM, Block, Cells, Dataset, Patch

NEAR = 1e-7  # of the size: single precision
ALIKE = 1e-6  # greatest relative difference between the values of the two layers
# Corners of each face of a cell, in order around it.
FACES = {
    HEXAHEDRON: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    PRISM: ((0, 1, 2), (3, 4, 5)),
}


def flattened(dataset: Dataset, look: np.ndarray | None) -> Dataset | None:
    """Return the flow in its plane, across x, y or z; None for a volume with more than one cell across.

    Also None if rays are to run across the plane, along `look`.
    """
    if not dataset.blocks or any(block.cells is None and block.shape is None for block in dataset.blocks):
        return None
    points = np.concatenate([block.points for block in dataset.blocks])
    size = float(np.ptp(points, axis=0).max(initial=0.0))
    across = [axis for axis in range(3) if _has_two_layers(points[:, axis], size)]
    if len(across) != 1 or (look is not None and abs(look[across[0]]) > NEAR):
        return None
    axis = across[0]
    least = points[:, axis].min()
    blocks = [_flat(block, block.points[:, axis] - least < NEAR * size, axis, size) for block in dataset.blocks]
    if any(block is None for block in blocks):
        return None
    patches = [_edges(patch, axis, least, size) for patch in dataset.patches]
    kept = [patch for patch in patches if len(patch.edges)]
    notes = [*dataset.notes, f"one cell thick along {'xyz'[axis]}: taken as planar"]
    return replace(dataset, blocks=[block for block in blocks if block], patches=kept, notes=notes)


def _has_two_layers(place: np.ndarray, size: float) -> bool:
    low, high = float(place.min()), float(place.max())
    return high - low > 10.0 * NEAR * size and bool(
        (np.minimum(np.abs(place - low), np.abs(place - high)) < NEAR * size).all()
    )


def _flat(block: Block, low: np.ndarray, axis: int, size: float) -> Block | None:
    """Return the lower layer of a block; None if the other layer is not the same shifted across."""
    rest = [k for k in range(3) if k != axis]
    shape, cells = None, None
    if block.shape is not None:
        grid = _structured_layers(block, low)
        if grid is None:
            return None
        one, other, shape = grid
    else:
        layers = _layers(block, low, rest, size)
        cells = None if block.cells is None else _faces(block.cells, low)
        if layers is None or cells is None:
            return None
        one, other = layers
    if (
        len(one) != len(other)
        or (np.abs(block.points[one][:, rest] - block.points[other][:, rest]) > NEAR * size).any()
    ):
        return None
    data = {}
    for name, values in block.point_data.items():
        if len(values) != len(block.points):
            return None
        first, second = np.asarray(values)[one], np.asarray(values)[other]
        scalar = first.ndim == 1 and first.dtype.kind == "f"
        if scalar and not np.allclose(first, second, rtol=ALIKE, atol=0.0, equal_nan=True):
            return None
        data[name] = first
    if cells is not None:
        number = np.full(len(block.points), -1)
        number[one] = np.arange(len(one))
        cells = replace(cells, points=number[cells.points])
    blank = block.blank
    if blank is not None and len(blank) == len(block.points):
        blank = blank[one]
    return replace(block, points=block.points[one], cells=cells, shape=shape, point_data=data, blank=blank)


def _structured_layers(block: Block, low: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[int, int, int]] | None:
    """Return the points of both layers of a grid two points thick, in the same order, and the grid's shape."""
    assert block.shape is not None
    if min(block.shape) < 2:
        return None  # a plane already: one row of cells, as of a flow along one axis alone
    grid = np.arange(len(low)).reshape(block.shape[::-1])
    for along in range(3):
        if block.shape[along] != 2:
            continue
        one, other = (grid.take(k, axis=2 - along).ravel() for k in (0, 1))
        one, other = (one, other) if low[one[0]] else (other, one)
        if low[one].all() and not low[other].any():
            counts = [1 if k == along else n for k, n in enumerate(block.shape)]
            return one, other, (counts[0], counts[1], counts[2])
    return None


def _layers(block: Block, low: np.ndarray, rest: Sequence[int], size: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the points of both layers, in the same order."""
    found = []
    for layer in (np.flatnonzero(low), np.flatnonzero(~low)):
        place = np.round(block.points[layer][:, rest] / (10.0 * NEAR * size))
        found.append(layer[np.lexsort(place.T)])
    return (found[0], found[1]) if len(found[0]) == len(found[1]) else None


def _faces(cells: Cells, low: np.ndarray) -> Cells | None:
    """Return the face of each cell in the lower layer; None if a cell has none."""
    width, corners = np.zeros(len(cells), np.int64), np.zeros((len(cells), 4), np.int64)
    for kind, faces in FACES.items():
        own = np.flatnonzero(cells.types == kind)
        if not len(own):
            continue
        count = 8 if kind == HEXAHEDRON else 6
        if (np.diff(cells.start)[own] != count).any():
            return None
        points = cells.points[cells.start[own][:, None] + np.arange(count)]
        below = low[points]
        for face in faces:
            others = [k for k in range(count) if k not in face]
            fits = below[:, list(face)].all(axis=1) & ~below[:, others].any(axis=1)
            width[own[fits]] = len(face)
            corners[own[fits], : len(face)] = points[fits][:, list(face)]
    if (width == 0).any():
        return None
    start = np.concatenate([[0], np.cumsum(width)])
    return Cells(np.full(len(width), POLYGON, np.uint8), start, corners[np.arange(4) < width[:, None]])


def _edges(patch: Patch, axis: int, least: float, size: float) -> Patch:
    """Return a patch with the edges of its faces in the lower layer."""
    if patch.polygons is None or not len(patch.polygons.points):
        return patch
    points, start = patch.polygons.points, patch.polygons.start
    low = points[:, axis] - least < NEAR * size
    face = np.repeat(np.arange(len(start) - 1), np.diff(start))
    two = np.bincount(face[low], minlength=len(start) - 1) == 2
    return Patch(patch.name, patch.kind, points[low & two[face]].reshape(-1, 2, 3))
