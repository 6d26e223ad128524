"""Check the blocks of a data set: coordinates, the corners of cells, and blocks that repeat one mesh."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aerokernels.flow.reading.array_names import plain_name
from aerokernels.flow.reading.dataset import Block, Dataset, ReadError, check_points


def check_blocks(path, dataset: Dataset) -> None:
    """Check that points have finite coordinates and that cells refer to existing points.

    Raises:
        ReadError: The block, the fault and the remedy.
    """
    if not dataset.blocks or not any(len(block.points) for block in dataset.blocks):
        raise ReadError(path, "it has no points", "give a file with a mesh and its arrays")
    for block in dataset.blocks:
        check_points(path, block.points, block.name)
        if block.shape is not None and math.prod(block.shape) != len(block.points):
            raise ReadError(path, f"a grid of {block.shape} points has {len(block.points)}", "write it again")
        if block.cells is not None:
            _check_cells(path, block)


def check_repeated_blocks(path, blocks: Sequence[Block], densities: list[tuple[np.ndarray, str]]) -> None:
    """Reject blocks on the same mesh with other densities: several times or cases of one flow.

    Raises:
        ReadError: The names of two such blocks.
    """
    for k, block in enumerate(blocks):
        for n in range(k):
            (one, where), (other, elsewhere) = densities[k], densities[n]
            if where == elsewhere and _same_mesh(block, blocks[n]) and not np.array_equal(one, other, equal_nan=True):
                names = " and ".join(repr(blocks[i].name or f"block {i + 1}") for i in (n, k))
                what = f"{names} have the same mesh and other densities: several times or cases of one flow"
                raise ReadError(path, what, "write each to a file of its own")


def with_blanks(dataset: Dataset) -> Dataset:
    """Return the dataset with the cells or points blanked where an array `iblank` is 0, as overset grids state it."""
    return replace(dataset, blocks=[_blanked(block) for block in dataset.blocks])


def _blanked(block: Block) -> Block:
    if block.blank is not None:
        return block
    for arrays, count in ((block.cell_data, block.cell_count), (block.point_data, len(block.points))):
        for name in (name for name in arrays if plain_name(name, True) == "iblank"):
            values = np.asarray(arrays[name])
            if values.shape == (count,) and values.dtype.kind in "iuf" and (values == 0).any():
                return replace(block, blank=values == 0)
    return block


def _same_mesh(one: Block, other: Block) -> bool:
    if one.shape != other.shape or len(one.points) != len(other.points) or one.cell_count != other.cell_count:
        return False
    if one.cells is None or other.cells is None:
        return one.shape is not None and np.array_equal(one.points, other.points)
    if one.cells.faces is not None or not np.array_equal(one.cells.points, other.cells.points):
        return False
    return np.array_equal(one.cells.types, other.cells.types) and np.array_equal(one.points, other.points)


def _check_cells(path, block: Block) -> None:
    cells = block.cells
    assert cells is not None
    start, points = cells.start, cells.points
    fits = len(start) == len(cells.types) + 1 and (not len(start) or (start[0] == 0 and start[-1] == len(points)))
    if not fits or (np.diff(start) < 0).any():
        raise ReadError(path, f"the cells of block {block.name!r} do not agree with their own counts", "write it again")
    if len(points) and not (0 <= points.min() and points.max() < len(block.points)):
        cell = int(np.searchsorted(start, int(np.argmax((points < 0) | (points >= len(block.points)))), "right")) - 1
        raise ReadError(
            path, f"cell {cell} has corners beyond the {len(block.points)} points that there are", "write it again"
        )
