"""Wave optics: closed forms in free space and in fields, and the rays where they are good."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import airy, fresnel, j1

from aerokernels import Disc, IndexField, Rectangle, Wave, split_step, validity
from aerokernels.medium import Body
from aerokernels.waves import angular_spectrum
from aerokernels.waves.layers import mean_layers, sample_layers
from tests.phase_plates import DEPTH, WAVELENGTH, phase_plate

K = 2.0 * np.pi / WAVELENGTH


def line(count: int, pixel: float) -> np.ndarray:
    return pixel * (np.arange(count) - count // 2)


def gaussian(x, y, waist: float, z: float) -> np.ndarray:
    """A paraxial Gaussian beam, its waist at z = 0: amplitude less exp(i k z)."""
    q = 1.0 + 2j * z / (K * waist**2)
    return np.exp(-(x**2 + y**2) / (waist**2 * q)) / q


def test_gaussian_beam():
    """Paraxial: the closed form to rounding. Helmholtz: that less its own corrections, (lambda / w)^2 k z / 8 about."""
    x, waist, z = line(256, 2e-5), 4e-4, 0.3
    start = gaussian(x[None, :], x[:, None], waist, -0.1)
    found = angular_spectrum(start, 2e-5, WAVELENGTH, z + 0.1, paraxial=True)
    expected = gaussian(x[None, :], x[:, None], waist, z)
    assert np.abs(found - expected).max() < 1e-10
    exact = angular_spectrum(start, 2e-5, WAVELENGTH, z + 0.1)
    assert 1e-10 < np.abs(exact - expected).max() < K * 0.4 / 8.0 * (2.0 / (K * waist)) ** 4 * 3.0
    back = angular_spectrum(exact, 2e-5, WAVELENGTH, -(z + 0.1))
    assert np.abs(back - start).max() < 1e-12


def slit(x: np.ndarray, half: float, z: float) -> np.ndarray:
    """Fresnel's amplitude behind a slit under a plane wave."""
    scale = np.sqrt(2.0 / (WAVELENGTH * z))
    s = [fresnel((x + edge) * scale) for edge in (half, -half)]
    upper, lower = (c + 1j * sine for sine, c in s)
    return (upper - lower) / (1.0 + 1j)


@pytest.mark.parametrize("half", [0.2e-3, 1.5e-3], ids=["slit", "knife-edge"])
def test_slit_and_knife_edge(half: float):
    """From Fresnel's own amplitude at 20 mm to 50 mm; a wide slit is two knife edges.

    What is left: the window's periodic neighbours, whose share falls as 1 over their distance, sqrt(lambda z) / (pi d).
    """
    count, pixel = 1 << 15, 1e-6
    x = line(count, pixel)
    taper = 0.5 * (1.0 - np.tanh((np.abs(x) - 5e-3) / 5e-4))  # nothing jumps at the window's ends
    start = slit(x, half, 20e-3) * taper
    found = angular_spectrum(start[None, :], pixel, WAVELENGTH, 30e-3, paraxial=True)[0]
    near = np.abs(x - half) < 1e-3
    expected = slit(x, half, 50e-3)
    assert np.abs(found - expected)[near].max() < 1e-4
    # At the geometric shadow's edge of a half plane the amplitude is a half.
    if half > 1e-3:
        assert np.abs(found[np.argmin(np.abs(x - half))]) == pytest.approx(0.5, abs=0.03)


def test_talbot():
    """A grating comes back after 2 p^2 / lambda, half a period aside after half of that: exact in a periodic window."""
    count, period = 240, 1e-3
    x = line(count, period / 60.0)
    grating = np.exp(1j * np.cos(2.0 * np.pi * x / period)) * (0.5 + 0.5 * (np.cos(2.0 * np.pi * x / period) > 0.3))
    distance = 2.0 * period**2 / WAVELENGTH
    again = angular_spectrum(grating[None, :], x[1] - x[0], WAVELENGTH, distance, paraxial=True)[0]
    assert np.abs(again - grating).max() < 1e-10
    aside = angular_spectrum(grating[None, :], x[1] - x[0], WAVELENGTH, 0.5 * distance, paraxial=True)[0]
    assert np.abs(aside - np.roll(grating, 30)).max() < 1e-10


def channel(gradient: float, half: float, length: float) -> IndexField:
    """A light guide, contrast -g^2 y^2 / 2: planar, which a cubic spline holds exactly but beside the box's faces."""
    y, z = np.linspace(-half, half, 81), np.linspace(0.0, length, 17)
    contrast = np.broadcast_to(-0.5 * (gradient * y[:, None]) ** 2, (81, 17))
    return IndexField.from_samples(contrast, origin=(-half, 0.0), spacing=(y[1] - y[0], z[1]), geometry="planar")


