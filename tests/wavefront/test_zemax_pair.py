"""Wavefronts and point spread functions that Zemax computed, published with batoid: the second from the first.

Both are aligned as batoid's own test aligns them, by a shift and a flux, and besides by the two scales of an image that
is seen at an angle; its tolerance is 3e-2 of the peak (tests/test_zemax.py there). Zemax's OPD is minus ours.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from aerokernels import Wavefront
from aerokernels.zernike import zernike_modes

WAVELENGTH, PIXEL, F_NUMBER, IMAGE_PIXEL = 750e-9, 1.0 / 128, 2.28, 0.25e-6


def test_zemax_wavefront_makes_zemax_point_spread():
    with np.load(Path(__file__).parent / "zemax_pair" / "hsc.npz") as held:
        opd, measured = -1e-4 * WAVELENGTH * held["wavefront"], held["psf"] / 65535.0
    wave = Wavefront(opd, opd != 0.0, PIXEL, WAVELENGTH)
    # The wavefront's slope is a shift of the picture: both are aligned, so only the form is compared.
    amplitude = wave.weight * np.exp(2j * np.pi / WAVELENGTH * np.nan_to_num(wave.opd))
    place = np.arange(128) - 64

    def model(p: np.ndarray) -> np.ndarray:
        angles = [(place - shift) * scale * IMAGE_PIXEL / F_NUMBER for shift, scale in ((p[0], p[2]), (p[1], p[3]))]
        x, y = (np.exp(-2j * np.pi / WAVELENGTH * np.outer(angle, wave.coordinate)) for angle in angles)
        return p[4] * np.abs(y @ amplitude @ x.T) ** 2 / wave.weight.sum() ** 2

    start = np.array([0.0, 7.0, 1.0, 0.93, 4.0])
    fitted = least_squares(lambda p: (model(p) - measured).ravel(), start, max_nfev=12).x
    assert np.abs(model(fitted) - measured).max() < 3e-2
    assert abs(1.0 / fitted[4] - 0.242) < 0.01  # Zemax's own Strehl ratio
    # The OPD's sign matters: with the other one the picture is another.
    amplitude = amplitude.conj()
    assert np.abs(model(fitted) - measured).max() > 0.3


def rim(place: np.ndarray, toward: tuple[float, float], vignetting: tuple[float, float] | None) -> np.ndarray:
    """Transmission of LSST's annulus, cut by a circle (its middle's place and radius) in the direction of the field.

    Zemax's grid of 32 holds the pupil on 30 pixels; the primary mirror's hole is 0.612 of it; edges share pixels.
    """
    x, y = np.meshgrid(place, place)
    pixel, outer = place[1] - place[0], 30.0 / 32.0

    def within(middle: float, radius: float) -> np.ndarray:
        return np.clip((radius - np.hypot(x - middle * toward[0], y - middle * toward[1])) / pixel + 0.5, 0.0, 1.0)

    found = within(0.0, outer) * (1.0 - within(0.0, 0.612 * outer))
    return found if vignetting is None else found * within(*vignetting)


@pytest.mark.parametrize(
    ("name", "toward", "vignetting", "strehl"),
    [
        ("axis", (0.0, 1.0), None, 0.691),
        ("middle", (0.0, 1.0), None, 0.214),
        ("edge", (0.0, 1.0), (-0.333, 1.183), 0.044),
        ("corner", (np.sqrt(0.5), np.sqrt(0.5)), (-0.283, 1.15), 0.073),
    ],
)
def test_zemax_wavefronts_of_lsst(name, toward, vignetting, strehl):
    """The published map has 32 pixels with a rim of steps, the point spread function 1024: its rim is drawn finely.

    Between the map's pixels stand 55 Zernike polynomials, 0.002 waves rms from it; the circle that vignettes is fitted
    once. With steps the error off the axis is 0.04 to 0.25 of the peak, 0.008 to 0.017 of the perfect one's.
    """
    with np.load(Path(__file__).parent / "zemax_pair" / "lsst.npz") as held:
        opd, measured = -1e-4 * 500e-9 * held[f"wavefront_{name}"], held[f"psf_{name}"] / 65535.0
    coarse = (np.arange(32) - 16) / 16.0
    rows, columns = np.nonzero(opd)
    basis = zernike_modes(55, coarse[columns], coarse[rows])
    coefficients = np.linalg.lstsq(basis.T, opd[rows, columns], rcond=None)[0]
    place = (np.arange(80) + 0.5) / 40.0 - 1.0
    smooth = coefficients @ zernike_modes(55, *(axis.ravel() for axis in np.meshgrid(place, place)))
    wave = Wavefront(smooth.reshape(80, 80), rim(place, toward, vignetting), 1.0 / 40.0, 500e-9)
    amplitude = wave.weight * np.exp(2j * np.pi / wave.wavelength * np.nan_to_num(wave.opd))
    pixels = np.arange(64) - 32

    def model(p: np.ndarray) -> np.ndarray:
        x, y = (
            np.exp(-1j * np.pi * np.outer((pixels - shift) * scale, wave.coordinate))
            for shift, scale in ((p[0], p[2]), (p[1], p[3]))
        )
        return p[4] * np.abs(y @ amplitude @ x.T) ** 2 / wave.weight.sum() ** 2

    start = np.array([0.0, 0.0, 0.5, 0.5, 1.0 / strehl])
    fitted = least_squares(lambda p: (model(p) - measured).ravel(), start, max_nfev=8).x
    assert np.abs(model(fitted) - measured).max() < 3e-2
    assert 1.0 / fitted[4] == pytest.approx(strehl, rel=2e-2)
    assert np.abs(fitted[2:4] - 0.5).max() < 5e-3
