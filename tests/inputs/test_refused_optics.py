"""What cameras, sensors, spectra, polynomials, interferometers and error budgets refuse, or say of nothing."""

import math

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Wavefront, background_displacement
from aerokernels.benches import Bench
from aerokernels.files.writing import write_grey
from aerokernels.fldi import FLDI, fldi_response
from aerokernels.fldi.response import FLDIResponse
from aerokernels.imaging.bos import Background, DotPattern
from aerokernels.imaging.camera import Camera
from aerokernels.sensor import Sensor
from aerokernels.wavefronts import point_spread_function
from aerokernels.waves import Wave, angular_spectrum

CAMERA = Camera(Disc(0.01), 0.1, 5e-6, 8)
FLAT = Wavefront(np.zeros((4, 4)), np.ones((4, 4)), 1e-3, 1e-6)
FIELD = IndexField.from_samples(np.zeros((3, 3)), origin=(0.0, 0.0), spacing=(0.1, 0.1), geometry="planar")


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda tmp: Camera(Disc(0.01), -0.1, 5e-6), "focal_length must be positive and finite [m]"),
        (lambda tmp: Background.of_scene(np.ones(3), 1.0, CAMERA), "a background must be a finite array"),
        (lambda tmp: DotPattern(density=math.nan), "density = nan: give a positive number"),
        (lambda tmp: DotPattern(diameter=0.5), "dots below one pixel are not resolved"),
        (lambda tmp: Sensor(full_well=0.0), "full_well must be positive and finite, got 0.0"),
        (lambda tmp: Sensor(bits=17), "bits must be a whole number from 1 to 16, got 17"),
        (lambda tmp: write_grey(tmp / "a.jpg", np.ones((2, 2))), "the ending must be one of .tif, .tiff, .png"),
        (lambda tmp: FLAT.without_zernike(0, 4), "a Noll index must be a whole number of at least 1, got 0"),
        (
            lambda tmp: point_spread_function(np.zeros((2, 2)), [[1.0, math.nan], [1.0, 1.0]], 1e-3, 1e-6),
            "the mask must be finite and not negative",
        ),
        (
            lambda tmp: Wavefront(np.zeros((2, 2)), np.ones((2, 2)), 1e-3, 1e-6, np.full((2, 2), math.inf)),
            "the intensity must be finite",
        ),
        (lambda tmp: angular_spectrum(np.ones((4, 4)), 1e-3, 905.0, 1.0), "give metres, 9.05e-07 for 905 nm"),
        (lambda tmp: angular_spectrum(np.ones((4, 4)), 1e-3, 1e-6, math.nan), "distance must be finite"),
        (lambda tmp: Wave(np.ones((4, 4)), 1e-3, 1e-6, ambient_index=math.nan), "ambient_index must be positive"),
        (lambda tmp: Wave(np.ones((4, 4)), 1e-3, 1e-6).psf([math.nan]), "angle must be finite angles [rad]"),
        (
            lambda tmp: background_displacement(FIELD, CAMERA, shape=(4, 4), tolerance=-1.0),
            "tolerance must be positive and finite [waves]",
        ),
    ],
)
def test_values(made, told, tmp_path):
    with pytest.raises(ValueError) as refused:
        made(tmp_path)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: Camera(3, 0.1, 5e-6), "pupil must be a Disc"),
        (lambda: background_displacement(3, CAMERA), "field must be an IndexField, got int"),
        (lambda: Camera(Disc(0.01), "100 mm", 5e-6), "focal_length must be a number of metres, got '100 mm': give 0.1"),
        (lambda: FLDI("120 um", 1e-5), "separation must be a number of metres, got '120 um': give 0.00012"),
        (lambda: Bench("2 mm", 1.0), "source_size must be a number of metres or None, got '2 mm': give 0.002"),
        (lambda: Sensor(shot_noise="no"), "shot_noise must be True or False, got 'no'"),
        (lambda: fldi_response(FIELD, FLDI(1e-4, 1e-5), offsets="x"), "offsets must be an array of real numbers"),
        (lambda: FLDI(1e-4, 1e-5).transfer("x"), "wave_number must be an array of real numbers"),
        (lambda: FLAT.zernike("x"), "count must be a whole number"),
        (lambda: Wavefront(np.zeros((4, 4)), np.ones((4, 4)), "1 mm", 1e-6), "pixel must be a number of metres"),
        (lambda: Wavefront(np.zeros((4, 4)), np.ones((4, 4)), 1e-3, 1e-6, pupil="disc"), "pupil must be one of"),
    ],
)
def test_kinds(made, told):
    with pytest.raises(TypeError, match=told):
        made()


def test_what_an_interferometer_looks_through():
    instrument = FLDI(1e-4, 5e-6)
    response = FLDIResponse(*(np.zeros(4) for _ in range(5)), np.array([0.0, 1.0, 2.0, 4.0]), instrument)
    with pytest.raises(ValueError, match="a spectrum needs snapshots at even times"):
        response.spectrum()
    short = FLDIResponse(*(np.zeros(3) for _ in range(5)), np.arange(3.0), instrument)
    with pytest.raises(ValueError, match="a series of at least 4 snapshots"):
        short.spectrum()
    for field, fault, told in (
        (3, TypeError, "field must be an IndexField, a DensityField, a Series or several fields, got int"),
        ([3], TypeError, "field must be an IndexField, a DensityField or a Series, got int"),
        ([], ValueError, "no field was given"),
    ):
        with pytest.raises(fault, match=told):
            fldi_response(field, instrument)
    with pytest.raises(ValueError, match="one entry for each of the 1 fields"):
        fldi_response([FIELD], instrument, time=[0.0, 1.0])
    with pytest.raises(ValueError, match="rays must be a whole number from 3 to 2048, got 1"):
        fldi_response(FIELD, instrument, rays=1)


def test_what_would_take_hours_or_end_in_pythons_words_is_refused(tmp_path):
    """A million Zernike polynomials, a thousand million rays, no path, no dataset; refused at once and in words."""
    from aerokernels.lidar import detect

    place = Disc(0.01).flat_sample(300, "sobol", 0)[0] * 0.01
    wave = Wavefront.from_samples(place, 1e-5 * place[:, 0], Disc(0.01), 1e-6, pixel_count=12)
    with pytest.raises(ValueError, match="samples cannot distinguish 1000000 Zernike"):
        wave.zernike(10**6)
    assert np.isinf(wave.zernike_errors(10**6)).all()
    with pytest.raises(TypeError, match="count must be a whole number"):
        wave.zernike_errors("a")
    for write in (wave.to_fits, wave.to_zemax):
        with pytest.raises(TypeError, match="path"):
            write(None)
    with pytest.raises(TypeError, match=r"must be an xarray.Dataset"):
        Wavefront.from_xarray({})
    field = IndexField.from_samples(np.zeros((9, 9)), origin=(0, 0), spacing=(1e-3, 1e-3), geometry="planar")
    with pytest.raises(ValueError, match=r"a low-pass of 1 Hz takes 5\.\d+e\+09 sample periods"):
        detect(np.arange(9) * 1e-9, np.ones(9), volts_per_watt=1.0, bandwidth=1.0)
    with pytest.raises(ValueError, match="must be finite"):
        FLDI(1e-4, 1e-5).transfer(np.nan)
    with pytest.raises(ValueError, match="rays must be a whole number from 3 to 2048"):
        fldi_response(field, FLDI(1e-4, 1e-5), rays=10**9)
