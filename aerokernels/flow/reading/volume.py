"""Volumes: a uniform grid as it is, everything else resampled to one, with the error of that measured by cause."""

import math
from dataclasses import dataclass

import numpy as np

from ..sampled_density import GridDensity, linear_between
from .dataset import SOLID, Block, ReadError
from .raster import CellFacts, NodeGrid, draw
from .reconstruction import Linear, reconstruct

DEFAULT_NODES = 8_000_000  # of a grid that nobody chose
NODE_LIMIT = 200_000_000
LEAST_NODES = 5
LINES = 8  # along x and y, on which the error is measured
LEAST_AVERAGED = 4  # cells about a node from which on their average says more than the one that holds it
CARRIED_ON = 8  # nodes by which the density is carried on into a body, and beyond the mesh


@dataclass(frozen=True)
class VolumeResampling:
    """What resampling a mesh to a uniform grid changed, by cause.

    Attributes:
        spacing: Node spacing of the grid [m], one per axis.
        density_rms: Root mean square change of the density between grid and cells [kg/m3], on lines along z.
        density_max: Greatest change of it seen [kg/m3].
        column_rms: Root mean square change of the integral of the density along those lines [kg/m2].
        column_max: Greatest change of that [kg/m2].
        reconstruction_rms: What of the columns comes from the slopes inside cells: against cells of one density each.
        outside_share: Share of the nodes that no cell holds: in a body, or beyond the mesh.
        averaged_share: Share of the nodes whose neighbourhood has several cells, which were averaged.
    """

    spacing: tuple[float, float, float]
    density_rms: float
    density_max: float
    column_rms: float
    column_max: float
    reconstruction_rms: float
    outside_share: float
    averaged_share: float


def volume_field(reading, spacing=None, region=None) -> GridDensity:
    """The density of a volume on a uniform grid.

    Raises:
        ReadError: A mesh without solid cells, with cells inside out or points twice.
        ValueError: A spacing or a region that makes no grid.
    """
    dataset, path = reading.dataset, reading.path
    axes, origin = reading.frame.axes(), np.array(reading.frame.origin)
    moved = [reading.scale * ((block.points - origin) @ axes.T) for block in dataset.blocks]
    said = [dataset.format, *([f"t = {dataset.time:g}"] if dataset.time is not None else []), reading.said,
            reading.frame.described(axes), *dataset.notes]  # fmt: skip
    if len(moved) == 1 and spacing is None and region is None:
        grid = uniform_grid(dataset.blocks[0], moved[0], *reading.densities[0])
        if grid is not None:
            density, low, step = grid
            ambient = reading.ambient or dataset.ambient or float(np.median(density[:, :, -1]))
            said.append(f"ambient {ambient:.6g} kg/m3")
            return GridDensity(density, low, step, "volume", ambient, provenance=f"{path}: {'; '.join(said)}")
    for block in dataset.blocks:
        if block.cells is None and block.shape is None:
            raise ReadError(
                path, f"block {block.name!r} has points and no cells", "give a file with cells, or a grid's shape"
            )
    if not any(block.shape is not None or np.isin(block.cells.types, SOLID).any() for block in dataset.blocks):
        raise ReadError(path, "it has no solid cells: a surface in space", "give the volume's mesh")
    return _resampled(reading, moved, spacing, region, said)