def test_beam_in_a_light_guide():
    """The mode of waist sqrt(2 / (k g)) put aside by a: its middle swings as a cos(g z), its shape stays.

    Paraxial equation; the steps' error is of second order, and the wave says how large it is.
    """
    g, a = 5.0, 2e-4
    waist, length = np.sqrt(2.0 / (K * g)), 0.2
    x = line(256, 1.25e-5)
    start = np.exp(-((x[:, None] - a) ** 2) / waist**2) * np.ones((1, 4))
    field = channel(g, 1.7e-3, length)
    light = Wave(start, 1.25e-5, WAVELENGTH)
    errors = []
    for steps in (8, 16, 32):
        found = split_step(field, light, step_count=steps, paraxial=True)
        power = found.intensity[:, 0]
        middle = float(power @ x / power.sum())
        spread = np.sqrt(4.0 * float(power @ (x - middle) ** 2) / power.sum())
        errors.append(abs(middle - a * np.cos(g * length)))
        assert spread == pytest.approx(waist, rel=2e-2)
    assert errors[2] < 2e-4 * a
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - 2.0).max() < 0.2
    # Phase and all: the mode on the axis keeps its form, and gains -g z / 2 in phase.
    mode = Wave(np.exp(-(x[:, None] ** 2) / waist**2) * np.ones((1, 4)), 1.25e-5, WAVELENGTH)
    found = split_step(field, mode, tolerance=1e-5, paraxial=True)
    expected = np.array(mode.amplitude) * np.exp(-0.5j * g * length)
    off = np.linalg.norm(found.amplitude - expected) / np.linalg.norm(expected)
    assert off < 1e-4 and found.error < 1e-5
    assert found.center[2] == pytest.approx(length)


def test_airy_at_a_fold_caustic():
    """An Airy beam of finite power: its own caustic, exact for the paraxial equation; left over is the window, 1e-6.

    Ai(s - t^2/4 + i a t) exp(a s - a t^2/2 - i t^3/12 + i a^2 t/2 + i s t/2), s = x / x_0, t = z / (k x_0^2)
    (G. A. Siviloglou, D. N. Christodoulides, Opt. Lett. 32 (2007) 979).
    """
    scale, decay = 5e-5, 0.15
    s = line(1 << 13, 1e-6 * 2.5) / scale

    def beam(t: float) -> np.ndarray:
        phase = -decay * t**2 / 2.0 - 1j * t**3 / 12.0 + 0.5j * decay**2 * t + 0.5j * s * t
        return airy(s - 0.25 * t**2 + 1j * decay * t)[0] * np.exp(decay * s + phase)

    found = angular_spectrum(beam(0.0)[None], 2.5e-6, WAVELENGTH, 3.0 * K * scale**2, paraxial=True)[0]
    expected = beam(3.0)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_single_precision_is_close_also_past_a_body():
    wall = Body([[0.5e-3, 0.4e-3], [3e-3, 0.4e-3], [3e-3, 1.6e-3], [0.5e-3, 1.6e-3]], "planar")
    past_wall = IndexField.from_samples(
        1e-4 * np.ones((21, 21)), origin=(-4e-3, 0.0), spacing=(4e-4, 1e-4), geometry="planar", body=wall
    )
    for field in (phase_plate(lambda x, y: 2e-7 * (x * x + y * y) / 4e-6, 4.4e-3), past_wall):
        expected, single = (
            split_step(field, Disc(2e-3, (0.0, 0.0, -1e-3)), wavelength=WAVELENGTH, pixel_count=64, precision=one)
            for one in ("float64", "float32")
        )
        assert 0.0 < np.abs(single.amplitude - expected.amplitude).max() < 1e-5
        assert (expected.strehl() < 0.6) == (field is past_wall)


def test_what_is_refused():
    field = phase_plate(lambda x, y: 1e-7 * x / 1e-3 + 0.0 * y, 4e-3)
    pupil = Disc(1e-3, (0.0, 0.0, -1e-3))
    with pytest.raises(TypeError, match="light must be a pupil or a Wave, got float"):
        split_step(field, 1.0)
    with pytest.raises(TypeError, match="pupil must be a Disc, Annulus"):
        validity(field, None)
    with pytest.raises(ValueError, match="the wave does not meet the field"):
        split_step(field, Disc(1e-3, (0.0, 0.0, 10.0 * DEPTH)))
    for options, message in (
        ({"pixel_count": 4}, "pixel_count must be a whole number of at least 8"),
        ({"window": 0.5}, "window must be at least 1"),
        ({"tolerance": 0.0}, "tolerance must be positive"),
        ({"step_count": 0}, "step_count must be a whole number of at least 1"),
        ({"pixel_count": 1 << 15}, "GiB: take a smaller pixel_count"),
    ):
        with pytest.raises(ValueError, match=message):
            split_step(field, pupil, **options)
    with pytest.raises(ValueError, match=r"wavelength 1e-06 is not that of the Wave, 9.05e-07: leave it out"):
        split_step(field, Wave(np.ones((8, 8)), 1e-4, WAVELENGTH), wavelength=1e-6)
    with pytest.raises(ValueError, match=r"must be finite and have two axes \[y, x\], got shape \(0, 4\)"):
        angular_spectrum(np.ones((0, 4)), 1e-4, WAVELENGTH, 1.0)
    with pytest.raises(ValueError, match="not zero everywhere"):
        Wave(np.zeros((8, 8)), 1e-5, WAVELENGTH)
    with pytest.raises(ValueError, match="limit must be positive"):
        validity(field, pupil, limit=0.0)


