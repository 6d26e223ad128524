"""What a high pass leaves of a field: matrices along one axis leave what transforms leave, but for rounding."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels.medium.grid import UniformGrid
from aerokernels.tracing.leapfrog import high_pass as module
from aerokernels.tracing.leapfrog.high_pass import high_pass
from aerokernels.tracing.step_bound import block_size


def grid_of(shape: tuple[int, ...], seed: int) -> UniformGrid:
    samples = 1e-4 * np.random.default_rng(seed).normal(size=shape)
    return UniformGrid(samples, np.zeros(len(shape)), np.full(len(shape), 1e-3), "cubic", False, 1.0003)


@settings(deadline=None)
@given(
    first=st.integers(4, 40),
    second=st.integers(4, 40),
    axis=st.sampled_from((0, 1)),
    cells=st.floats(0.9, 6.0),
    is_fine=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_matrices_leave_what_transforms_leave(first, second, axis, cells, is_fine, seed):
    """Rays along one axis of a plane, samples `cells` apart: equal to rounding, twice, the second time as it is kept.

    Sums of some 40 products of numbers of size 1e-4 and shares of at most 1: 40 roundings of the greatest.
    """
    steepness = np.array([0.0, 0.0])
    steepness[axis] = 1.0
    options = steepness, cells * 1e-3, (0.92, 0.4), is_fine
    shape = first, second
    grid = grid_of(shape, seed)
    with pytest.MonkeyPatch.context() as changed:
        changed.setattr(module, "MOST_ALONG", 0)
        expected = high_pass(grid, *options)
    unit = np.finfo(np.float64 if is_fine else np.float32).eps
    allowed = 40.0 * unit * max(shape) * np.abs(grid.samples).max()
    for _ in range(2):
        for one, other in zip(high_pass(grid, *options), expected, strict=True):
            assert one.shape == other.shape
            assert np.abs(one - other).max() <= allowed


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("count", [9, 10, 38])
def test_the_second_edge_is_there_where_it_is_wanted(axis: int, count: int):
    """Blocks that are asked for, whole ones and the last, shorter one: all of their nodes are right."""
    shape = (count, 17) if axis == 0 else (17, count)
    grid = grid_of(shape, 3)
    steepness = np.eye(2)[axis]
    everywhere = high_pass(grid, steepness, 4e-3, (0.92, 0.4), True)
    block = block_size(grid)
    blocks = tuple((nodes - 2) // block + 1 for nodes in shape)
    for number in range(blocks[axis]):
        wanted = np.zeros(blocks, np.uint8)
        wanted[(number, 1) if axis == 0 else (1, number)] = 1
        first, second = high_pass(grid, steepness, 4e-3, (0.92, 0.4), True, wanted)
        assert np.array_equal(first, everywhere[0])
        nodes = np.arange(number * block, min((number + 1) * block, count - 1) + 1)
        found, all_of_them = second.take(nodes, axis), everywhere[1].take(nodes, axis)
        assert np.abs(found - all_of_them).max() < 1e-17