def uniform_grid(block: Block, points: np.ndarray, density: np.ndarray, where: str):
    """Density [x, y, z], first node and spacing of a uniform grid; None for another.

    Averages over cells become nodes at the corners of the cells, each the mean of the cells about it: the grid covers
    what the cells cover, and columns along its axes hold what the cells hold.
    """
    if block.shape is None or min(block.shape) < 2 or (block.blank is not None and block.blank.any()):
        return None
    at = points.reshape(*block.shape[::-1], 3)
    steps = [at[0, 0, 1] - at[0, 0, 0], at[0, 1, 0] - at[0, 0, 0], at[1, 0, 0] - at[0, 0, 0]]
    along = [int(np.argmax(np.abs(step))) for step in steps]
    if sorted(along) != [0, 1, 2]:
        return None
    size = np.array([abs(step[axis]) for step, axis in zip(steps, along, strict=True)])
    expected = at[0, 0, 0].copy() + sum(
        np.arange(n).reshape([-1 if k == 2 - i else 1 for k in range(3)])[..., None]
        * (steps[i][along[i]] * np.eye(3)[along[i]])
        for i, n in enumerate(block.shape)
    )
    if (size <= 0.0).any() or (np.abs(at - expected) > 1e-6 * size.min()).any():
        return None
    cell = where == "cell"
    counts = [n - 1 if cell else n for n in block.shape]
    if cell and min(counts) < 2:
        return None
    values = density.reshape(counts[::-1]).transpose(2, 1, 0)  # [i, j, k]
    values = np.transpose(values, [along.index(axis) for axis in range(3)])
    first, step = np.empty(3), np.empty(3)
    for i, axis in enumerate(along):
        step[axis] = abs(at.reshape(-1, 3)[-1, axis] - at.reshape(-1, 3)[0, axis]) / (block.shape[i] - 1)
        first[axis] = points[:, axis].min()
        if steps[i][axis] < 0.0:
            values = np.flip(values, axis)
    return np.ascontiguousarray(_at_corners(values) if cell else values), first, step


def _at_corners(values: np.ndarray) -> np.ndarray:
    """Means of the cells about each corner, one axis after the other; at the edge the cell itself."""
    for axis in range(3):
        ends = [(1, 1) if k == axis else (0, 0) for k in range(3)]
        padded = np.moveaxis(np.pad(values, ends, mode="edge"), axis, 0)
        values = np.moveaxis(0.5 * (padded[1:] + padded[:-1]), 0, axis)
    return values


def _resampled(reading, moved: list[np.ndarray], spacing, region, said: list[str]) -> GridDensity:
    path, blocks = reading.path, list(reading.dataset.blocks)
    low, step, shape = _grid_of(path, blocks, moved, spacing, region)
    grid = NodeGrid(low, step, shape)
    extent = step * (np.array(shape) - 1)
    fine = max(2, min(4 * shape[2], 4096))
    lines = NodeGrid(
        low + extent * np.array([0.5 / LINES, 0.5 / LINES, 0.5 / fine]),
        extent / np.array([LINES, LINES, fine]),
        (LINES, LINES, fine),
    )
    parts: list[Linear] = []
    facts: list[CellFacts] = []
    first = 0
    for block, points, own in zip(blocks, moved, reading.densities, strict=True):
        found = draw(block, points, [grid, lines], first)
        _check_solids(path, block, points, found)
        parts.append(reconstruct(block, points, own[0], own[1], found))
        facts.append(found)
        first += block.cell_count
    linear = Linear.joined(parts)
    density, held = _node_density(grid, linear)
    if not held.any():
        raise ReadError(path, "no node of the grid lies in a cell of it", "repair the mesh, or give a smaller spacing")
    averages = all(where == "cell" for _, where in reading.densities)
    averaged = _average_small_cells(grid, linear, facts, blocks, density, held) if averages else 0.0
    ambient = reading.ambient or reading.dataset.ambient or _front_density(grid, density, held)
    _carry_on(grid, density, held.copy(), ambient)
    outside = 1.0 - float(held.mean())
    measured = _measured(grid, lines, linear, density.reshape(shape), outside, averaged)
    said += [
        f"resampled to {' x '.join(map(str, shape))} nodes of {' x '.join(f'{s:.4g}' for s in step)} m, which changes "
        f"the density by {measured.density_rms:.2g} kg/m3 rms, columns along z by {measured.column_rms:.2g} kg/m2 rms",
        *(
            [f"{outside:.1%} of the nodes lie in a body or beyond the mesh: the density is carried on"]
            if outside
            else []
        ),
        f"ambient {ambient:.6g} kg/m3",
    ]
    return GridDensity(
        density.reshape(shape),
        low,
        step,
        "volume",
        ambient,
        provenance=f"{path}: {'; '.join(said)}",
        resampling=measured,
    )


