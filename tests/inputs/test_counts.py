"""Counts, sizes and seeds may be floats without a fraction, 1e4 among them; other floats and True are refused."""

from fractions import Fraction

import numpy as np
import pytest

from aerokernels import (
    Camera,
    Disc,
    IndexField,
    RayBundle,
    Sensor,
    SolidBody,
    estimate_strehl,
    range_statistics,
    schlieren,
    trace,
    wavefront,
    zernike,
)
from aerokernels.benches import Bench
from aerokernels.inputs.checks import check_count
from aerokernels.lidar.chain import DetectorChain, Digitiser
from aerokernels.medium import Body

PUPIL = Disc(2e-3, (0.0, 0.0, -9e-3))
PLACE = np.linspace(-0.01, 0.01, 21)
BELL = np.where(abs(PLACE) < 8e-3, np.cos(PLACE * np.pi / 16e-3) ** 4, 0.0)
FIELD = IndexField.from_samples(
    1e-5 * np.outer(BELL, BELL), origin=(-0.01, -0.01), spacing=(1e-3, 1e-3), geometry="planar"
)
WAVE = {"wavelength": 905e-9}
TIME = np.arange(64) * 1e-10
PULSE = np.exp(-(((np.arange(64) - 30) / 5.0) ** 2))
PROFILE = Body(np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), "axisymmetric")

# Name of the parameter, a count, and what a call makes of it.
CALLS = [
    ("ray_count", 64, lambda n: estimate_strehl(FIELD, PUPIL, ray_count=n, **WAVE).value),
    ("seed", 3, lambda n: estimate_strehl(FIELD, PUPIL, ray_count=64, seed=n, symmetry="off", **WAVE).opd_rms),
    ("max_steps", 1000, lambda n: trace(FIELD, RayBundle.collimated(PUPIL, 9), max_steps=n, **WAVE).opd),
    ("pixel_count", 6, lambda n: wavefront(FIELD, PUPIL, pixel_count=n, **WAVE).opd),
    ("ray_count", 50, lambda n: RayBundle.divergent((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), 0.1, n).direction),
    ("rays_per_pixel", 2, lambda n: schlieren(FIELD, width=0.01, pixel_count=4, rays_per_pixel=n, view="x").intensity),
    ("pixel_count", 4, lambda n: schlieren(FIELD, width=0.01, pixel_count=n, view="x").intensity),
    ("source_points", 3, lambda n: Bench(1e-3, 1.0, source_points=n).points()[0]),
    ("pixel_count", 12, lambda n: Camera(PUPIL, 0.1, 5e-6, n, 1.0).shape()),
    ("seed", 2, lambda n: Sensor().expose(np.full((5, 5), 0.5), seed=n)),
    ("bits", 8, lambda n: Sensor(bits=n).levels),
    (
        "trial_count",
        20,
        lambda n: range_statistics(TIME, PULSE, "centroid", noise_rms=0.01, trial_count=n).random_error,
    ),
    ("order", 3, lambda n: DetectorChain(1e3, bandwidth=1e9, order=n).voltage(TIME, PULSE)),
    ("bit_count", 8, lambda n: Digitiser(n).codes([0.1, 0.2])),
    ("count", 7, lambda n: zernike.zernike_modes(n, [0.1, 0.2], [0.3, 0.4])),
    ("count", 12, lambda n: SolidBody.of_revolution(PROFILE, n).vertices),
]


@pytest.mark.parametrize(
    ("name", "count", "call"), CALLS, ids=[f"{name}-{place}" for place, (name, *_) in enumerate(CALLS)]
)
def test_a_whole_number_may_be_a_float(name, count, call):
    expected = call(count)
    for same in (float(count), np.float32(count), np.array(float(count))):
        np.testing.assert_array_equal(call(same), expected)
    for wrong in (count + 0.5, True, np.nan, str(count)):
        with pytest.raises((TypeError, ValueError), match=f"{name}.* whole number"):
            call(wrong)


def test_pairs_of_whole_numbers_may_be_floats():
    pictures = [schlieren(FIELD, width=0.01, pixel_count=count, view="x") for count in ((4, 6), (4.0, 6.0), [4, 6.0])]
    assert all(np.array_equal(one.intensity, pictures[0].intensity) for one in pictures)
    with pytest.raises(ValueError, match=r"pixel_count must be a whole number, got 6\.5 \(in"):
        schlieren(FIELD, width=0.01, pixel_count=(4, 6.5), view="x")


def test_limits_of_counts():
    assert check_count(16.0, "ray_count", 16, 16) == 16 and type(check_count(16.0)) is int
    for wrong in (15.0, 17.0, 16.5, True, None, "16"):
        with pytest.raises(ValueError, match="ray_count must be a whole number from 16 to 16"):
            check_count(wrong, "ray_count", 16, 16)


@pytest.mark.parametrize(
    "number", [np.float32(0.25), np.float64(0.25), np.array(0.25), np.longdouble(0.25), Fraction(1, 4)]
)
def test_single_numbers_arrive_as_floats(number):
    """Whatever is computed from one of NumPy's float32 alone would be in single precision; int16 would overflow."""
    assert type(Disc(number).radius) is float and Disc(number).radius == 0.25
    assert type(Disc(np.int16(300)).radius) is float and Disc(np.int16(300)).area == pytest.approx(np.pi * 300**2)
    assert type(Disc(2).radius) is int
