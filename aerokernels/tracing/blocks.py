"""Reduce values at the nodes of a uniform grid over blocks of its cells: the greatest, or the mean along an axis.

Adjacent blocks share the nodes between them; along an axis the last node is repeated until the last block is whole.
"""

from collections.abc import Callable, Iterable

import numpy as np

from ..process.threads import in_threads, slabs

# Number of values that are reduced together.
SLAB = 1 << 16  # speed only


def block_maxima(values: np.ndarray, block: int, axes: Iterable[int] | None = None) -> np.ndarray:
    """The greatest value over the nodes of each block of `block` cells along some axes, by default along all."""
    for axis in range(values.ndim) if axes is None else axes:
        count = values.shape[axis]
        blocks = (count - 2) // block + 1
        # The first nodes of all blocks, then the second ones, and so on, so that a row of blocks is compared at once.
        found = _along(values, axis, slice(0, count - 1, block)).copy(order="K")
        for place in range(1, block + 1):
            nodes = _along(values, axis, slice(place, None, block))
            here = slice(min(nodes.shape[axis], blocks))
            part = _along(found, axis, here)
            np.maximum(part, _along(nodes, axis, here), out=part)
        values = found
    return values


def by_slabs(reduce: Callable[[slice], np.ndarray], shape: tuple[int, ...], block: int, axis: int) -> np.ndarray:
    """Join along an axis what `reduce` makes, in threads, of the nodes of some whole blocks at a time, to save memory.

    `shape` is that of the nodes; axes of the values count from the last one.
    """
    cells = slabs(shape[axis] - 1, int(np.prod(shape)), block)
    found: list = [None] * len(cells)

    def make(number: int) -> None:
        found[number] = reduce(slice(cells[number].start, cells[number].stop + 1))

    in_threads(make, range(len(cells)))
    return np.concatenate(found, axis=axis - len(shape))


def _along(values: np.ndarray, axis: int, places: slice) -> np.ndarray:
    """A view of some entries along an axis."""
    return values[(slice(None),) * axis + (places,)]


def block_means(values: np.ndarray, block: int, axis: int) -> np.ndarray:
    """Means over the cells of each block along an axis, linear between nodes."""
    count = values.shape[axis]
    cells = np.empty((*values.shape[:axis], count - 1 + (1 - count) % block, *values.shape[axis + 1 :]), values.dtype)
    between = _along(cells, axis, slice(count - 1))
    np.add(_along(values, axis, slice(count - 1)), _along(values, axis, slice(1, None)), out=between)
    between *= 0.5
    _along(cells, axis, slice(count - 1, None))[...] = _along(values, axis, slice(count - 1, None))
    # In the order of cells in which np.mean adds them.
    total = _along(cells, axis, slice(0, None, block)).copy(order="K")
    for place in range(1, block):
        total += _along(cells, axis, slice(place, None, block))
    total /= block
    return total


def axis_first(values: np.ndarray, axis: int) -> np.ndarray:
    """A view with an axis in front of the others, as by np.moveaxis, whose checks take longer than small tables."""
    return values.transpose(axis, *range(axis), *range(axis + 1, values.ndim))


def axis_back(values: np.ndarray, axis: int) -> np.ndarray:
    """A view with the first axis in place of `axis`."""
    return values.transpose(*range(1, axis + 1), 0, *range(axis + 1, values.ndim))


def greatest_of_neighbors(values: np.ndarray, count: int, axis: int) -> np.ndarray:
    """The greatest of each run of `count` entries along an axis; of all entries where there are fewer."""
    further = min(count, values.shape[axis]) - 1
    high = further * np.eye(values.ndim, dtype=int)[axis]
    return _along(greatest_around(values, 0 * high, high), axis, slice(values.shape[axis] - further))


def greatest_around(values: np.ndarray, low: Iterable[int], high: Iterable[int]) -> np.ndarray:
    """For each entry the greatest at offsets from `low` to `high` along each axis; beyond the ends there are zeros."""
    for axis, (first, last) in enumerate(zip(low, high, strict=True)):
        if first == last == 0:
            continue
        count, others = values.shape[axis], [*range(axis), *range(axis + 1, values.ndim)]
        first, last = max(-count, min(int(first), count)), max(-count, min(int(last), count))
        before, behind, width, wide = max(-first, 0), max(last, 0), last - first + 1, 1
        moved = values.transpose(axis, *others)
        found = np.zeros((before + count + behind, *moved.shape[1:]), values.dtype)
        found[before : before + count] = moved
        while wide < width:  # runs of 2, 4, 8 ... entries
            further = min(wide, width - wide)
            found = np.maximum(found[:-further], found[further:])
            wide += further
        values = found[before + first :][:count].transpose(*range(1, axis + 1), 0, *range(axis + 1, values.ndim))
    return values


def over_lines(values: np.ndarray, reduce: np.ufunc) -> list[np.ndarray]:
    """For each axis the sums (np.add) or the greatest (np.maximum) of absolute values along it, read once for all."""
    shape = values.shape
    found = [np.zeros(shape[:axis] + shape[axis + 1 :]) for axis in range(values.ndim)]
    slab = max(1, SLAB * len(values) // max(values.size, 1))  # speed only
    for first in range(0, len(values), slab):
        size = np.abs(values[first : first + slab], dtype=np.float64)
        reduce(found[0], reduce.reduce(size, axis=0), out=found[0])
        for axis in range(1, values.ndim):
            reduce.reduce(size, axis=axis, out=found[axis][first : first + slab])
    return found
