"""Reduce volumes that are one cell thick to planes: two-dimensional flows in three-dimensional formats.

Of two layers of points with the same densities the lower one is kept: of parallel ones for a planar flow, of the sides
of a wedge for a flow of revolution. A flow that differs between the layers stays a volume.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from aerokernels.flow.reading.dataset import (
    CORNERS,
    HEXAHEDRON,
    PRISM,
    PYRAMID,
    TETRAHEDRON,
    Block,
    Cells,
    Dataset,
    Patch,
)

NEAR = 1e-7  # of the size: single precision
# Corners of each face of a cell, in order around it.
FACES = {
    HEXAHEDRON: [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
    PRISM: [[0, 1, 2], [3, 4, 5], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]],
    PYRAMID: [[0, 1, 2, 3], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
    TETRAHEDRON: [[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
}


@dataclass(frozen=True, eq=False)
class Layers:
    """Two layers of points with cells between them; points on the axis of a wedge are in both."""

    places: np.ndarray  # where points are along the layers, shape (n, 2)
    low: np.ndarray  # which points are in the lower layer, shape (n,)
    high: np.ndarray  # which are in the upper one


@dataclass(frozen=True, eq=False)
class Wedge:
    """A wedge that is one cell thick, about an axis through the origin."""

    axis: int  # number of the axis in the file: 0, 1 or 2
    ahead: np.ndarray  # direction between its planes, of the two other coordinates, shape (2,)
    low: float  # angle of one of its planes from it [rad]
    angle: float  # between the planes [rad]
    radius: float  # greatest distance of its points from the axis

    @classmethod
    def about(cls, points: np.ndarray, axis: int) -> "Wedge | None":
        """Return the wedge of two planes through an axis that hold all points; None if there are no such planes."""
        beside = np.delete(points, axis, axis=1)
        distance = np.hypot(*beside.T)
        radius = float(distance.max(initial=0.0))
        beside = beside[distance > 1e-6 * radius]
        if len(beside) < 2:
            return None
        result = cls(axis, beside.sum(axis=0), 0.0, 0.0, radius)
        turn = result.turn(beside)
        result = replace(result, low=float(turn.min()), angle=float(turn.max()) - float(turn.min()))
        if not 1e-4 < result.angle <= 0.35:  # [rad], at most 20 degrees
            return None
        return result if np.logical_or(*result.sides(turn)).all() else None

    def turn(self, beside: np.ndarray) -> np.ndarray:
        """Return the angles of points about the axis, from the direction `ahead` [rad]."""
        (one, other), ahead = beside.T, self.ahead
        return np.asarray(np.arctan2(one * -ahead[1] + other * ahead[0], one * ahead[0] + other * ahead[1]))

    def sides(self, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which angles are in the lower plane, and which in the other one, to single precision."""
        near = 1e-3 * self.angle
        return turn - self.low < near, self.low + self.angle - turn < near

    def layers(self, points: np.ndarray) -> Layers:
        """Return its two layers among points, shape (n, 3): along the axis and from it, in the file's unit."""
        beside = np.delete(points, self.axis, axis=1)
        distance = np.hypot(*beside.T)
        low, high = self.sides(self.turn(beside))
        on_axis = distance <= 1e-6 * self.radius
        return Layers(np.stack([points[:, self.axis], distance], axis=1), on_axis | low, on_axis | high)


