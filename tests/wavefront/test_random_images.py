"""Random maps of few pixels tell how far off their images are: against maps of the same pupil many times as fine.

Errors of single angles and frequencies are near zero by chance where two amplitudes cancel: what is reported must not
be.
"""

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Polygon, Rectangle, Wavefront
from aerokernels.wavefront.grid import pupil_grid
from aerokernels.wavefront.image_errors import sensitivity_errors

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
    assert np.max(found) < 2.0 and np.mean(np.max(found, axis=1) <= 1.0) >= 0.9
    assert np.median(told) < 12.0


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
    assert np.max(found) < 2.0 and np.mean(np.concatenate(found) <= 1.0) > 0.995


@pytest.mark.parametrize("fried", [0.25 * RADIUS, RADIUS])
def test_a_sensitivity_holds_an_atmosphere_within_the_spacing_of_its_frequencies(fried):
    """Pixels of 6 mm, r0 of 12 and 50 mm, ripples: factors of up to 13 too small in a quarter of the maps.

    The atmosphere was read at the frequencies alone, and no part of the error held their spacing.
    """
    found = []
    for seed in range(4):
        for coarse, fine in pairs(16, 5, seed, ripples=8):
            found.append(abs(coarse.pssn(fried) - fine.pssn(fried)) / sensitivity_errors(coarse, fried))
    assert np.max(found) < 1.2 and np.mean(np.array(found) <= 1.0) >= 0.9 and np.median(found) > 0.1
    told = coarse.image_quantities(fried)["pssn"]
    assert told.value == coarse.pssn(fried) and told.error == sensitivity_errors(coarse, fried)


def test_shares_about_the_centroid_hold_the_error_of_the_centroid():
    """Ripples of a few pixels, whose mean slope the pixels do not hold: the circle of the finer map is elsewhere."""
    found = []
    angle = np.linspace(0.5, 5.0, 10) * WAVELENGTH / (2.0 * RADIUS)
    for seed in range(4):
        for coarse, fine in pairs(9, 9, seed, ripples=12):
            seen = coarse.encircled_energy(angle)
            found.append(ratios(np.abs(seen.energy - fine.encircled_energy(angle).energy), seen.error))
    assert np.mean(np.max(found, axis=1) <= 1.0) > 0.9
    about = coarse.encircled_energy(angle, center=coarse.centroid)
    assert (about.error <= seen.error).all() and (about.error < seen.error).any()
