"""What counts as below rounding, and how it is shown: in words, without cards, colours and axes."""

import math

import numpy as np
import pytest

import aerokernels as ak
from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import NOTHING, is_flat, quantity_text


@pytest.mark.parametrize(
    ("values", "unit", "error", "flat"),
    [
        ([0.0, 1e-13], "m", math.nan, True),  # the stripes of float32
        ([0.0, 1e-10], "m", math.nan, False),
        ([0.0, 1e-10], "m", 2e-7, True),
        ([0.0, 1e-10], "m", 2e-8, False),
        ([np.nan, np.nan], "m", math.nan, True),
        ([1.0, 1.0 - 1e-7], "1", math.nan, True),
        ([1.0, 0.99], "1", math.nan, False),
        ([1.225, 1.225 * (1.0 + 1e-12)], None, math.nan, True),
        ([1.225, 1.226], None, math.inf, False),
    ],
)
def test_differences_below_rounding_are_flat(values, unit, error, flat):
    assert is_flat(values, unit, error) == flat


def test_a_number_below_rounding_is_said_in_words():
    assert quantity_text(Quantity(1e-13, 2e-13), 1e9, "nm") == quantity_text(Quantity(0.0, 0.0), 1e6, "µrad") == NOTHING
    assert quantity_text(Quantity(0.0, 7e-7), 1e6, "µrad") == "0.00 +- 0.70 µrad"
    assert quantity_text(Quantity(0.0, 1e-13, is_ratio=True), 1.0, "") != NOTHING


@pytest.mark.parametrize(("size", "pictures"), [(1e-14, 0), (1e-7, 1)])
def test_a_flat_wavefront_is_said_in_words(size, pictures):
    pytest.importorskip("matplotlib").use("Agg")
    place = 1e-3 * np.random.default_rng(1).uniform(-1.0, 1.0, (200, 2))
    wave = ak.Wavefront.from_samples(place, size * place[:, 0] / 1e-3, ak.Disc(8e-4), 905e-9, pixel_count=8)
    axes = wave.plot()
    assert len(axes.images) == pictures and bool(axes.texts) == (not pictures)
