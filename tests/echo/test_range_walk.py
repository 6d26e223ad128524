"""The range walk curve: the Gaussian's in closed form, and what it leaves of the walk."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import echo, estimate_range
from aerokernels.lidar import HeliosPulse, range_walk
from aerokernels.lidar.pulses import SPEED_OF_LIGHT
from aerokernels.medium import IndexField
from aerokernels.scene import Scene

TAU = 6e-9
TABLE_3 = (2.019, 1.878, 1.809, 1.738)  # peaks from no flow to Mach 4 [V]
TIME = np.arange(-60e-9, 60e-9, 0.5e-9)


def gaussian(peak=2.0, arrival=0.0):
    return peak * np.exp(-(((TIME - arrival) / TAU) ** 2))


@settings(max_examples=50, deadline=None)
@given(st.floats(1.01, 900.0))
def test_curve_of_a_gaussian(ratio):
    """Error -c tau / 2 sqrt(ln(V / T)). The quintic at 12 samples a tau, 1e-7: 1 um."""
    walk = range_walk(TIME, gaussian(), 0.7)
    exact = TAU * math.sqrt(math.log(ratio))
    assert walk.at_peak(0.7 * ratio) == pytest.approx(-0.5 * SPEED_OF_LIGHT * exact, abs=2e-6)
    assert (np.diff(walk.peak) > 0.0).all() and (np.diff(walk.error) < 0.0).all()


def test_corrected_leading_edge_does_not_walk_on_table_3():
    """85 mm before; below 0.5 mm after, as for the methods that need no correction. The curve's own error, 2 um."""
    walk = range_walk(TIME, gaussian(peak=5.0), 1.0)
    raw = [estimate_range(TIME, gaussian(peak, 3.3e-9), "leading-edge", threshold=1.0) for peak in TABLE_3]
    corrected = [
        walk.correct(TIME, gaussian(peak, 3.3e-9), reading) for peak, reading in zip(TABLE_3, raw, strict=True)
    ]
    assert 0.083 < np.ptp(raw) < 0.087
    assert np.ptp(corrected) < 5e-6
    assert corrected[0] == pytest.approx(0.5 * SPEED_OF_LIGHT * 3.3e-9, abs=5e-6)


def test_a_skew_pulse_is_corrected_by_its_own_curve():
    time = np.arange(-20e-9, 300e-9, 0.25e-9)
    shape = HeliosPulse(5e-9)
    walk = range_walk(time, shape(time), 1.0)
    left = []
    for peak in (1.2, 3.0, 40.0):
        volts = peak * shape(time - 2.1e-9)
        left.append(walk.correct(time, volts, estimate_range(time, volts, "leading-edge", threshold=1.0)))
    assert left == pytest.approx([0.5 * SPEED_OF_LIGHT * 2.1e-9] * 3, abs=2e-4)


def test_a_scene_may_ask_for_the_correction():
    """A lump of gas takes 1 % or more of the peak: the bare edge walks by millimetres, the corrected one does not."""
    y, z = np.arange(-0.04, 0.0401, 0.001), np.arange(-0.01, 0.0601, 0.001)
    contrast = 2e-5 * np.exp(-((y[:, None] - 0.004) ** 2 + (z - 0.02) ** 2) / 0.01**2)
    lump = IndexField.from_samples(contrast, origin=(-0.04, -0.01), spacing=(0.001, 0.001), geometry="planar")
    bare, corrected = (
        echo(Scene.load("wind-tunnel-static", {"detector.walk_correction": asked}), field=lump)
        for asked in (False, True)
    )
    assert bare.range_error > 2e-3
    assert abs(corrected.range - bare.ranges["constant-fraction"]) < 2e-5
    assert corrected.ranges["constant-fraction"] == bare.ranges["constant-fraction"]


def test_what_lies_off_the_curve_is_refused():
    walk = range_walk(TIME, gaussian(), 1.0)
    for end in (0, -1):  # its ends are on it
        assert walk.at_peak(walk.peak[end]) == pytest.approx(walk.error[end], rel=1e-9)
    for peak in (0.9, 1.0, 2000.0):
        with pytest.raises(ValueError, match="outside the range walk curve"):
            walk.at_peak(peak)
    with pytest.raises(ValueError, match="cuts the pulse off"):
        range_walk(TIME[112:], gaussian()[112:], 1.0)
    with pytest.raises(ValueError, match="threshold"):
        range_walk(TIME, gaussian(), 0.0)
