"""A wavefront and a point spread function that Zemax computed, published with batoid: the second from the first.

Both are aligned as batoid's own test aligns them, by a shift and a flux, and besides by the two scales of an image that
is seen at an angle; its tolerance is 3e-2 of the peak (tests/test_zemax.py there). Zemax's OPD is minus ours.
"""

from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from aerokernels import Wavefront

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
