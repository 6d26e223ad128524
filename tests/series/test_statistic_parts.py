"""The pieces of a series' statistics on numbers whose answer is known by hand."""

import numpy as np
import pytest

from aerokernels.pupils import Disc
from aerokernels.series.modes import orthogonal_modes
from aerokernels.series.statistic_parts import (
    Table,
    _error_by_parts,
    add_apertures,
    covers_of,
    pupil_width,
    spread_map,
)
from aerokernels.series.uncertainty import Mean


def test_the_error_of_a_mean_of_parts():
    """Standard deviation over the root of their number, element by element."""
    assert _error_by_parts([np.array([1.0, 5.0]), np.array([3.0, 5.0]), np.array([5.0, 8.0])]) == pytest.approx(
        [2.0 / np.sqrt(3.0), 1.0]
    )


def test_widths_and_shares_of_round_parts():
    """Pixels of 1 by 2 mm: the greater side counts; a disc of a diameter covers each pixel by its share."""
    x, y = 1e-3 * np.arange(4), 2e-3 * np.arange(3)
    assert pupil_width(x, y) == pytest.approx(6e-3)
    assert pupil_width(x, np.array([0.0])) == pytest.approx(4e-3)
    lit = np.array([[True, True, False, True], [True, True, True, True], [False, True, True, True]])
    edges = 1e-3 * (np.arange(5) - 2.0), 2e-3 * (np.arange(4) - 1.5)
    assert covers_of(x, y, lit)(3e-3) == pytest.approx(Disc(1.5e-3).coverage(*edges)[lit])
    assert np.isnan(spread_map(np.arange(10.0), lit)).sum() == 2 and spread_map(np.arange(10.0), lit)[1, 0] == 3.0


def test_what_drifts_is_named():
    """A probability of a trend below 1 %."""
    table = Table()
    for name, trend in (("one", 0.011), ("other", 0.009), ("none", np.nan)):
        table.number(name, Mean(2.0, 0.5, 7.0, trend), "m", "a number")
    assert table.drifting == ["other"]
    assert table.variables["one"][1] == 2.0 and table.variables["one_error"][1] == 0.5


def test_round_parts_of_a_pupil():
    """Mean and tilt are taken out over each; parts of fewer than 12 pixels have none, and none is wider than all."""
    x = y = 1e-3 * (np.arange(12) - 5.5)
    points = np.stack([axis.ravel() for axis in np.meshgrid(x, y)], axis=1)
    lit, weight = np.full((12, 12), True), np.full(144, 1.0 / 144.0)
    random = np.random.default_rng(2)
    rough = 1e-8 * random.normal(size=(6, 144))
    opd = rough + 1e-6 * (2.0 + points @ np.array([30.0, -10.0]))
    table, coordinates = Table(), {"x": x, "y": y}
    covers = covers_of(x, y, lit)
    add_apertures(table, coordinates, opd, points, weight, 1e-6, (2e-3, 12e-3), covers)
    found = table.variables["opd_rms_aperture"][1]
    assert np.isnan(found[0]) and np.isnan(table.variables["strehl_aperture"][1][0])
    shares = covers(12e-3)
    basis = np.stack([np.ones(144), *points.T], axis=1)
    squares = []
    for one in rough:
        fit = np.linalg.lstsq(basis * np.sqrt(shares)[:, None], one * np.sqrt(shares), rcond=None)[0]
        squares.append(np.average((one - basis @ fit) ** 2, weights=shares))
    assert found[1] == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-6)
    for wrong, told in (((13e-3,), "wider than the maps"), ((0.0,), "positive diameters")):
        with pytest.raises(ValueError, match=told):
            add_apertures(table, coordinates, opd, points, weight, 1e-6, wrong, covers)


@pytest.mark.parametrize("times", [16, 64])
def test_modes_of_known_shapes(times):
    """Two shapes of 20 pixels, mean square 1 by uneven weights, with coefficients that do not correlate: themselves.

    Fewer times than pixels, and more. A mode's greatest entry is positive; what a third one would hold is rounding.
    """
    random = np.random.default_rng(3)
    weight = random.uniform(0.5, 1.5, 20)
    weight /= weight.sum()
    shapes = random.normal(size=(2, 20))
    shapes[0] /= np.sqrt(weight @ shapes[0] ** 2)
    shapes[1] -= (weight @ (shapes[0] * shapes[1])) * shapes[0]
    shapes[1] /= np.sqrt(weight @ shapes[1] ** 2)
    shapes *= np.sign(shapes[np.arange(2), np.abs(shapes).argmax(axis=1)])[:, None]
    angle = 2.0 * np.pi * np.arange(times) / times
    coefficient = np.stack([3.0 * np.cos(angle), np.sin(2.0 * angle)], axis=1)
    modes = orthogonal_modes(coefficient @ shapes + 5.0, weight, 3)
    assert modes.energy == pytest.approx([4.5, 0.5, 0.0], abs=1e-12)
    assert modes.total == pytest.approx(5.0)
    np.testing.assert_allclose(modes.shape[:2], shapes, atol=1e-9)
    np.testing.assert_allclose(modes.coefficient[:, :2], coefficient, atol=1e-9)
    assert np.isnan(modes.shape[2]).all() and not modes.coefficient[:, 2].any()
