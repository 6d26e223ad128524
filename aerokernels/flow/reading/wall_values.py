"""What a solver holds at the walls of a two-dimensional flow, as densities at points of the walls.

A wall counts where its values are told and are not those of its cells: a wall of a given temperature. One of zero
gradient says nothing beside the averages. An edge's value is that of its middle; at a corner between two edges it is
what changes linearly between their middles, at the ends of a wall what goes on as from the middle to the other end.
"""

import numpy as np

from ..wall_density import WallDensity
from .dataset import Block, Dataset, Patch
from .density import DensityChoice, Reference, density_of, in_si
from .plane import Plane

SAME = 1e-5  # of a cell's density: a file of six digits says no more


def wall_density(
    path, dataset: Dataset, plane: Plane, choice: DensityChoice, reference: Reference, names=None
) -> WallDensity | None:
    """Densities on the walls; None where no wall tells of others than its cells.

    Args:
        path: The file, for messages.
        dataset: What it holds.
        plane: How it lies.
        choice: Where its density comes from.
        reference: What 1 is in it.
        names: Patches that are walls; None takes what the file calls walls.
    """
    chosen = [names] if isinstance(names, str) else names
    points, values = [], []
    for patch in dataset.patches:
        meant = patch.kind == "wall" if chosen is None else patch.name in chosen
        if not meant or patch.values is None or not len(patch.edges):
            continue
        own = _density(path, dataset, patch, choice, reference)
        if own is None:
            continue
        edges = plane.local(patch.edges)
        corners, at_corners = _at_corners(edges, own)
        points += [edges.mean(axis=1), corners]
        values += [own, at_corners]
    return WallDensity(np.concatenate(points), np.concatenate(values)) if points else None


def _density(path, dataset: Dataset, patch: Patch, choice: DensityChoice, reference: Reference) -> np.ndarray | None:
    """Densities at the edges of a patch [kg/m3]; None where they are not told, no gas's, or those of the cells."""
    assert patch.values is not None
    told = {name: patch.values(name) for name in choice.names}
    if patch.behind is None or any(values is None for values in told.values()):
        return None
    block: Block = dataset.blocks[0]
    inside = {name: np.asarray(block.cell_data[name])[patch.behind] for name in choice.names}
    wall, cell = (
        density_of({name: in_si(path, name, values, choice, reference, dataset.units) for name, values in own.items()},
                   choice)
        for own in (told, inside)
    )  # fmt: skip
    if not (np.isfinite(wall) & (wall > 0.0)).all() or (np.abs(wall - cell) <= SAME * cell).all():
        return None
    return wall


def _at_corners(edges: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points where edges (n, 2, 2) end, and the values there, from those of the edges' middles."""
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
