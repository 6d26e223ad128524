"""Records whose peak an amplifier or a digitiser cuts off: all methods but the leading edge warn of them."""

import warnings

import numpy as np
import pytest

from aerokernels.lidar import HeliosPulse, SaturatedRecordWarning, estimate_range

METHODS = ("centroid", "matched-filter", "constant-fraction")


def gaussian(time):
    return np.exp(-((time / 6e-9) ** 2))


def squared_secant(time):
    """A symmetric pulse with exponential edges."""
    return 1.0 / np.cosh(np.clip(time / 6e-9, -300.0, 300.0)) ** 2


SHAPES = {"gaussian": gaussian, "helios": HeliosPulse(2.943e-9), "secant": squared_secant}


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_saturated_record_is_told_of(shape, method, noise):
    """Pulses cut off at 0.4 to 0.8 of their peak, with noise that comes after the saturating stage or without.

    A whole pulse with the same noise gives no warning.
    """
    draw, pulse = np.random.default_rng(3), SHAPES[shape]
    for cut in draw.uniform(0.4, 0.8, 6):
        time = np.arange(0.0, 400e-9, 6e-9 / draw.uniform(6.0, 24.0))
        whole = np.asarray(pulse(time - 100e-9))
        rest = noise * cut * draw.normal(size=time.size)
        options = {"template": pulse if method == "matched-filter" else None}
        with pytest.warns(SaturatedRecordWarning, match=f"saturated at 0.*{method}"):
            estimate_range(time, np.minimum(whole, cut) + rest, method, **options)
        with warnings.catch_warnings():
            warnings.simplefilter("error", SaturatedRecordWarning)
            estimate_range(time, whole + rest, method, **options)


@pytest.mark.parametrize("method", METHODS)
def test_a_pulse_that_is_flat_itself_is_not_told_of(method):
    """A template whose own top is flat, as a function and as samples; the leading edge does not depend on the peak."""
    period = 0.25e-9
    time = np.arange(0.0, 250e-9, period)

    def flat(since):
        return np.clip(2.0 - np.abs(since) / 10e-9, 0.0, 1.0)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for template in (flat, flat(np.arange(-120.0, 121.0) * period)):
            estimate_range(time, flat(time - 100e-9), method, template=template)
        estimate_range(time, np.minimum(gaussian(time - 100e-9), 0.5), "leading-edge", threshold=0.3)
