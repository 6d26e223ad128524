"""The solver's densities at points of the walls of a two-dimensional flow.

A wall counts if its values are known and differ from those of its cells: a wall of a given temperature. A wall of zero
gradient adds nothing to the averages. An edge's value belongs to its middle. At a corner between two edges the value is
interpolated linearly between their middles; at the end of a wall it is extrapolated from the last edge.
"""

import numpy as np

from aerokernels.flow.reading.dataset import Dataset, wall_patches
from aerokernels.flow.reading.density import DensityChoice, Reference, density_of, in_si
from aerokernels.flow.reading.planes.plane import Plane
from aerokernels.flow.wall_density import WallDensity

SAME = 1e-5  # of a cell's density: the resolution of a file with six digits


def wall_density(
    path, dataset: Dataset, plane: Plane, choice: DensityChoice, reference: Reference, names=None
) -> WallDensity | None:
    """Return densities on the walls; None if no wall has densities other than those of its cells.

    Args:
        path: The file, for messages.
        dataset: Its contents.
        plane: The plane of the file.
        choice: The arrays that its density comes from.
        reference: Reference values of non-dimensional data.
        names: Patches that are walls; None takes those that the file marks as walls.
    """
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for patch in wall_patches(path, dataset.patches, names):
        if patch.values is None or not len(patch.edges):
            continue
        pairs = {name: patch.values(name) for name in choice.names}
        known = {name: pair for name, pair in pairs.items() if pair is not None}
        if len(known) == len(pairs):
            pair = [_density(path, {n: own[k] for n, own in known.items()}, choice, reference, dataset) for k in (0, 1)]
            found.setdefault(patch.name, []).append((plane.local(patch.edges), np.stack(pair)))
    points, values = [], []
    for parts in found.values():  # a part for each processor
        edges = np.concatenate([own for own, _ in parts])
        wall, cell = np.concatenate([pair for _, pair in parts], axis=1)
        if not (np.isfinite(wall) & (wall > 0.0)).all() or (np.abs(wall - cell) <= SAME * cell).all():
            continue
        corners, at_corners = _at_corners(edges, wall)
        points += [edges.mean(axis=1), corners]
        values += [wall, at_corners]
    return WallDensity(np.concatenate(points), np.concatenate(values)) if points else None


def _density(path, values, choice: DensityChoice, reference: Reference, dataset: Dataset) -> np.ndarray:
    """Return densities [kg/m3] from values, by name, of the arrays that they come from."""
    found = {name: in_si(path, name, own, choice, reference, dataset.units) for name, own in values.items()}
    return density_of(found, choice)


def _at_corners(edges: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points where edges (n, 2, 2) end, and the values there, from those of the edges' middles."""
    ends = edges.reshape(-1, 2)
    near = 1e-9 * max(float(np.ptp(ends, axis=0).max()), 1e-300)
    _, first, point = np.unique(np.round(ends / near).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    point = point.ravel()
    length = np.repeat(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1), 2)
    weight = 1.0 / length
    total = np.bincount(point, weight)
    found = np.bincount(point, weight * np.repeat(values, 2)) / total
    count = np.bincount(point)
    other = point.reshape(-1, 2)[:, ::-1].ravel()
    end = (count[point] == 1) & (count[other] > 1)
    found[point[end]] = 2.0 * np.repeat(values, 2)[end] - found[other[end]]
    return ends[first], np.clip(found, values.min(), values.max())
