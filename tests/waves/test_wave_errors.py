"""The errors of a split-step wave hold what its steps and its pixels make, against a finer wave of another program."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Rectangle, split_step

WAVELENGTH, RADIUS = 1e-6, 2e-3
WAVE_NUMBER = 2.0 * np.pi / WAVELENGTH


def lens(waves, length):
    """Index field of a Gaussian blob off the axis, as planar samples and as a function; its greatest delay in waves."""
    size, depth, middle = 0.8 * RADIUS, 0.2 * length, (0.3 * RADIUS, 0.5 * length)
    peak = waves * WAVELENGTH / (np.sqrt(np.pi) * depth)

    def contrast(y, z):
        return peak * np.exp(-(((y - middle[0]) / size) ** 2) - ((z - middle[1]) / depth) ** 2)

    y, z = np.linspace(-3.5 * RADIUS, 3.5 * RADIUS, 101), np.linspace(0.0, length, 81)
    where = {"origin": (y[0], 0.0), "spacing": (y[1] - y[0], z[1]), "geometry": "planar"}
    return IndexField.from_samples(contrast(y[:, None], z), **where), contrast


def wave_through(contrast, pupil, length, count, window, steps=96):
    """The amplitude behind the field, by a split step of its own, and the Strehl ratio."""
    pixel = 2.0 * max(pupil.half_extent) * window / count
    edges = pixel * (np.arange(count + 1) - count // 2 - 0.5)
    start = wave = pupil.coverage(edges, edges).astype(complex)
    square = (2.0 * np.pi * np.fft.fftfreq(count, pixel)) ** 2
    turn = 1j * (np.sqrt(WAVE_NUMBER**2 - square[:, None] - square) - WAVE_NUMBER) * length / steps
    for number in range(steps):
        wave = np.fft.ifft2(np.fft.fft2(wave) * np.exp(0.5 * turn))
        path = contrast(edges[:-1] + 0.5 * pixel, (number + 0.5) * length / steps) * length / steps
        wave = np.fft.ifft2(np.fft.fft2(wave * np.exp(1j * WAVE_NUMBER * path)[:, None]) * np.exp(0.5 * turn))
    return wave, abs(wave.sum() / start.sum()) ** 2


@pytest.mark.parametrize("waves", [-0.4, 0.6])
def test_the_error_of_two_steps_holds_what_they_make(waves):
    """A blob a few Fresnel lengths long: half as many steps are one, whose error is not yet of second order."""
    length = RADIUS**2 / WAVELENGTH / 4.0
    field, contrast = lens(waves, length)
    found = split_step(field, Disc(RADIUS), wavelength=WAVELENGTH, pixel_count=64, window=2.5, step_count=2)
    exact, _ = wave_through(contrast, Disc(RADIUS), length, 64, 2.5)
    off = float(np.linalg.norm(found.amplitude - exact) / np.linalg.norm(exact))
    assert found.error / 4.0 < off <= found.error


@pytest.mark.parametrize(("window", "count"), [(1.7, 48), (2.2, 65), (3.0, 48)])
def test_the_error_of_a_strehl_ratio_holds_the_edge_of_a_rectangle(count, window):
    """Edges that fall somewhere within pixels: maps of half as many pixels may be off by as much, by chance."""
    length, pupil = RADIUS**2 / WAVELENGTH / 150.0, Rectangle(2.0 * RADIUS, 1.3 * RADIUS)
    field, contrast = lens(0.5, length)
    found = split_step(field, pupil, wavelength=WAVELENGTH, pixel_count=count, window=window, step_count=4)
    _, exact = wave_through(contrast, pupil, length, 512, window, steps=12)
    assert abs(found.strehl() - exact) <= found.strehl_error < 0.01


@pytest.mark.parametrize("slant", [0.0, 0.1])
def test_errors_contain_what_the_layers_lack(slant: float):
    """Set-up: eight cells along the path, crossed straight or at a slant, with air that ends at the box's faces.

    Expected: amplitude and Strehl ratio are as close to those of 32 times as many layers as the errors say. The steps
    alone would say 1e-6 of the amplitude.
    """
    y, z = np.linspace(-4e-3, 4e-3, 33), np.linspace(0.0, 8e-3, 9)
    samples = 2e-5 * np.cos(y[:, None] / 1e-3 + z / 2e-3)
    field = IndexField.from_samples(samples, origin=(y[0], 0.0), spacing=(y[1] - y[0], z[1]), geometry="planar")
    light = Rectangle(2e-3, 2e-3, (0.0, 0.0, -1e-3), (0.0, slant, 1.0))
    options = {"wavelength": WAVELENGTH, "pixel_count": 32, "window": 1.5}
    found, fine = (split_step(field, light, step_count=count, **options) for count in (8, 256))
    off = np.linalg.norm(found.amplitude - fine.amplitude) / np.linalg.norm(fine.amplitude)
    assert 1e-5 < off < found.error < 20.0 * off
    assert abs(found.strehl() - fine.strehl()) < found.strehl_error
