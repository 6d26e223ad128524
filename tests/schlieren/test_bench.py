"""A bench's optics: the source's edge in closed form, blur out of focus, sensor noise.

Field: a thin sheet across the light whose OPD is a sine along y, so that its deflection e_0 cos(K y) is known to first
order; greatest deflection 5 urad. Tolerances are of that signal; each test says what it leaves out.
"""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from aerokernels import Annulus, IndexField, Mask, Sensor
from aerokernels.benches import Bench, interferogram, schlieren, shadowgraph

WAVES, WIDTH, DEPTH = 4, 0.02, 2e-3
WAVE_NUMBER, GREATEST = 2.0 * math.pi * WAVES / WIDTH, 5e-6
VIEW = {"view": "z", "pixel_count": (4, 64), "extent": (-0.002, 0.002, -0.5 * WIDTH, 0.5 * WIDTH)}


def sheet() -> IndexField:
    """Waves along y, which is up in a view along z."""
    y = np.linspace(-0.8 * WIDTH, 0.8 * WIDTH, 161)
    z = np.linspace(-0.75, 0.75, 13) * DEPTH
    bell = np.where(np.abs(z) < 0.5 * DEPTH, np.cos(np.pi * z / DEPTH) ** 4, 0.0)
    path = GREATEST / WAVE_NUMBER
    contrast = path / (0.375 * DEPTH) * np.sin(WAVE_NUMBER * y)[:, None] * bell
    return IndexField.from_samples(contrast, origin=(y[0], z[0]), spacing=(y[1] - y[0], z[1] - z[0]), geometry="planar")


def volume() -> IndexField:
    """The sheet as a volume of four planes, since a bench looks through planar fields along x alone."""
    flat = sheet()
    contrast = np.repeat(np.asarray(flat.samples.samples)[None], 5, axis=0)
    spacing = (0.002, *flat.spacing)
    return IndexField.from_samples(contrast, origin=(-0.004, *flat.samples.low), spacing=spacing, geometry="volume")


def amplitude(picture: np.ndarray, vertical: np.ndarray) -> float:
    """Of cos(K y) in the rows' mean."""
    rows = picture.mean(axis=1)
    return float(2.0 * np.mean(rows * np.cos(WAVE_NUMBER * vertical)))


def test_a_slit_in_focus_is_the_sensitivity_of_its_focal_length():
    """(f / h) e: 1 m over 0.1 mm makes 5 % of 5 urad; the pixels' mean takes off 0.6 %."""
    bench = Bench(1e-4, 1.0)
    found = schlieren(volume(), knife_edge="horizontal", bench=bench, rays_per_pixel=3, **VIEW)
    plain = schlieren(volume(), knife_edge="horizontal", sensitivity=1e4, rays_per_pixel=3, **VIEW)
    assert found.sensitivity == pytest.approx(1e4)
    assert amplitude(found.intensity, found.vertical) == pytest.approx(0.05, rel=0.02)
    assert np.abs(found.intensity - plain.intensity)[2:-2].max() < 2e-3


@pytest.mark.parametrize("focus", [0.0, 0.3, -0.3])
def test_a_wide_source_blurs_what_is_out_of_focus(focus: float):
    """The edge stands at 45 degrees; of 3 x 3 points those on its line see 3 e_cut / angle, those beyond it all pass.

    The sheet lies by `focus` before the plane in focus: a point whose light climbs by the angle u sees there the waves
    of the place y - focus u, and light is gathered by 1 - focus de/dy. First order in the deflection, 1e-3 of it.
    """
    count, angle, slant = 3, 4e-3, 0.25 * math.pi
    bench = Bench(angle, 1.0, source="square", source_points=count, focus=focus)
    found = schlieren(volume(), knife_edge=slant, bench=bench, rays_per_pixel=3, **VIEW)
    y, expected = found.vertical, 0.0
    for across in (-angle / 3.0, 0.0, angle / 3.0):
        for along in (-angle / 3.0, 0.0, angle / 3.0):
            place = WAVE_NUMBER * (y - focus * (across * math.sin(slant) + along * math.cos(slant)))
            e, slope = GREATEST * np.cos(place), -GREATEST * WAVE_NUMBER * np.sin(place)
            passed = 0.5 + 3.0 * e * math.sin(slant) / angle if across == 0.0 else float(across > 0.0)
            expected = expected + passed * (1.0 - focus * slope) / 9.0
    middle = slice(8, -8)
    assert np.abs(found.intensity.mean(axis=1) - expected)[middle].max() < 0.03 * np.ptp(expected)


