"""The numbers of the Runge-Kutta-Nystrom pair: the order conditions and rules that define them."""

import numpy as np
import pytest

from aerokernels.tracing.tableau import (
    B_ERROR,
    BT,
    BT_ERROR,
    PATH_ERROR_SLOPE,
    PATH_ERROR_VALUE,
    STAGE_MOMENTUM,
    A,
    B,
    C,
)


@pytest.mark.parametrize(("position", "momentum", "order"), [(B, BT, 4), (B - B_ERROR, BT - BT_ERROR, 3)])
def test_the_weights_integrate_powers_up_to_their_order(position, momentum, order):
    for power in range(order):
        assert momentum @ C**power == pytest.approx(1.0 / (power + 1), abs=1e-15)
    for power in range(order - 1):
        assert position @ C**power == pytest.approx(1.0 / ((power + 1) * (power + 2)), abs=1e-15)


def test_the_stages_are_consistent_and_the_last_is_the_new_point():
    np.testing.assert_allclose(A.sum(axis=1), C**2 / 2.0, rtol=1e-15)
    assert np.array_equal(A[-1], B)
    for power in range(4):
        np.testing.assert_allclose(STAGE_MOMENTUM @ C**power, C ** (power + 1) / (power + 1), atol=1e-15)


def test_the_paths_rule_is_compared_with_one_that_is_exact_to_degree_seven():
    for power in range(8):
        exact = (BT - PATH_ERROR_VALUE) @ C**power - PATH_ERROR_SLOPE @ (power * C ** max(power - 1, 0))
        assert exact == pytest.approx(1.0 / (power + 1), abs=1e-15)
