"""What the pixels change in the numbers of an image is reported: against closed forms and quadrature."""

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Rectangle, Wavefront
from aerokernels.wavefronts import PointSpread
from aerokernels.wavefronts.pixels import pupil_grid

WAVELENGTH, WIDTH, HEIGHT = 1e-6, 0.1, 0.061
RESOLUTION = WAVELENGTH / WIDTH
WAVE_NUMBER = 2.0 * np.pi / WAVELENGTH


def along_x(x):
    """OPD along x [m], and its slope."""
    u = x / WIDTH
    return WAVELENGTH * (1.2 * u**3 + 0.5 * u**2), WAVELENGTH / WIDTH * (3.6 * u**2 + u)


def along_y(y):
    """OPD along y [m], and its slope."""
    u = y / HEIGHT
    return WAVELENGTH * 0.15 * np.sin(7.0 * u + 0.4), WAVELENGTH / HEIGHT * 1.05 * np.cos(7.0 * u + 0.4)


def transfer(surface, side, shifts):
    """Transfer function of one axis of a rectangle by Gauss's rule over the overlap: shape of the shifts [m]."""
    node, weight = np.polynomial.legendre.leggauss(60)
    overlap = np.maximum(side - np.abs(shifts), 0.0)[:, None]
    x = 0.5 * overlap * node
    difference = surface(x - 0.5 * shifts[:, None])[0] - surface(x + 0.5 * shifts[:, None])[0]
    return (0.5 * overlap * weight * np.exp(1j * WAVE_NUMBER * difference)).sum(axis=1) / side


@pytest.mark.parametrize("count", [21, 38])
def test_errors_hold_what_the_pixels_make_of_an_image(count):
    """A rectangle of a separable wavefront, whose edges fall within pixels; no other error."""
    pupil = Rectangle(WIDTH, HEIGHT)
    coordinate, pixel, weight, intensity = pupil_grid(pupil, count)
    opd = along_x(coordinate)[0] + along_y(coordinate)[0][:, None]
    wave = Wavefront(opd, weight, pixel, WAVELENGTH, intensity=intensity, pupil=pupil, budget=lambda: {"total": 0.0})
    told, otf = wave.image_quantities(), wave.otf()
    shifts = otf.frequency * WAVELENGTH
    exact = transfer(along_y, HEIGHT, shifts)[:, None] * transfer(along_x, WIDTH, shifts)
    assert np.mean(np.abs(exact - otf.value) <= otf.error + 1e-12) > 0.97
    # Along the axis two edges lie on one another after any shift, and half a pixel more light is common to both.
    middle = len(otf.frequency) // 2
    off = np.abs(exact - otf.value)[middle]
    assert off.max() > 1e-3 and (off <= otf.error[middle] + 1e-12).all()
    assert otf.error.max() < 3.0 / count

    node, share = np.polynomial.legendre.leggauss(60)
    slopes = [0.5 * share @ surface(0.5 * side * node)[1] for surface, side in ((along_x, WIDTH), (along_y, HEIGHT))]
    angle = np.linspace(-4.0, 4.0, 641) * RESOLUTION
    intensity = []
    for surface, side in ((along_x, WIDTH), (along_y, HEIGHT)):
        x = 0.5 * side * node
        light = 0.5 * np.exp(1j * WAVE_NUMBER * (surface(x)[0] - np.outer(angle, x))) @ share
        intensity.append(np.abs(light) ** 2)
    width = PointSpread(np.outer(intensity[1], intensity[0]), angle).fwhm
    for name, true in {
        "centroid_x": slopes[0],
        "centroid_y": slopes[1],
        "fwhm": width,
    }.items():
        found = told[name]
        assert 0.0 < abs(found.value - true) <= 1.2 * found.error + 1e-6 * abs(true), name
        assert found.error < 0.2 * (abs(found.value) if name == "fwhm" else RESOLUTION), name


def surface(x, y):
    """OPD [m] of focus, coma and a ripple."""
    u, v = x / 0.05, y / 0.05
    ripple = 0.05 * np.cos(6.0 * u - 4.0 * v + 1.0)
    return WAVELENGTH * (0.2 * (u**2 + v**2) + 0.1 * u * (u**2 + v**2) + 0.3 * v + ripple)


