"""Arguments in another unit than SI, whose answers would be worthless without a word, are refused with the unit."""

import numpy as np
import pytest

from aerokernels import (
    Disc,
    IndexField,
    Scene,
    compare_waveforms,
    estimate_range,
    estimate_strehl,
    flow,
    schlieren,
    strehl,
)
from aerokernels.focus.estimate import PreparedStrehl
from aerokernels.lidar.rangefinder import vacuum_echo

SAMPLES = np.arange(100.0)
PULSE = 2.0 * np.exp(-(((SAMPLES - 50.0) / 6.0) ** 2))


def small_field() -> IndexField:
    """A weak lens over 16 mm."""
    z, r = np.meshgrid(np.linspace(0.0, 16e-3, 17), np.linspace(0.0, 8e-3, 9))
    contrast = 2e-5 * np.exp(-(r**2 + (z - 8e-3) ** 2) / 2e-3**2)
    return IndexField.from_samples(contrast, origin=(0.0, 0.0), spacing=(1e-3, 1e-3), geometry="axisymmetric")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: estimate_strehl(small_field(), Disc(6.0), ray_count=64), r"reach of 6 m .*metres, 6e-3 for 6 mm"),
        (lambda: PreparedStrehl(small_field(), Disc(0.5)), r"reach of 0\.5 m is 3\d times"),
        (lambda: strehl(np.array([0.0, 50.0, 20.0]), 905e-9), r"rms is .* m, more than .*50e-9 for 50 nm"),
        (lambda: strehl(np.array([0.0, 0.1, 0.25]), 905e-9), "waves times the wavelength"),
        (lambda: estimate_range(SAMPLES, PULSE, "centroid"), "give seconds, 1e-9 for 1 ns"),
        (lambda: compare_waveforms(SAMPLES, PULSE, PULSE), "give seconds, 1e-9 for 1 ns"),
        (lambda: vacuum_echo(Scene.load("wind-tunnel-static", {"receiver.diameter": 12})), "12e-3 for 12 mm"),
        (lambda: schlieren(small_field(), extent=(0.0, 16.0, -8.0, 8.0), pixel_count=8), "give metres, or more pixels"),
        (lambda: flow.uniform_air().index_field(constant=0.225), r"air has 2\.25e-4 m3/kg, .* 0\.225 cm3/g"),
        (lambda: flow.uniform_air(1225.0), "too great for a gas .*1.225 for 1225 g/m3"),
        (lambda: flow.shipped("mach3").scaled(1225.0), "1.225 for 1225 g/m3"),
        (lambda: flow.cone(2.0, 0.2, density=1225.0), "1.225 for 1225 g/m3"),
        (lambda: flow.tunnel_conditions(3.0, 0.63, 288.0), "630e3 for 0.63 MPa"),
        (lambda: flow.tunnel_conditions(3.0, 0.63e6, 15.0), "288 for 15 degC"),
        (lambda: Scene.load("wind-tunnel-static", {"flow.density": 1225}), r"flow\.density = 1225: .*for 1225 g/m3"),
        (
            lambda: Scene.load("wind-tunnel-static", {"flow.gladstone_dale": 0.225}),
            r"flow\.gladstone_dale = 0\.225: .* 0\.225 cm3/g",
        ),
    ],
)
def test_another_unit_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_what_is_large_but_right_is_taken():
    """A pupil somewhat wider than the field, a wavefront of a hundred waves, a picture wider than the field."""
    assert estimate_strehl(small_field(), Disc(8e-3), ray_count=64).value > 0.5
    assert strehl(np.array([0.0, 1e-4]), 905e-9) <= 1.0
    assert schlieren(small_field(), extent=(-0.05, 0.05, -0.05, 0.05), pixel_count=16).intensity.shape == (16, 16)
