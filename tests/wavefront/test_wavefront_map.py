"""Wavefronts over pupils: closed forms of what they make of the light, and traced ones."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import j0, j1, jn_zeros

from aerokernels import Annulus, Disc, Mask, Polygon, Rectangle, Wavefront, wavefront
from aerokernels.wavefronts.pixels import pupil_grid
from tests.phase_plates import RADIUS, WAVELENGTH, modes, phase_plate

RESOLUTION = WAVELENGTH / (2.0 * RADIUS)
BEHIND = (0.0, 0.0, -1e-3)


def made(pupil, opd=lambda x, y: 0.0 * x, count: int = 128, error: float = 0.0) -> Wavefront:
    """A wavefront without a trace, of any OPD(x, y) [m]."""
    coordinate, pixel, weight, intensity = pupil_grid(pupil, count)
    x, y = np.meshgrid(coordinate, coordinate)
    return Wavefront(
        opd(x, y),
        weight,
        pixel,
        WAVELENGTH,
        intensity=intensity,
        radius=pupil.reach,
        pupil=pupil,
        budget=lambda: {"total": error},
    )


# --- closed forms ----------------------------------------------------------------------------------------------------


def test_airy_pattern_of_disc_and_annulus():
    """(2 J1(v) / v)^2, and (A(v) - e^2 A(e v))^2 / (1 - e^2)^2 with A = 2 J1(v) / v; edge pixels: 3e-4 at N = 128."""
    angle = np.linspace(-4.0, 4.0, 33) * RESOLUTION
    v = np.pi * np.hypot(angle[:, None], angle) / RESOLUTION
    safe = np.where(v == 0.0, 1.0, v)

    def airy(scale):
        return np.where(v == 0.0, 1.0, 2.0 * j1(scale * safe) / (scale * safe))

    disc = made(Disc(RADIUS)).psf(angle)
    assert np.abs(disc.intensity - airy(1.0) ** 2).max() < 3e-4
    ring = made(Annulus(RADIUS, 0.4 * RADIUS)).psf(angle)
    assert np.abs(ring.intensity - ((airy(1.0) - 0.16 * airy(0.4)) / 0.84) ** 2).max() < 6e-4


def test_parts_of_the_transform_are_the_whole():
    """The FFT, its middle by matrices, and given angles: the same to rounding."""
    wave = made(Disc(RADIUS), modes({2: 1e-7, 5: 5e-8, 8: 4e-8}), count=32)
    whole, middle = wave.psf(padding=4), wave.psf(padding=4, half_width=3.0 * RESOLUTION)
    shown = np.abs(whole.angle) <= 3.0 * RESOLUTION
    assert np.abs(whole.intensity[np.ix_(shown, shown)] - middle.intensity).max() < 1e-12
    assert np.abs(wave.psf(middle.angle).intensity - middle.intensity).max() < 1e-12


def test_mtf_of_a_circle_and_its_cut_off():
    """2 / pi (acos s - s sqrt(1 - s^2)) with s over the cut-off D / lambda; edge pixels: 1e-3 at N = 128."""
    mtf = made(Disc(RADIUS)).mtf()
    for angle, allowed in ((0.0, 1e-3), (0.5 * np.pi, 1e-3), (np.pi / 3.0, 3e-3)):  # interpolated at the cusp of f = 0
        frequency, value = mtf.along(angle)
        s = np.clip(frequency * RESOLUTION, 0.0, 1.0)
        assert np.abs(value - 2.0 / np.pi * (np.arccos(s) - s * np.sqrt(1.0 - s * s))).max() < allowed
    assert mtf.value[mtf.value.shape[0] // 2, mtf.value.shape[1] // 2] == 1.0
    assert np.abs(mtf.frequency[-1] * RESOLUTION - 1.0) < 0.01


def test_otf_is_the_transform_of_the_psf():
    """Sum over one period of the PSF of exp(-2 pi i f a), exact for the pixels; tilt turns its phase by -2 pi f a0."""
    wave = made(Rectangle(2 * RADIUS, RADIUS), modes({2: 1.3e-7, 3: -4e-8, 7: 6e-8}), count=16)
    otf = wave.otf()
    spread = wave.psf(padding=2)
    turn = np.exp(-2j * np.pi * np.outer(otf.frequency, spread.angle))
    transformed = turn @ spread.intensity @ turn.T
    transformed /= spread.intensity.sum()
    assert np.abs(transformed - otf.value).max() < 1e-12
    tilted = made(Disc(RADIUS), lambda x, y: 3e-4 * x - 1e-4 * y, count=16).otf()
    fx, fy = np.meshgrid(tilted.frequency, tilted.frequency)
    expected = tilted.perfect * np.exp(-2j * np.pi * (3e-4 * fx - 1e-4 * fy))
    assert np.abs(tilted.value - expected).max() < 1e-12


def test_encircled_energy_of_a_circle():
    """1 - J0(v)^2 - J1(v)^2 (Rayleigh), 83.8 % in the first dark ring; edge pixels: 1e-4 at N = 128."""
    angle = np.array([0.3, 0.7, float(jn_zeros(1, 1)[0]) / np.pi, 2.5, 6.0]) * RESOLUTION
    v = np.pi * angle / RESOLUTION
    wave = made(Disc(RADIUS))
    assert np.abs(wave.encircled_energy(angle).energy - (1.0 - j0(v) ** 2 - j1(v) ** 2)).max() < 3e-4
    assert wave.encircled_energy(0.0).energy == 0.0
    fine = wave.encircled_energy(np.linspace(0.0, 2.0, 101) * RESOLUTION)
    assert fine.radius(1.0 - j0(0.5 * np.pi) ** 2 - j1(0.5 * np.pi) ** 2) / RESOLUTION == pytest.approx(0.5, abs=1e-3)
    assert np.isnan(fine.radius(0.99))
    # About the centroid of a tilted beam it is the same; about the axis it is not.
    tilted = made(Disc(RADIUS), lambda x, y: 2.0 * RESOLUTION * x)
    assert np.abs(np.asarray(tilted.encircled_energy(angle)) - np.asarray(wave.encircled_energy(angle))).max() < 1e-9
    assert float(tilted.encircled_energy(angle[0], center=(0.0, 0.0))) < 0.05


def test_encircled_energy_ends_at_all_light():
    """Through the edge of what 16 pixels hold, 8 wavelengths over the width, and far beyond: it grows to 1."""
    wave = made(Disc(RADIUS), lambda x, y: 3e-4 * x + 1e-4 * x * y, count=16)
    energy = wave.encircled_energy(np.array([7.9, 7.99, 8.01, 8.1, 9.0, 11.3, 11.4, 40.0]) * RESOLUTION).energy
    assert (np.diff(energy) >= 0.0).all() and energy[2] - energy[1] < 1e-3
    assert 0.98 < energy[0] and energy[-2] == energy[-1] == 1.0
    single = Wavefront(np.zeros((1, 1)), np.ones((1, 1)), 1e-3, wave.wavelength)
    with pytest.raises(ValueError, match="no pixel has a neighbour"):
        single.encircled_energy(1e-4)


def test_width_of_airys_disc():
    """FWHM 1.02899 lambda / D; tilt does not change it; a Gaussian of w has sqrt(2 ln 2) lambda / (pi w)."""
    assert made(Disc(RADIUS)).fwhm / RESOLUTION == pytest.approx(1.02899, rel=3e-3)
    assert made(Disc(RADIUS), lambda x, y: 5.3 * RESOLUTION * y).fwhm / RESOLUTION == pytest.approx(1.02899, rel=3e-3)
    waist = RADIUS / 4.0
    axis = RADIUS * (np.arange(96) - 47.5) / 48
    beam = Mask(np.exp(-(axis[:, None] ** 2 + axis**2) / waist**2), RADIUS / 48)
    found = made(beam, count=96).fwhm
    assert found == pytest.approx(np.sqrt(2.0 * np.log(2.0)) * WAVELENGTH / (np.pi * waist), rel=1e-3)


def test_strehl_ratio_of_pure_focus():
    """W = b r^2: S = (sin(k b / 2) / (k b / 2))^2; midpoints: 2e-4 at N = 128."""
    for waves in (0.25, 0.5, 0.8):
        found = made(Disc(RADIUS), lambda x, y, b=waves: b * WAVELENGTH * (x * x + y * y) / RADIUS**2)
        assert found.strehl() == pytest.approx(np.sinc(waves) ** 2, abs=3e-4)
        assert found.remove("focus", "piston").strehl() == pytest.approx(1.0, abs=1e-12)
        assert found.rms == pytest.approx(waves * WAVELENGTH / np.sqrt(12.0), rel=1e-3)
        assert found.peak_to_valley == pytest.approx(waves * WAVELENGTH, rel=0.03)


coefficients = st.lists(st.floats(-1e-7, 1e-7), min_size=15, max_size=15)


@given(values=coefficients, shape=st.sampled_from([Disc(RADIUS), Annulus(RADIUS, 0.5 * RADIUS)]))
@settings(max_examples=20, deadline=None)
def test_zernike_coefficients_come_back(values, shape):
    """A sum of 15 modes is fitted exactly on any round pupil; piston, tilt and focus removed are modes 1 to 4."""
    wave = made(shape, modes(dict(enumerate(values, start=1))), count=40)
    assert np.abs(wave.zernike(15) - values).max() < 1e-10 * 1e-7 + 1e-20
    assert np.abs(wave.without_zernike(1, 2, 3, 4).zernike(4)).max() < 1e-17
    assert np.abs(wave.without_zernike(*range(1, 16)).samples[0]).max() < 1e-17
    assert wave.remove("piston", "tilt", "focus").removed == ("piston", "tilt", "focus")


@given(a=st.floats(-1e-4, 1e-4), b=st.floats(-1e-4, 1e-4), c=st.floats(-1e-6, 1e-6), d=st.floats(-0.1, 0.1))
@settings(max_examples=20, deadline=None)
def test_terms_are_removed_from_any_pupil(a, b, c, d):
    """Piston c, slopes a, b and focus d of a lopsided polygon leave nothing; the Strehl ratio is then 1."""
    pupil = Polygon(1e-3 * np.array([[-1.0, -1.5], [2.0, -0.5], [0.5, 1.5]]))
    wave = made(pupil, lambda x, y: c + a * x + b * y + d * (x * x + y * y), count=24)
    rest = wave.remove("piston", "tilt", "focus")
    assert rest.rms < 1e-19 + 1e-12 * wave.rms
    assert rest.strehl() == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(ValueError, match="choose from piston, tilt, focus"):
        wave.remove("coma")


def test_centroid_is_the_mean_slope():
    """Tilt moves the centroid and the peak by itself; coma c sqrt(8) (3 r^2 - 2) x moves the centroid by <dW/dx>.

    <dW/dx> over the disc is sqrt(8) (9 x^2 + 3 y^2 - 2) c / R averaged, sqrt(8) c / R.
    """
    tilted = made(Disc(RADIUS), lambda x, y: 2e-4 * x - 1e-4 * y)
    assert tilted.centroid == pytest.approx([2e-4, -1e-4], rel=1e-9)
    assert tilted.tilt == pytest.approx([2e-4, -1e-4], rel=1e-9)
    coma = made(Disc(RADIUS), modes({8: 3e-8}))
    assert coma.centroid[0] == pytest.approx(np.sqrt(8.0) * 3e-8 / RADIUS, rel=0.02)
    assert abs(coma.centroid[1]) < 1e-12


def test_structure_function_of_a_tilt_and_of_noise():
    """Tilt a on a square: D(r) = a^2 <dx^2>, a^2 r^2 / 2 about all directions; white noise of rms s: 2 s^2."""
    tilted = made(Disc(RADIUS), lambda x, y: 1e-4 * x, count=32).structure_function()
    near = (tilted.separation > 0.0) & (tilted.separation < 0.5 * RADIUS)
    assert (tilted.value[near] / tilted.separation[near] ** 2) == pytest.approx(0.5e-8, rel=0.25)
    rng = np.random.default_rng(7)
    noise = made(Rectangle(2 * RADIUS, 2 * RADIUS), lambda x, y: 1e-8 * rng.normal(size=x.shape), count=96)
    found = noise.structure_function()
    assert found.value[0] < 1e-26 and found.pair_weight.sum() == pytest.approx(1.0)
    assert found.value[1:60] == pytest.approx(2e-16, rel=0.1)
    # By hand: every pair of pixels of a small map.
    small = made(Disc(RADIUS), modes({5: 1e-7, 2: 3e-8}), count=6)
    opd, weight = small.opd[small.lit], small.weight[small.lit]
    distance = np.linalg.norm(small.points[:, None] - small.points, axis=2) / small.pixel
    pairs = weight[:, None] * weight
    found = small.structure_function()
    for ring, value in enumerate(found.value):
        chosen = np.rint(distance) == ring
        assert value == pytest.approx(np.average((opd[:, None] - opd)[chosen] ** 2, weights=pairs[chosen]), abs=1e-24)


def test_light_of_several_wavelengths():
    """Perfect peaks of a share w of the light go with w / l^2; without aberrations the peak of all the light is 1.

    A constant OPD gradient puts the peaks of all wavelengths at its own angle: set-up exact, so is the result.
    """
    wave, lengths, shares = made(Disc(RADIUS), modes({4: 5e-8}), count=32), np.array([500e-9, 1e-6]), [3.0, 1.0]
    angle = RESOLUTION * np.linspace(-2.0, 2.0, 9)
    found = wave.psf(angle, wavelengths=lengths, weights=shares)
    each = [wave.at_wavelength(length).psf(angle).intensity for length in lengths]
    part = np.array(shares) / lengths**2
    assert np.abs(found.intensity - (part[0] * each[0] + part[1] * each[1]) / part.sum()).max() < 1e-14
    tilted = made(Disc(RADIUS), lambda x, y: 2.0 * RESOLUTION * x, count=32)
    seen = tilted.psf(wavelengths=lengths, padding=4)
    place = np.unravel_index(int(np.argmax(seen.intensity)), seen.intensity.shape)
    assert 0.95 < seen.peak < 1.0  # the angles stand as far apart as a quarter of the shorter wavelength's resolution
    assert seen.angle[[place[1], place[0]]] == pytest.approx([2.0 * RESOLUTION, 0.0], abs=0.2 * RESOLUTION)
    for options, message in (
        ({"weights": [1.0]}, "give both"),
        ({"wavelengths": [5e-7], "weights": [1.0, 2.0]}, "one for each wavelength"),
        ({"wavelengths": [5e-7], "weights": [-1.0]}, "not negative"),
        ({"wavelengths": [0.5]}, "outside 0.1 to 24 um"),
    ):
        with pytest.raises(ValueError, match=message):
            wave.psf(**options)


def numbers_of(wave, errors: bool) -> list[np.ndarray]:
    """Numbers of a wavefront by kind, or their errors."""
    angle = np.linspace(-3.0, 3.0, 13) * RESOLUTION
    image, spread, mtf, energy = wave.image_quantities(), wave.psf(angle), wave.mtf(), wave.encircled_energy(angle[7:])
    rows = slice(20, 75, 6)
    told = [
        [wave.quantities[name] for name in ("strehl", "opd_rms", "tilt_x", "tilt_y")],
        [image[name] for name in ("centroid_x", "centroid_y", "fwhm")],
    ]
    arrays = (
        (wave.zernike_errors(15), spread.error, mtf.error[rows, rows], energy.error)
        if errors
        else (wave.zernike(15), spread.intensity, mtf.value[rows, rows], energy.energy)
    )
    return [np.array([one.error if errors else one.value for one in each]) for each in told] + [*arrays]


def test_errors_cover_smooth_errors_of_the_opd():
    """An OPD off by waves of a tenth of the radius or longer, of rms e / 2: at least 93 of 100 numbers are covered.

    Expected: errors of one to ten times what the numbers of each kind are off by, in the median.
    """
    base, error = modes({4: 5e-8, 5: 3e-8, 8: 4e-8}), 4e-9
    rng = np.random.default_rng(3)
    wave = made(Disc(RADIUS), base, count=48, error=error)
    told, right = numbers_of(wave, True), numbers_of(wave, False)
    ratios: list[list[np.ndarray]] = [[] for _ in told]
    for size in (1.0, 0.5, 0.2, 0.1) * 2:
        way, phase = rng.normal(0.0, 1.0 / (size * RADIUS), (2, 20)), rng.uniform(0.0, 7.0, 20)

        def wrong(x, y, way=way, phase=phase):
            flat = np.cos(np.multiply.outer(x, way[0]) + np.multiply.outer(y, way[1]) + phase).sum(axis=-1)
            return base(x, y) + 0.5 * error * (flat - flat.mean()) / flat.std()

        other = numbers_of(made(Disc(RADIUS), wrong, count=48), False)
        for kept, one, exact, own in zip(ratios, told, right, other, strict=True):
            kept.append(np.ravel(one / np.maximum(np.abs(own - exact), 1e-30)))
    for kept in map(np.concatenate, ratios):
        assert np.mean(kept >= 1.0) >= 0.9 and 1.0 < np.median(kept) < 10.0
    assert np.mean(np.concatenate([one for kept in ratios for one in kept]) >= 1.0) >= 0.93


# --- traced ----------------------------------------------------------------------------------------------------------


def test_a_wavefront_and_what_it_makes_can_be_pickled():
    """There and back with its error budget, which is measured where it is asked for."""
    found = wavefront(phase_plate(modes({4: 5e-8}), 4e-3), Disc(1e-3, BEHIND), wavelength=WAVELENGTH, pixel_count=16)
    back = pickle.loads(pickle.dumps(found))
    assert back.strehl() == found.strehl() and back.opd_error == found.opd_error > 0.0
    spread = pickle.loads(pickle.dumps(found.psf([0.0])))
    assert spread.intensity == found.psf([0.0]).intensity and spread.error > 0.0
    assert pickle.loads(pickle.dumps(found.mtf())).error.max() > 0.0


def test_what_is_refused():
    field = phase_plate(modes({4: 5e-8}), 4e-3)
    with pytest.raises(TypeError, match="pupil must be a Disc, Annulus, Rectangle, Polygon or Mask, got float"):
        wavefront(field, 1e-3)
    with pytest.raises(TypeError, match="field must be an IndexField"):
        wavefront(1.0, Disc(1e-3))
    with pytest.raises(ValueError, match="pixel_count must be a whole number of at least 2, got 1"):
        wavefront(field, Disc(1e-3, BEHIND), pixel_count=1)
    with pytest.raises(ValueError, match=r"pixel_count = 10000000 .* memory holds \d+ at most: take a smaller one"):
        wavefront(field, Disc(1e-3, BEHIND), pixel_count=10_000_000)
    with pytest.raises(ValueError, match="opd and weight must be square and have the same shape"):
        Wavefront(np.zeros((2, 3)), np.ones((2, 3)), 1.0, WAVELENGTH)
    with pytest.raises(ValueError, match="finite in the pupil, got 1 bad samples"):
        Wavefront(np.array([[np.nan, 0.0], [0.0, 0.0]]), np.ones((2, 2)), 1.0, WAVELENGTH)
    with pytest.raises(ValueError, match="the pupil's 4 samples cannot distinguish"):
        Wavefront(np.zeros((2, 2)), np.ones((2, 2)), 1.0, WAVELENGTH).zernike(10)
    flat = Wavefront(np.zeros((4, 4)), np.ones((4, 4)), 1.0, WAVELENGTH)
    with pytest.raises(ValueError, match="angle must be finite and at least 0 rad"):
        flat.encircled_energy([-1e-7])
    with pytest.raises(ValueError, match="center must be two angles"):
        flat.encircled_energy(1e-7, center=0.0)
