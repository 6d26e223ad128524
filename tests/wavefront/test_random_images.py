"""Random maps of few pixels tell how far off their images are: against maps of the same pupil many times as fine."""

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Polygon, Rectangle, Wavefront
from aerokernels.wavefronts.pixels import pupil_grid

WAVELENGTH, RADIUS = 1e-6, 0.05
TRIANGLE = Polygon(RADIUS * np.array([[-1.0, -0.6], [0.9, -0.5], [0.1, 1.0]]))
PUPILS = (Disc(RADIUS), Annulus(RADIUS, 0.5 * RADIUS), Rectangle(1.9 * RADIUS, 1.2 * RADIUS), TRIANGLE)


def pairs(count, times, seed, ripples=0):
    """Yield wavefronts of 0.01 to 0.3 waves on `count` pixels, with exact OPD, and the same on many times as many.

    The surfaces are polynomials of degree 5, or sums of so many waves of up to six periods over the pupil.
    """
    draw = np.random.default_rng(seed)
    for pupil in PUPILS:
        terms = np.triu(draw.normal(size=(6, 6)))[:, ::-1]
        terms[0, 0] = 0.0
        waves = draw.normal(size=(ripples, 4))
        size = 10.0 ** draw.uniform(-2.0, -0.5)
        maps = []
        for fine in (1, times):
            coordinate, pixel, weight, intensity = pupil_grid(pupil, fine * count)
            x, y = (one / RADIUS for one in np.meshgrid(coordinate, coordinate))
            opd = np.polynomial.polynomial.polyval2d(x, y, terms)
            if ripples:
                opd = sum(a * np.cos(6.0 * (b * x + c * y) + 9.0 * d) for a, b, c, d in waves) / np.sqrt(ripples)
            given = {"intensity": intensity, "pupil": pupil, "radius": RADIUS, "budget": lambda: {"total": 0.0}}
            maps.append(Wavefront(size * WAVELENGTH * opd, weight, pixel, WAVELENGTH, **given))
        yield maps


def ratios(off, error, least=2e-5):
    """The error over the reported error, 0 where it is less than `least`."""
    return np.where(np.asarray(off) > least, off / np.maximum(error, 1e-30), 0.0).ravel()


def test_intensities_between_lobes_tell_what_folds_into_them():
    """Eight pixels, up to half of a period: factors of 5 to 80 too small where the folded lobes have a zero."""
    angle = np.linspace(-4.0, 4.0, 25) * WAVELENGTH / (2.0 * RADIUS)
    found, told = [], []
    for seed in range(6):
        for coarse, fine in pairs(8, 15, seed):
            seen, right = coarse.psf(angle), fine.psf(angle)
            found.append(ratios(np.abs(seen.intensity - right.intensity), seen.error))
            told.append(np.linalg.norm(seen.error) / np.linalg.norm(seen.intensity - right.intensity))
    assert np.mean(np.concatenate(found) <= 1.0) >= 0.95 and np.median(told) < 12.0


def test_frequencies_at_which_few_pixels_overlap_tell_their_error():
    """Factors of up to 5 too small, in one map of six, where four grids of a pixel or two agree by chance."""
    found = []
    for seed in range(6):
        for coarse, fine in pairs(9, 9, seed):
            seen, right = coarse.otf(), fine.otf()
            middle, last = len(right.frequency) // 2, len(seen.frequency) // 2
            there = middle + 9 * np.arange(-last, last + 1)
            off = np.abs(seen.value - right.value[np.ix_(there, there)])
            found.append(ratios(off, seen.error))
    assert np.mean(np.concatenate(found) <= 1.0) > 0.98


def test_shares_about_the_centroid_hold_the_error_of_the_centroid():
    """Ripples of a few pixels, whose mean slope the pixels do not hold: the circle of the finer map is elsewhere."""
    found = []
    angle = np.linspace(0.5, 5.0, 10) * WAVELENGTH / (2.0 * RADIUS)
    for seed in range(4):
        for coarse, fine in pairs(9, 9, seed, ripples=12):
            seen = coarse.encircled_energy(angle)
            found.append(ratios(np.abs(seen.energy - fine.encircled_energy(angle).energy), seen.error))
    assert np.mean(np.concatenate(found) <= 1.0) > 0.9
    about = coarse.encircled_energy(angle, center=coarse.centroid)
    assert (about.error != seen.error).any()


def test_a_phase_that_advances_by_a_period_from_pixel_to_pixel_is_told():
    """A square pupil with focus, OPD = c x^2: at the shift s its OTF is the overlap times sinc(2 c s overlap / lambda).

    At the shift of five pixels the phase difference advances by a period from pixel to pixel: the samples look like a
    flat wavefront's, on every other pixel too. The told error was a twentieth of what the OTF is off by.
    """
    count = 16
    square = Rectangle(2.0 * RADIUS, 2.0 * RADIUS)
    coordinate, pixel, weight, intensity = pupil_grid(square, count)
    c = WAVELENGTH / (2.0 * 5.0 * pixel**2)
    opd = np.broadcast_to(c * coordinate**2, (count, count))
    seen = Wavefront(
        opd, weight, pixel, WAVELENGTH, intensity=intensity, pupil=square, budget=lambda: {"total": 0.0}
    ).otf()
    shift = np.arange(1 - count, count)
    share = 1.0 - np.abs(shift) / count
    along = share * np.sinc(2.0 * c * shift * pixel * share * 2.0 * RADIUS / WAVELENGTH)
    off = np.abs(seen.value - share[:, None] * along)
    assert off[count - 1, count - 1 + 5] > 0.6
    # The last shifts, of a few pixels' overlap, advance by a period from part to part of a pixel too.
    near = slice(3, 2 * count - 4)
    assert np.mean(ratios(off[:, near], seen.error[:, near]) <= 1.0) > 0.95
    assert np.linalg.norm(off) < np.linalg.norm(seen.error) < 4.0 * np.linalg.norm(off)


@pytest.mark.parametrize("count", [10, 12, 13])
@pytest.mark.parametrize("shape", ["rectangle", "annulus"])
def test_intensities_of_flat_wavefronts_tell_what_the_edges_of_their_pixels_make(shape, count):
    """Sinc and Bessel functions at angles up to half a period: told errors were down to a quarter of what was off."""
    from scipy.special import j1

    angle = np.linspace(-0.5, 0.5, 31) * count * WAVELENGTH / (2.0 * RADIUS)
    if shape == "rectangle":
        pupil = Rectangle(1.91 * RADIUS, 0.83 * RADIUS)
        across, up = (np.sinc(side * RADIUS * angle / WAVELENGTH) ** 2 for side in (1.91, 0.83))
        exact = up[:, None] * across
    else:
        pupil, hole = Annulus(RADIUS, 0.6 * RADIUS), 0.6
        x = 2.0 * np.pi * RADIUS / WAVELENGTH * np.hypot(angle[:, None], angle) + 1e-9
        exact = ((2.0 * j1(x) / x - hole * 2.0 * j1(hole * x) / x) / (1.0 - hole**2)) ** 2
    _, pixel, weight, intensity = pupil_grid(pupil, count)
    flat = Wavefront(
        np.zeros(weight.shape),
        weight,
        pixel,
        WAVELENGTH,
        intensity=intensity,
        pupil=pupil,
        budget=lambda: {"total": 0.0},
    )
    seen = flat.psf(angle)
    assert np.mean(ratios(np.abs(seen.intensity - exact), seen.error) <= 1.0) > 0.95
    assert np.linalg.norm(seen.error) < 12.0 * np.linalg.norm(seen.intensity - exact)