def test_an_annulus_passes_its_circles_segments():
    """The outer circle's segment less the inner one's, in closed form; a mask passes the sum of its columns."""

    def segment(x, radius):
        part = np.clip(x / radius, -1.0, 1.0)
        return radius**2 * (0.5 * np.pi + np.arcsin(part) + part * np.sqrt(1.0 - part**2))

    ring = Bench(None, 1.0, source=Annulus(1e-3, 6e-4))
    assert ring.angle == 2e-3 == Bench(2e-3, 1.0, source=Annulus(5.0, 3.0)).angle
    deflection = np.random.default_rng(1).normal(0.0, 6e-4, 300)
    for cut_off in (0.1, 0.5, 0.83):
        edge = ring.edge(cut_off)
        below = segment(edge - deflection, 1e-3) - segment(edge - deflection, 6e-4)
        expected = 1.0 - below / (np.pi * (1e-6 - 36e-8))
        assert float(ring.held_back(np.asarray(edge))) == pytest.approx(cut_off, abs=1e-12)
        np.testing.assert_allclose(ring.passed(np.zeros(2), deflection, cut_off), expected, atol=1e-9)
        parts = Bench(None, 1.0, source=ring.source, source_points=7)
        each = [parts.passed(point, deflection, cut_off) for point in parts.points()[0]]
        np.testing.assert_allclose(parts.points()[1] @ np.array(each), expected, atol=1e-9)
    points, shares = Bench(None, 1.0, source=ring.source, source_points=32).points()
    assert (shares * points[:, 1] ** 2).sum() == pytest.approx(0.25 * 1.36e-6, rel=0.01)
    # Columns of light 1, 0, 4 and 1, of 0.5 mrad each: amplitudes are roots of it. Half of it is in the third one.
    mask = Bench(None, 2.0, source=Mask(np.array([[1.0, 0.0, 2.0, 1.0], [1.0, 0.0, 2.0, 1.0]]), 1e-3))
    assert mask.angle == 2e-3 and mask.edge(0.5) == pytest.approx(0.25e-3)
    passed = mask.passed(np.zeros(2), np.array([-1.0, -5e-4, 0.0, 1e-4, 5e-4, 1.0]), 0.5)
    np.testing.assert_allclose(passed, [0.0, 1.0 / 12.0, 0.5, 3.8 / 6.0, 5.0 / 6.0, 1.0], atol=1e-12)
    with pytest.raises(ValueError, match="source"):
        Bench(1e-3, 1.0, source="ring")
    with pytest.raises(ValueError, match="source_size"):
        Bench(None, 1.0)


@pytest.mark.parametrize("distance", [0.3, -0.3])
def test_a_shadow_is_folded_with_the_shape_of_its_source(distance: float):
    """Waves fade by the shape's Fourier transform: of an annulus Bessel functions, of half a square also a shift.

    First order in the deflection (1e-3 of the signal) and the pixels' own width (64 over four waves, 0.6 %).
    """
    from scipy.special import j1

    angle = 0.5 * WIDTH / WAVES / abs(distance)
    still = shadowgraph(volume(), distance=distance, **VIEW)
    reference = still.irradiance.mean(axis=1) - 1.0
    phase = np.exp(-1j * WAVE_NUMBER * still.vertical)
    lit = np.array([[0.0], [1.0]])  # the upper half of a square
    for source, expected in (
        (Annulus(1.0, 0.5), None),
        (Mask(lit, 1.0), np.sinc(0.25) * np.exp(-0.25j * np.pi * np.sign(distance))),
    ):
        bench = Bench(angle if expected is None else 0.5 * angle, 1.0, source=source)
        if expected is None:
            k = 0.5 * WAVE_NUMBER * abs(distance) * angle
            expected = (2.0 * j1(k) / k - 0.25 * 4.0 * j1(0.5 * k) / k) / 0.75
        found = shadowgraph(volume(), distance=distance, bench=bench, **VIEW).irradiance.mean(axis=1) - 1.0
        middle = slice(16, 48)
        ratio = (found[middle] @ phase[middle]) / (reference[middle] @ phase[middle])
        assert ratio == pytest.approx(expected, abs=0.02), source


def test_noise_and_the_other_benches():
    """The sensor's noise is there; interferograms of an extended source keep their contrast in focus alone."""
    noisy = Bench(1e-4, 1.0, sensor=Sensor(full_well=1000.0, bits=8, exposure=1.0), seed=1)
    still = schlieren(volume(), knife_edge="horizontal", bench=noisy, **VIEW)
    assert 0.005 < still.intensity.std() < 0.1
    assert np.abs(still.intensity * 255 - np.rint(still.intensity * 255)).max() < 1e-9
    assert "intensity: 64 x 4, 0.39" in repr(still)
    drawn = still.plot(Figure().subplots()).images[0]
    assert drawn.get_extent() == pytest.approx([-2.0, 2.0, -10.0, 10.0])
    assert shadowgraph(volume(), distance=0.1, bench=noisy, **VIEW).source_angle == pytest.approx(1e-4)
    # A sensor that undisturbed light fills to a tenth holds ten times as much, whatever is white in a picture.
    dim = Bench(1e-4, 1.0, sensor=Sensor(read_noise=0.0, bits=16, exposure=0.1, shot_noise=False))
    bright = shadowgraph(volume(), distance=0.1, exposure=3.0, bench=dim, **VIEW)
    np.testing.assert_allclose(bright.intensity, 0.3 * bright.irradiance, atol=1e-5)
    even = {"phase": 0.0, "exposure": 3.0, "bench": dim, **VIEW}
    assert interferogram(volume(), **even).intensity.max() == pytest.approx(0.3, abs=1e-3)
    assert schlieren(volume(), cut_off=0.0, exposure=3.0, bench=dim, **VIEW).intensity.max() > 0.29
    # Of an OPD of 4 nm, 0.03 radian in quadrature: focused, all points agree; 1 m away, 8 mrad blur it over 1.6 waves.
    fringes = {"phase": 0.25, "wavelength": 800e-9, **VIEW}
    sharp, soft = (
        interferogram(
            volume(), bench=Bench(8e-3, 1.0, source="square", source_points=3, focus=focus), **fringes
        ).intensity.std()
        for focus in (0.0, 1.0)
    )
    assert sharp == pytest.approx(math.pi * GREATEST / WAVE_NUMBER / 800e-9 / math.sqrt(2.0), rel=0.03)
    assert soft < 0.4 * sharp
    with pytest.raises(ValueError, match="source_points"):
        Bench(1e-3, 1.0, source_points=0)
    with pytest.raises(ValueError, match="leave it out"):
        schlieren(volume(), sensitivity=1.0, bench=noisy, **VIEW)