def _grid_of(path, blocks, moved, spacing, region):
    low = np.min([points.min(axis=0) for points in moved], axis=0)
    high = np.max([points.max(axis=0) for points in moved], axis=0)
    if region is not None:
        first, last = (np.asarray(corner, dtype=np.float64) for corner in region)
        if first.shape != (3,) or last.shape != (3,) or not (np.maximum(first, low) < np.minimum(last, high)).all():
            raise ValueError(
                f"region {region!r} does not lie in the flow of {path}, {low.tolist()} to {high.tolist()} m"
            )
        low, high = np.maximum(first, low), np.minimum(last, high)
    extent = high - low
    if spacing is None:
        cells = max(sum(block.cell_count for block in blocks), 1)
        size = float((np.prod([np.ptp(np.concatenate(moved)[:, k]) for k in range(3)]) / cells) ** (1.0 / 3.0))
        step = max(size, float((extent.prod() / DEFAULT_NODES) ** (1.0 / 3.0)))
        wanted = np.full(3, step)
    else:
        wanted = np.broadcast_to(np.asarray(spacing, dtype=np.float64), (3,))
        if not (np.isfinite(wanted).all() and (wanted > 0.0).all()):
            raise ValueError(f"spacing must be positive, got {spacing!r}")
    nodes = np.maximum(np.ceil(extent / wanted * (1.0 - 1e-9)) + 1.0, LEAST_NODES)
    if nodes.prod() > NODE_LIMIT:
        raise ValueError(
            f"spacing {spacing!r} m asks for {nodes.prod():.3g} nodes, more than {NODE_LIMIT:.1g}: take a wider one"
        )
    shape = tuple(int(n) for n in nodes)
    return low, extent / (nodes - 1.0), shape


def _check_solids(path, block: Block, points: np.ndarray, facts: CellFacts) -> None:
    """Refuse cells that are inside out against the others, cells of no volume, and points that are there twice."""
    solid = np.ones(block.cell_count, bool) if block.shape is not None else np.isin(block.cells.types, SOLID)  # type: ignore[union-attr]
    volume = facts.volume[solid]
    inverted = volume < 0.0
    if inverted.any() and not inverted.all():
        wrong = np.flatnonzero(solid)[inverted if inverted.mean() <= 0.5 else ~inverted]
        raise ReadError(
            path,
            f"{len(wrong)} of {len(volume)} cells are inside out, the first is cell {wrong[0]} at "
            f"{facts.middle[wrong[0]].tolist()} m",
            "order the corners of every cell the same way round",
        )
    if (volume == 0.0).any() and block.shape is None:
        wrong = np.flatnonzero(solid)[volume == 0.0]
        raise ReadError(path, f"{len(wrong)} cells have no volume, the first is cell {wrong[0]}", "repair the mesh")
    if block.shape is None and (pair := _double_points(points)) is not None:
        raise ReadError(
            path, f"points {pair[0]} and {pair[1]} lie in the same place", "merge duplicate nodes of the mesh"
        )


def _double_points(points: np.ndarray) -> tuple[int, int] | None:
    key = points @ np.array([1.0, math.pi, math.e])
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero((points[order[1:]] == points[order[:-1]]).all(axis=1))
    return (int(order[same[0]]), int(order[same[0] + 1])) if len(same) else None


def _node_density(grid: NodeGrid, linear: Linear) -> tuple[np.ndarray, np.ndarray]:
    """Density of the nodes, and which of them a cell holds."""
    held = grid.cell >= 0
    density = np.zeros(len(held))
    nodes = np.flatnonzero(held)
    for first in range(0, len(nodes), 2_000_000):
        some = nodes[first : first + 2_000_000]
        density[some] = linear.at(grid.cell[some], grid.positions(some))
    return density, held