def test_a_far_field_has_the_same_bits_on_any_number_of_threads(tmp_path):
    """Set-up: 150 x 150 samples at 130 angles, which BLAS would share out; 1 and 3 threads.

    Expected: the same bits; within rounding the sum over all samples that they stand for.
    """
    code = (
        "import sys; import numpy as np; from aerokernels.wavefronts.point_spread import far_field\n"
        "draw = np.random.default_rng(0).normal; wave = draw(size=(150, 150)) + 1j * draw(size=(150, 150))\n"
        "x = np.linspace(-0.01, 0.01, 150); angle = np.linspace(-1e-4, 1e-4, 130)\n"
        "found = far_field(wave, (x, x), angle, 1e-6); found.tofile(sys.argv[1])\n"
        "turned = np.exp(-2j * np.pi / 1e-6 * angle[:, None] * x)\n"
        "truth = np.einsum('ay,yx,x->a', turned, wave, turned[7])\n"
        "assert np.abs(found[:, 7] - truth).max() < 1e-12 * np.abs(truth).max()"
    )
    for threads in ("1", "3"):
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        subprocess.run([sys.executable, "-c", code, str(tmp_path / threads)], env=environment, check=True, timeout=100)
    assert (tmp_path / "1").read_bytes() == (tmp_path / "3").read_bytes()


def test_a_layer_that_is_thicker_than_a_cell_misses_nothing():
    """A spike of one node among 1201, 10 cells to a layer: the mean of samples a cell apart has its path, to 2 %.

    The cubic B-spline through a spike has the spike's own integral, one cell times its height. One sample a layer is
    misses most of that.
    """
    contrast = np.zeros((4, 1201))
    contrast[:, 601] = 1e-5
    field = IndexField.from_samples(contrast, origin=(-1.0, 0.0), spacing=(2.0 / 3.0, 1e-3), geometry="planar")
    wave = Wave(np.ones((2, 2)), 1e-2, WAVELENGTH, (0.0, 0.0, 0.0))
    assert mean_layers(field, wave, 0.0, 1.2, 120)[0].sum(axis=0) == pytest.approx(1e-8, rel=0.02)
    assert np.abs(sample_layers(field, wave, 0.0, 1.2, 120).sum(axis=0) - 1e-8).min() > 5e-9


def test_a_body_is_a_shadow_and_no_air():
    """A rod over half of a slit of light; and a pupil within a rod, behind whose front its light begins.

    Samples within the rods are 1e-3, a hundred waves of their own. Amplitudes' means: half of the light, and all of it.
    """
    y, z = np.linspace(-3e-3, 3e-3, 61), np.linspace(0.0, 4e-3, 41)
    pupil = Rectangle(2e-3, 2e-3)
    for body, start, kept in (
        (([0.0, 1e-3], [3.5e-3, 2e-3]), 0.0, 0.5),
        (([-2e-3, -1e-3], [2e-3, 2e-3]), 0.05e-3, 1.0),
    ):
        (y0, z0), (y1, z1) = body
        within = (y[:, None] > y0) & (y[:, None] < y1) & (z > z0) & (z < z1)
        field = IndexField.from_samples(
            np.where(within, 1e-3, 0.0),
            origin=(y[0], z[0]),
            spacing=(y[1] - y[0], z[1] - z[0]),
            geometry="planar",
            interpolation="linear",
            body=Body([[y0, z0], [y1, z0], [y1, z1], [y0, z1]], "planar"),
        )
        light = replace(pupil, center=np.array([0.0, 0.0, start]))
        found = split_step(field, light, wavelength=905e-9, pixel_count=64, window=1.5, step_count=8)
        assert found.strehl() == pytest.approx(kept**2, abs=0.03)


@pytest.mark.parametrize("pixel_count", [24, 50])
def test_a_wave_says_what_its_strehl_ratio_may_be_off_by_through_its_pixels(pixel_count: int):
    """A thin tilt over a disc: (2 J1(v) / v)^2. Off by 2e-4 to 4e-3, while the steps are right to 2e-5."""
    phase = 2.0
    field = phase_plate(lambda x, y: phase / K * (x + 0.0 * y) / 2e-3, 4.8e-3)
    wave = split_step(field, Disc(2e-3, (0.0, 0.0, -1e-3)), wavelength=WAVELENGTH, pixel_count=pixel_count)
    off = abs(wave.strehl() - (2.0 * j1(phase) / phase) ** 2)
    assert 5.0 * wave.error < off < wave.strehl_error < 10.0 * off
