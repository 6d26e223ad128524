"""Density fields of volumes: a uniform grid is kept, every other mesh is resampled to one."""

from dataclasses import replace

import numpy as np

from aerokernels.flow.reading.dataset import SOLID, Block, ReadError, grid_of, with_all_points
from aerokernels.flow.reading.volumes.even_averages import at_corners, estimated_error
from aerokernels.flow.reading.volumes.resampling import Resampling
from aerokernels.flow.reading.volumes.solids import corner_chunks
from aerokernels.flow.sampled_density import GridDensity
from aerokernels.medium.labelled_grid import unevenness


def volume_field(reading, shared=None) -> GridDensity:
    """Return the density of a volume on a uniform grid.

    Raises:
        ReadError: A mesh without solid cells, with cells inside out or duplicate points.
        ValueError: A spacing or a region that does not give a grid.
    """
    dataset, path = reading.dataset, reading.path
    if len(dataset.blocks) == 1 and reading.options["spacing"] is None and reading.options["region"] is None:
        grid = uniform_grid(reading, *reading.densities[0])
        if grid is not None:
            density, low, step, told = grid
            ambient = reading.ambient or float(np.median(density[:, :, -1]))
            described = [*reading.described(), f"ambient {ambient:.6g} kg/m3"]
            composition = None
            if (fractions := reading.fractions) is not None:
                rho, where = reading.densities[0]
                parts = [uniform_grid(reading, rho * own, where) for own in fractions.blocks[0]]
                partial = np.stack([part[0] for part in parts if part is not None])
                composition = fractions.composition(partial, partial[..., -1].mean(axis=(1, 2)))
            return GridDensity(
                density,
                low,
                step,
                "volume",
                ambient,
                provenance=f"{path}: {'; '.join(described)}",
                resampling=told,
                composition=composition,
            )
    dataset = with_all_points(dataset)
    densities = [(np.asarray(own, np.float64), where) for own, where in reading.densities]
    reading = replace(reading, dataset=dataset, densities=densities)
    moved = [reading.moved(block.points) for block in dataset.blocks]
    for block in dataset.blocks:
        if block.cells is None and block.shape is None:
            raise ReadError(
                path, f"block {block.name!r} has points and no cells", "give a file with cells, or a grid's shape"
            )
    if not any(block.cells is None or np.isin(block.cells.types, SOLID).any() for block in dataset.blocks):
        raise ReadError(path, "it has no solid cells: a surface in space", "give the volume's mesh")
    blanked = [cells_blanked(block) for block in dataset.blocks]
    if any(one is not other for one, other in zip(blanked, dataset.blocks, strict=True)):
        reading = replace(reading, dataset=replace(dataset, blocks=blanked))
    if shared is None or shared.resampling is None or not shared.resampling.fits(reading):
        found = Resampling(reading, moved)
        if shared is not None:
            shared.resampling = found
    else:
        found = shared.resampling
    return found.field(reading)


def cells_blanked(block: Block) -> Block:
    """Return the block with blanked points converted to blanked cells: cells with a blanked corner."""
    blank = block.blank
    if blank is None or not blank.any() or len(blank) == block.cell_count:
        return block
    hidden = np.zeros(block.cell_count, bool)
    for chunk in corner_chunks(block):
        hidden[chunk.cell] = blank[chunk.corners].any(axis=0)
    return replace(block, blank=hidden)


def uniform_grid(reading, density: np.ndarray, where: str):
    """Return density [x, y, z], first node and spacing of a single block on a uniform grid, and its error; or None.

    Cell averages become values at the corners of the cells: the grid covers what the cells cover, and the error states
    the deficit of this conversion. For values at nodes the error is None: the error budget estimates their
    interpolation error.
    """
    block = reading.dataset.blocks[0]
    if block.shape is None or min(block.shape) < 2 or (block.blank is not None and block.blank.any()):
        return None
    at = None
    if (grid := grid_of(block.points)) is not None:  # each edge is like all others along it
        edges = [reading.moved(edge) for edge in grid.edges()]
    else:
        at = reading.moved(block.points).reshape(*block.shape[::-1], 3)
        edges = [at[0, 0], at[0, :, 0], at[:, 0, 0]]
    steps = [(edge[-1] - edge[0]) / (count - 1) for edge, count in zip(edges, block.shape, strict=True)]
    along = [int(np.argmax(np.abs(step))) for step in steps]
    if sorted(along) != [0, 1, 2]:
        return None
    size = np.array([abs(step[axis]) for step, axis in zip(steps, along, strict=True)])
    if (size <= 0.0).any():
        return None
    if not (_edges_are_even(edges, steps, along, size) if at is None else _is_even(at, steps, along, size)):
        return None
    cell = where == "cell"
    counts = [n - 1 if cell else n for n in block.shape]
    if cell and min(counts) < 2:
        return None
    values = density.reshape(counts[::-1]).transpose(2, 1, 0)  # [i, j, k]
    values = np.transpose(values, [along.index(axis) for axis in range(3)])
    first, step = np.empty(3), np.empty(3)
    for i, axis in enumerate(along):
        step[axis] = size[i]
        first[axis] = min(edges[i][0, axis], edges[i][-1, axis])
        if steps[i][axis] < 0.0:
            values = np.flip(values, axis)
    if not cell:
        density = np.array(values, np.float64, order="C")
        density.setflags(write=False)  # a density field does not copy a read-only array
        return density, first, step, None
    values = np.asarray(values, np.float64)
    density, smooth = at_corners(values)
    return density, first, step, estimated_error(values, smooth, step)


def _edges_are_even(edges: list[np.ndarray], steps, along: list[int], size: np.ndarray) -> bool:
    """Return whether the points on the edges of a grid have constant steps along them."""
    uneven = unevenness(size.min(), max(float(np.abs(edge[[0, -1]]).max()) for edge in edges))
    return all(
        (np.abs(edge - (edge[0] + np.arange(len(edge))[:, None] * (step[axis] * np.eye(3)[axis]))) <= uneven).all()
        for edge, step, axis in zip(edges, steps, along, strict=True)
    )


def _is_even(at: np.ndarray, steps, along: list[int], size: np.ndarray) -> bool:
    """Return whether points [k, j, i] have constant steps along every axis, layer by layer."""
    line = [np.arange(n)[:, None] * (step[axis] * np.eye(3)[axis]) for n, step, axis in
            zip(at.shape[2::-1], steps, along, strict=True)]  # fmt: skip
    plane = at[0, 0, 0] + (line[0][None] + line[1][:, None])
    uneven = unevenness(size.min(), np.abs(at[[0, -1]]).max())
    return all((np.abs(layer - (plane + more)) <= uneven).all() for layer, more in zip(at, line[2], strict=True))