def _average_small_cells(grid, linear: Linear, facts, blocks, density, held) -> float:
    """Where several cells have their middles about one node, the node takes their average."""
    middle = np.concatenate([own.middle for own in facts])
    volume = np.abs(np.concatenate([own.volume for own in facts]))
    index = np.round((middle - grid.low) / grid.spacing)
    inside = (volume > 0.0) & np.all((index >= 0) & (index < grid.shape), axis=1)
    blank = [
        b.blank if b.blank is not None and len(b.blank) == b.cell_count else np.zeros(b.cell_count, bool)
        for b in blocks
    ]
    inside &= ~np.concatenate(blank)
    node = np.ravel_multi_index(tuple(index[inside].astype(np.int64).T), grid.shape)
    count = np.bincount(node, minlength=len(density))
    total = np.bincount(node, volume[inside], len(density))
    # Cells that fill most of the node's surroundings: fewer would shift the average to one side.
    several = (count >= LEAST_AVERAGED) & held & (total >= 0.7 * grid.spacing.prod())
    if several.any():
        sums = np.bincount(node, volume[inside] * linear.value[inside], len(density))
        density[several] = sums[several] / total[several]
    return float(several.mean())


def _front_density(grid: NodeGrid, density: np.ndarray, held: np.ndarray) -> float:
    """What prevails in the foremost layers that the mesh holds."""
    flow, inside = density.reshape(grid.shape), held.reshape(grid.shape)
    layers = np.flatnonzero(inside.any(axis=(0, 1)))
    some = slice(int(layers[int(0.95 * (len(layers) - 1))]), None)
    return float(np.median(flow[:, :, some][inside[:, :, some]]))


def _carry_on(grid: NodeGrid, density: np.ndarray, known: np.ndarray, ambient: float) -> None:
    """Give nodes without a cell the mean of their neighbours, layer by layer; deeper ones the ambient density."""
    strides = (grid.shape[1] * grid.shape[2], grid.shape[2], 1)
    empty = np.flatnonzero(~known)
    for _ in range(CARRIED_ON):
        if not len(empty):
            return
        total, count = np.zeros(len(empty)), np.zeros(len(empty))
        place = np.unravel_index(empty, grid.shape)
        for axis, stride in enumerate(strides):
            for side in (-1, 1):
                there = (place[axis] > 0) if side < 0 else (place[axis] < grid.shape[axis] - 1)
                near = np.where(there, empty + side * stride, empty)
                good = known[near] & there
                total += np.where(good, density[near], 0.0)
                count += good
        found = count > 0
        density[empty[found]] = total[found] / count[found]
        known[empty[found]] = True
        empty = empty[~found]
    density[empty] = ambient


def _measured(grid, lines, linear, density, outside: float, averaged: float) -> VolumeResampling:
    node = np.flatnonzero(lines.cell >= 0)
    change, flat = np.zeros(len(lines.cell)), np.zeros(len(lines.cell))
    if len(node):
        at, cell = lines.positions(node), lines.cell[node]
        truth = linear.at(cell, at)
        change[node] = linear_between(density, grid.low, grid.spacing, at) - truth
        flat[node] = linear.value[cell] - truth
    step = float(lines.spacing[2])
    columns = [step * values.reshape(lines.shape).sum(axis=2) for values in (change, flat)]
    rms = [float(np.sqrt(np.mean(own**2))) for own in (change[node] if len(node) else change, columns[0], columns[1])]
    return VolumeResampling(
        tuple(float(s) for s in grid.spacing),  # type: ignore[arg-type]
        rms[0],
        float(np.abs(change).max()),
        rms[1],
        float(np.abs(columns[0]).max()),
        rms[2],
        outside,
        averaged,
    )
