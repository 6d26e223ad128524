"""Records whose peak an amplifier or a digitiser cuts off: all methods but the leading edge tell the change."""

import re
import warnings
from functools import partial

import numpy as np
import pytest

from aerokernels.echo import HeliosPulse, SaturatedRecordWarning, estimate_range
from aerokernels.echo.doubtful_records import restored
from aerokernels.echo.pulses import SPEED_OF_LIGHT
from aerokernels.echo.ranging import Reading

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


def told_error(warning) -> float:
    """The error that a warning tells [m]."""
    return float(re.search(r"up to ([-+.e0-9]+) m", str(warning.message))[1])


@pytest.mark.parametrize("is_known", [True, False])
@pytest.mark.parametrize(("method", "fraction"), [*METHODS, ("constant-fraction", 0.2), ("constant-fraction", 0.8)])
@pytest.mark.parametrize("shape", SHAPES, ids=["gaussian", "helios", "gamma", "secant"])
def test_a_saturated_record_is_told_of_by_how_much(shape, method, fraction, is_known):
    """Pulses cut off at 0.25 to 0.9 of their peak: the reported error covers the range's, and its sign is right.

    Allowed beside it: 3e-3 of the width, for few samples on an edge.
    """
    draw, slack = np.random.default_rng(3), 3e-3 * 0.5 * SPEED_OF_LIGHT * WIDTH
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
        assert abs(found - exact) <= sum(map(told_error, told)) + slack, (cut, period, found - exact)
        if abs(found - exact) > slack:
            assert [one.category for one in told] == [SaturatedRecordWarning], (cut, found - exact)
            assert ("too much" if found > exact else "too little") in str(told[0].message)


@pytest.mark.parametrize("is_known", [True, False])
def test_a_plateau_is_judged_in_units_of_the_noise(is_known):
    """Noise comes after the saturating stage: no two samples of the plateau are equal.

    Cut off at 0.4 to 0.8 of the peak with noise of 0.01 to 0.5 % of the level. Expected: the reported error covers
    that of the range, which is known by the whole pulse, but for four standard deviations of the noise at the crossing
    (noise over slope). A whole pulse with the same noise gives no warning. 3 of 40 records may be missed: their
    plateau is hardly wider than a pulse's own top at that noise.
    """
    draw, missed = np.random.default_rng(8), 0
    for number in range(40):
        shape, cut, share = SHAPES[number % 4], draw.uniform(0.4, 0.8), 10.0 ** draw.uniform(-4.0, -2.3)
        period = 6e-9 / draw.uniform(6.0, 24.0)
        time = np.arange(0.0, 400e-9, period)
        whole = np.asarray(shape(time - 100e-9 - draw.uniform(0.0, period)))
        noise = share * cut * draw.normal(size=time.size)
        template = shape if is_known else None
        read = partial(Reading("constant-fraction", None, template)._arrival, period=period)
        metres = 0.5 * SPEED_OF_LIGHT * period
        with warnings.catch_warnings():
            warnings.simplefilter("error", SaturatedRecordWarning)
            estimate_range(time, whole + noise, "constant-fraction", template=template)
        volts = np.minimum(whole, cut) + noise
        error = metres * (read(volts) - read(whole))
        slack = 4.0 * metres * share * cut / np.abs(np.diff(whole))[np.argmax(whole > 0.5 * cut)]
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            estimate_range(time, volts, "constant-fraction", template=template)
        missed += not told
        assert not told or -error <= told_error(told[0]) + slack
    assert missed <= 3


def test_a_cut_gaussian_is_restored():
    """Its logarithm is a parabola, which the cubic through two samples on either side is, to rounding."""
    time = np.arange(60.0)
    whole = 2.0 * np.exp(-(((time - 27.3) / 6.0) ** 2))
    np.testing.assert_allclose(
        restored(np.minimum(whole, 0.8), slice(*(np.flatnonzero(whole > 0.8)[[0, -1]] + (0, 1)))),
        whole,
        rtol=1e-12,
        atol=1e-15,
    )


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
