"""Sobol points: the very points of SciPy's engine, and the balance that makes them worth having."""

import itertools

import numpy as np
import pytest
from scipy.stats import qmc

from aerokernels.sobol import MAX_DIMENSION, sobol_points

DIMENSIONS = range(1, MAX_DIMENSION + 1)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("count", [1, 2, 64, 4096])
def test_points_are_those_of_scipy_to_the_last_bit(dimension: int, count: int):
    plain = qmc.Sobol(dimension, scramble=False).random(count)
    assert np.array_equal(sobol_points(count, dimension, 0, scramble=False), plain)
    for seed in (0, 1, 20):
        scrambled = qmc.Sobol(dimension, rng=np.random.default_rng(seed)).random(count)
        assert np.array_equal(sobol_points(count, dimension, seed), scrambled)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("seed", [0, 5])
def test_every_elementary_box_holds_its_share(dimension: int, seed: int):
    """Sobol points are a (t, m, s)-net, scrambled or not: t = 0 in one and two dimensions, 1 in three.

    Every box 2^-a x 2^-b (x 2^-c) with a + b + c = m - t then holds exactly 2^t of the 2^m points.
    """
    bits, surplus = 8, max(0, dimension - 2)
    points = sobol_points(2**bits, dimension, seed)
    assert points.min() >= 0.0 and points.max() < 1.0
    for split in itertools.product(range(bits - surplus + 1), repeat=dimension):
        if sum(split) != bits - surplus:
            continue
        boxes = np.floor(points * 2.0 ** np.array(split)).astype(int)
        _, held = np.unique(boxes, axis=0, return_counts=True)
        assert len(held) == 2 ** (bits - surplus) and (held == 2**surplus).all(), split


def test_a_count_that_is_no_power_of_two_gives_the_first_points():
    assert np.array_equal(sobol_points(100, 2, 3), sobol_points(128, 2, 3)[:100])


@pytest.mark.parametrize(
    ("count", "dimension", "message"),
    [(0, 2, "from 1 to 2"), (2**31, 1, "from 1 to 2"), (4, 4, "1 to 3"), (4, 0, "1 to 3")],
)
def test_what_is_not_there_is_refused(count: int, dimension: int, message: str):
    with pytest.raises(ValueError, match=message):
        sobol_points(count, dimension, 0)