def wedge(points: np.ndarray) -> Wedge | None:
    """Return the wedge of which points are the corners of the cells; None for other points."""
    some = points[:: max(len(points) // 1000, 1)]
    likely = [axis for axis in range(3) if Wedge.about(some, axis) is not None]
    return next((result for axis in likely if (result := Wedge.about(points, axis)) is not None), None)


def flattened(dataset: Dataset, look: np.ndarray | None) -> Dataset | None:
    """Return the flow in its plane: across x, y or z, or a side of a wedge; None if it is more than one cell thick.

    Also None if rays are to run across the plane, along `look`.
    """
    if not dataset.blocks or any(block.cells is None and block.shape is None for block in dataset.blocks):
        return None
    points = np.concatenate([block.points for block in dataset.blocks])
    size = float(np.ptp(points, axis=0).max(initial=0.0))
    low, high = points.min(axis=0), points.max(axis=0)
    two = (np.minimum(points - low, high - points) < NEAR * size).all(axis=0) & (high - low > 10.0 * NEAR * size)
    across = np.flatnonzero(two).tolist()
    if len(across) == 1:
        if look is not None and abs(look[across[0]]) > NEAR:
            return None
        axis, least = across[0], float(low[across[0]])

        def layers(points: np.ndarray) -> Layers:
            lower = points[:, axis] - least < NEAR * size
            return Layers(np.delete(points, axis, axis=1), lower, ~lower)

        return _in_plane(dataset, layers, size, f"one cell thick along {'xyz'[axis]}: taken as planar")
    if (result := wedge(points)) is None:
        return None
    said = (
        f"a wedge of {np.degrees(result.angle):.3g} degrees about {'xyz'[result.axis]}: taken as a flow of revolution"
    )
    plane = _in_plane(dataset, result.layers, size, said)
    return (
        None if plane is None else replace(plane, geometry="axisymmetric", axis=tuple(np.eye(3)[result.axis].tolist()))
    )


def _in_plane(dataset: Dataset, layers: Callable[[np.ndarray], Layers], size: float, said: str) -> Dataset | None:
    """Return the lower layer of all blocks; None if one of them has another shape or values in the other layer."""
    blocks = [_flat(block, layers(block.points), size) for block in dataset.blocks]
    if any(block is None for block in blocks):
        return None
    patches = [_edges(patch, layers) for patch in dataset.patches]
    kept = [patch for patch in patches if len(patch.edges)]
    return replace(dataset, blocks=[block for block in blocks if block], patches=kept, notes=[*dataset.notes, said])


def _flat(block: Block, layers: Layers, size: float) -> Block | None:
    """Return the lower layer of a block; None if the other layer is not the same across."""
    shape, cells = None, None
    if block.shape is not None:
        grid = _structured_layers(block, layers)
        if grid is None:
            return None
        one, other, shape = grid
    else:
        pair = _pairs(layers, size)
        cells = None if block.cells is None else _faces(block.cells, layers)
        if pair is None or cells is None:
            return None
        one, other = pair
    # The radii of both sides of a wedge are rounded apart.
    if (np.abs(layers.places[one] - layers.places[other]) > 10.0 * NEAR * size).any():
        return None
    data = {}
    for name, values in block.point_data.items():
        if len(values) != len(block.points):
            return None
        first, second = np.asarray(values)[one], np.asarray(values)[other]
        scalar = first.ndim == 1 and first.dtype.kind == "f"
        if scalar and not np.allclose(first, second, rtol=1e-6, atol=0.0, equal_nan=True):
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


def _structured_layers(block: Block, layers: Layers) -> tuple[np.ndarray, np.ndarray, tuple[int, int, int]] | None:
    """Return the points of both layers of a grid two points thick, in the same order, and the grid's shape."""
    assert block.shape is not None
    if min(block.shape) < 2:
        return None  # a plane already: one row of cells, as of a flow along one axis alone
    grid = np.arange(len(layers.low)).reshape(block.shape[::-1])
    for along in range(3):
        if block.shape[along] != 2:
            continue
        pair = [grid.take(k, axis=2 - along).ravel() for k in (0, 1)]
        for one, other in (pair, pair[::-1]):
            if layers.low[one].all() and layers.high[other].all():
                counts = [1 if k == along else n for k, n in enumerate(block.shape)]
                return one, other, (counts[0], counts[1], counts[2])
    return None


def _pairs(layers: Layers, size: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the points of the lower layer, and the point of the other layer that is nearest to each across."""
    from scipy.spatial import cKDTree

    one, other = np.flatnonzero(layers.low), np.flatnonzero(layers.high)
    if len(one) != len(other) or not len(one):
        return None
    one = one[np.lexsort(np.round(layers.places[one] / (10.0 * NEAR * size)).T)]
    return one, other[cKDTree(layers.places[other]).query(layers.places[one])[1]]


def _faces(cells: Cells, layers: Layers) -> Cells | None:
    """Return the face of each cell in the lower layer; None if a cell has none."""
    width, corners = np.zeros(len(cells), np.int64), np.zeros((len(cells), 4), np.int64)
    for kind, faces in FACES.items():
        own = np.flatnonzero(cells.types == kind)
        if not len(own):
            continue
        count = CORNERS[kind]
        if (np.diff(cells.start)[own] != count).any():
            return None
        points = cells.points[cells.start[own][:, None] + np.arange(count)]
        low, alone = layers.low[points], (layers.low & ~layers.high)[points]
        for face in faces:  # cells at the axis of a wedge have lost corners
            others = [k for k in range(count) if k not in face]
            fits = low[:, face].all(axis=1) & alone[:, face].any(axis=1) & ~alone[:, others].any(axis=1)
            width[own[fits]] = len(face)
            corners[own[fits], : len(face)] = points[fits][:, face]
    if (width == 0).any():
        return None
    return Cells.polygons(width, corners[np.arange(4) < width[:, None]])


def _edges(patch: Patch, layers: Callable[[np.ndarray], Layers]) -> Patch:
    """Return a patch with the edges of its faces in the lower layer."""
    if patch.polygons is None or not len(patch.polygons.points):
        return patch
    points, start = patch.polygons.points, patch.polygons.start
    result = layers(points)
    face = np.repeat(np.arange(len(start) - 1), np.diff(start))
    count, alone = (np.bincount(face[own], minlength=len(start) - 1) for own in (result.low, result.low & ~result.high))
    edge = (count == 2) & (alone > 0)  # not the axis
    return Patch(patch.name, patch.kind, points[result.low & edge[face]].reshape(-1, 2, 3))