def test_a_width_counts_all_of_the_light_above_half_of_the_peak():
    """A grating of two equal orders, ten resolution elements apart: twice the area of one spot."""
    coordinate = (np.arange(60) - 29.5) * WIDTH / 60
    grating = 0.25 * WAVELENGTH * np.sign(np.sin(2.0 * np.pi * 5.0 * coordinate / WIDTH))
    flat, parted = (
        Wavefront(opd * np.ones((60, 60)), np.ones((60, 60)), WIDTH / 60, WAVELENGTH) for opd in (0.0, grating)
    )
    assert parted.fwhm == pytest.approx(np.sqrt(2.0) * flat.fwhm, rel=1e-2)


def test_coefficients_that_hardly_differ_have_great_errors():
    """Eleven polynomials over a disc, where they are orthogonal, and over a thin ring, where some are nearly alike."""
    told = []
    for pupil in (Disc(0.01), Annulus(0.01, 0.009)):
        _, pixel, weight, intensity = pupil_grid(pupil, 40)
        options = {"intensity": intensity, "pupil": pupil, "radius": 0.01, "budget": lambda: {"total": 1e-9}}
        told.append(Wavefront(0.0 * weight, weight, pixel, WAVELENGTH, **options).zernike_errors(11).max())
    assert told[0] < 1e-9 and told[1] > 2.0 * told[0]


def test_the_error_of_a_width_holds_the_sampling_of_the_image():
    """Airy's disc, (2 J1(v) / v)^2 = 1/2 at v = 1.616340: contours through samples 1/64 apart are 8e-5 too narrow."""
    pupil = Disc(0.5 * WIDTH)
    coordinate, pixel, weight, intensity = pupil_grid(pupil, 160)
    flat = np.zeros((len(coordinate), len(coordinate)))
    wave = Wavefront(flat, weight, pixel, WAVELENGTH, intensity=intensity, pupil=pupil, budget=lambda: {"total": 0.0})
    found, exact = wave.image_quantities()["fwhm"], 2.0 * 1.61633995 / np.pi * RESOLUTION
    assert abs(found.value - exact) <= found.error < 2e-4 * exact
    # A Gaussian sampled ten times across its width, whose peak is between the samples.
    angle = np.linspace(-3.0, 3.0, 61)
    spot = np.exp(-4.0 * np.log(2.0) * ((angle - 0.11) ** 2 + (angle[:, None] + 0.07) ** 2))
    assert PointSpread(spot, angle).fwhm == pytest.approx(1.0, rel=2e-3, abs=0.0)


@pytest.mark.parametrize("pupil", [Disc(0.5 * WIDTH), Rectangle(WIDTH, HEIGHT)], ids=lambda one: type(one).__name__)
def test_the_error_of_a_structure_function_holds_what_the_pixels_make(pupil):
    """A ripple askew to the pixels and coma, against a map of seven times as many pixels across."""

    def seen(count):
        coordinate, pixel, weight, intensity = pupil_grid(pupil, count)
        x, y = np.meshgrid(coordinate / WIDTH, coordinate / WIDTH)
        opd = WAVELENGTH * (0.1 * np.cos(11.0 * x + 7.0 * y + 1.0) + 0.3 * x * (x**2 + y**2) + 0.1 * y)
        rest = {"intensity": intensity, "pupil": pupil, "budget": lambda: {"total": 0.0}}
        return Wavefront(opd, weight, pixel, WAVELENGTH, **rest).structure_function()

    found, fine = seen(29), seen(203)
    known = (found.separation > 0.0) & (found.separation < 0.9 * HEIGHT)
    exact = np.interp(found.separation, fine.separation, np.sqrt(fine.value)) ** 2
    off = np.abs(found.value - exact)[known]
    assert off.max() > 0.01 * exact[known].max()
    assert np.mean(off <= found.error[known] + 1e-3 * exact[known]) > 0.9
    assert np.median(found.error[known] / exact[known]) < 0.1
    assert found.error[0] == 0.0
