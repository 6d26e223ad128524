"""What coarser nodes tell of an error: Richardson's estimate of known series, and the levels of grids."""

import gc
import weakref

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.medium.levels import refinement, richardson_error


def three(order: float, size: np.ndarray) -> tuple[np.ndarray, ...]:
    """Values through all nodes, every second and every fourth one, with errors of one order about the truth 2."""
    return tuple(2.0 + size * step**order for step in (1.0, 2.0, 4.0))


@pytest.mark.parametrize("count", [1, 5, 200])
@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 3.0])
def test_errors_of_one_order_come_out_exactly(order, count):
    """The truth less the finest values, for any number of values, whatever their sizes and signs."""
    size = np.random.default_rng(1).normal(size=count)
    assert richardson_error(*three(order, size), 4.0) == pytest.approx(-size, rel=1e-10)


def test_an_order_is_believed_between_a_half_and_the_highest():
    """Order 6 counts as 4: the change over 15. Order 0.1 counts as 0.5; equal values have no error."""
    size = np.array([1.0, -2.0])
    fine, coarse, coarser = three(6.0, size)
    assert richardson_error(fine, coarse, coarser, 4.0) == pytest.approx((fine - coarse) / 15.0, rel=1e-12)
    fine, coarse, coarser = three(0.1, size)
    assert richardson_error(fine, coarse, coarser, 4.0) == pytest.approx((fine - coarse) / (2.0**0.5 - 1.0), rel=1e-12)
    assert not richardson_error(fine, fine, fine, 4.0).any()
    assert richardson_error(fine, fine, coarse, 4.0) == pytest.approx(0.0, abs=0.0)


@pytest.mark.parametrize(("sign", "highest"), [(1.0, 4.0), (-1.0, 1.0)])
def test_the_sharpest_eighth_has_an_order_of_its_own(sign, highest):
    """Of 64 values eight are 300 times as great: of order 1.5, or with changes of both signs, which tells no order.

    Where both changes have one sign in the mean the order is that of their rms, else at most 1. The others have the
    order seen in all, which the sharp ones rule; none is less than that.
    """
    size = np.r_[np.full(56, 1.0), np.full(8, 300.0)]
    change = np.r_[np.full(56, 1.0), np.full(8, 300.0)]
    before = np.r_[np.full(56, 8.0), sign * np.full(8, 300.0 * 2.0**1.5)]
    found = richardson_error(change + before, before, 0.0 * size, 4.0)
    whole = np.log2(np.sqrt(np.mean(before**2) / np.mean(change**2)))
    assert found[:56] == pytest.approx(1.0 / (2.0**whole - 1.0), rel=1e-12)
    sharp = max(1.0 / (2.0 ** min(1.5, highest) - 1.0), 1.0 / (2.0**whole - 1.0))
    assert found[56:] == pytest.approx(300.0 * sharp, rel=1e-12)


def test_levels_of_a_grid_keep_every_second_and_fourth_node():
    """Nodes that are left over are cut off where the samples vary less; an axis of fewer than 5 keeps all its nodes."""
    samples = np.zeros((4, 12))
    samples[:, 11] = 1e-4  # 11 cells: three are cut off, at the low end
    field = IndexField.from_samples(samples, origin=(0.0, 1.0), spacing=(0.5, 0.25), geometry="planar")
    levels = refinement(field)
    for one, every in ((levels.fine, 1), (levels.coarse, 2), (levels.coarser, 4)):
        np.testing.assert_array_equal(one.samples.samples, samples[:, 3::every])
        assert one.samples.spacing == pytest.approx([0.5, 0.25 * every])
        assert one.samples.origin == pytest.approx([0.0, 1.75])
    mirrored = refinement(
        IndexField.from_samples(samples[:, ::-1], origin=(0.0, 1.0), spacing=(0.5, 0.25), geometry="planar")
    )
    np.testing.assert_array_equal(mirrored.coarser.samples.samples, samples[:, ::-1][:, :9:4])
    assert mirrored.fine.samples.origin == pytest.approx([0.0, 1.0])
    small = IndexField.from_samples(samples[:, :7], origin=(0.0, 1.0), spacing=(0.5, 0.25), geometry="planar")
    assert refinement(small).coarser is None and refinement(small).coarse.samples.shape == (4, 4)


def test_a_grid_of_which_nothing_is_left_out_is_its_own_finest_level():
    """Its spline and tables serve again; without a reference back, so that no cycle keeps its memory."""
    field = IndexField.from_samples(np.eye(9) * 1e-4, origin=(0.0, 0.0), spacing=(1.0, 1.0), geometry="planar")
    assert field.refinement.fine is field and field.refinement.coarse is field.refinement.coarse
    few = IndexField.from_samples(np.eye(4) * 1e-4, origin=(0.0, 0.0), spacing=(1.0, 1.0), geometry="planar")
    assert few.refinement.fine is few
    gone = weakref.ref(field), weakref.ref(few)
    gc.disable()
    try:
        del field, few
        assert [each() for each in gone] == [None, None]
    finally:
        gc.enable()


def test_few_nodes_are_compared_with_another_interpolant():
    """Four nodes an axis have no level: cubic beside linear, whose difference is the error."""
    field = IndexField.from_samples(np.eye(4) * 1e-4, origin=(0.0, 0.0), spacing=(1.0, 1.0), geometry="planar")
    levels = refinement(field)
    assert levels.coarse.interpolation == "linear" and levels.coarser is None and levels.share == 1.0
    assert levels.richardson_error(np.array([3.0]), np.array([1.0]), None) == 2.0
