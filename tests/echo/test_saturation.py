"""Records whose peak an amplifier or a digitiser cuts off: all methods but the leading edge tell the change."""

import warnings
from functools import partial

import numpy as np
import pytest

from aerokernels.echo import HeliosPulse, SaturatedRecordWarning, estimate_range
from aerokernels.echo.ranging import Reading
from aerokernels.echo.saturation import restored, saturation_shift
from aerokernels.echo.waveform import SPEED_OF_LIGHT

WIDTH = 12e-9  # of the pulses, about [s]


def gaussian(time):
    return np.exp(-((time / 6e-9) ** 2))


def gamma_of_order_six(time):
    """A skew pulse that rises as the sixth power of time."""
    ratio = np.maximum(time / 12e-9 + 1.0, 1e-300)
    return ratio**6 * np.exp(-6.0 * (ratio - 1.0))


def squared_secant(time):
    """A symmetric pulse with exponential edges."""
    return 1.0 / np.cosh(np.clip(time / 6e-9, -300.0, 300.0)) ** 2


SHAPES = [gaussian, HeliosPulse(2.943e-9), gamma_of_order_six, squared_secant]
METHODS = [(name, 0.5) for name in ("centroid", "matched-filter", "constant-fraction")]


@pytest.mark.parametrize("is_known", [True, False])
@pytest.mark.parametrize(("method", "fraction"), [*METHODS, ("constant-fraction", 0.2), ("constant-fraction", 0.8)])
@pytest.mark.parametrize("shape", SHAPES, ids=["gaussian", "helios", "gamma", "secant"])
def test_a_saturated_record_is_told_of_by_how_much(shape, method, fraction, is_known):
    """Pulses cut off at 0.25 to 0.9 of their peak: the reported error covers the range's, and its sign is right.

    Allowed beside it: 2e-3 of the width, for few samples on an edge.
    """
    draw, slack = np.random.default_rng(3), 2e-3 * 0.5 * SPEED_OF_LIGHT * WIDTH
    for cut in draw.uniform(0.25, 0.9, 12):
        period = 6e-9 / draw.uniform(4.0, 12.0)
        time = np.arange(0.0, 400e-9, period)
        whole = np.asarray(shape(time - 100e-9 - draw.uniform(0.0, period)))
        volts = np.minimum(whole, cut)
        template = shape if is_known or method == "matched-filter" else None
        options = {"template": template, "fraction": fraction}
        read = partial(Reading(method, None, template, fraction)._arrival, period=period)
        exact = 0.5 * SPEED_OF_LIGHT * period * read(whole)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = estimate_range(time, volts, method, **options)
        shift = saturation_shift(volts, read, template, period)
        shift *= 0.5 * SPEED_OF_LIGHT * period
        assert abs(found - exact) <= abs(shift) + slack, (cut, period, found - exact)
        if abs(found - exact) > slack:
            assert [one.category for one in told] == [SaturatedRecordWarning], (cut, found - exact)
            assert ("too much" if found > exact else "too little") in str(told[0].message)


def test_a_cut_gaussian_is_restored():
    """Its logarithm is a parabola, which the cubic through two samples on either side is, to rounding."""
    time = np.arange(60.0)
    whole = 2.0 * np.exp(-(((time - 27.3) / 6.0) ** 2))
    np.testing.assert_allclose(restored(np.minimum(whole, 0.8)), whole, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(("method", "fraction"), [*METHODS, ("constant-fraction", 0.2), ("constant-fraction", 0.8)])
def test_whole_and_flat_pulses_are_not_told_of(method, fraction):
    """The greatest samples of a whole pulse differ, and a pulse whose own shape is flat may have equal ones."""
    period = 0.25e-9
    time = np.arange(0.0, 250e-9, period)

    def flat(since):
        return np.clip(2.0 - np.abs(since) / 10e-9, 0.0, 1.0)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimate_range(time, gaussian(time - 100e-9), method, fraction=fraction, template=gaussian)
        estimate_range(time, flat(time - 100e-9), method, fraction=fraction, template=flat)
        samples = flat(np.arange(-120.0, 121.0) * period)
        estimate_range(time, flat(time - 100e-9), method, fraction=fraction, template=samples)
    estimate_range(time, np.minimum(gaussian(time - 100e-9), 0.5), "leading-edge", threshold=0.3)
