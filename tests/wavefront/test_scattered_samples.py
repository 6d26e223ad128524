"""`Wavefront.from_samples`: maps of samples scattered over a pupil."""

import pickle

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Polygon, Wavefront
from aerokernels.rays import RayBundle
from aerokernels.wavefronts.pixels import pupil_grid
from tests.phase_plates import WAVELENGTH


def in_disc(square: np.ndarray) -> np.ndarray:
    """Points at random in the disc of 1 mm [m], shape (2, n), from those of the unit square."""
    radius, angle = 1e-3 * np.sqrt(square[0]), 2.0 * np.pi * square[1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)])


def test_scattered_samples_make_the_wavefront():
    """A tilt and a focus come back to rounding, a wave of 2.5 pupils to 2 % of it; the error says so.

    Places in space are those in the pupil's plane, whichever way it looks.
    """
    pupil = Annulus(1e-3, 3e-4, (0.01, 0.0, 0.2), (0.1, -0.2, 1.0))
    rays = RayBundle.collimated(pupil, 400)
    x, y = ((rays.position - pupil.center) @ axis for axis in pupil.axes)

    def plane(x, y):
        return 1e-4 * x - 2e-4 * y + 0.3 * (x * x + y * y)

    def wave(x, y):
        return 5e-8 * np.sin(2.5 * x / 1e-3 + 1.0) * np.cos(2.5 * y / 1e-3)

    for form, places, greatest in ((plane, rays.position, 1e-18), (wave, np.stack([x, y], axis=1), 1e-9)):
        made = Wavefront.from_samples(places, form(x, y), pupil, WAVELENGTH, pixel_count=32)
        off = np.abs(made.opd[made.lit] - form(*made.points.T))
        assert off.max() < greatest and made.opd_error < 5.0 * greatest
        assert form is plane or np.mean(off < made.opd_error) > 0.9
        assert made.radius == 1e-3 and made.weight.sum() == pytest.approx(0.91 * np.pi * 256, rel=1e-9)
    told = Wavefront.from_samples(places, form(x, y), pupil, WAVELENGTH, pixel_count=32, error=1e-8)
    assert told.opd_error == pytest.approx(1e-8, rel=0.1) and off.max() < told.opd_error
    for bad, message in (
        ((places[:5], x[:5]), "at least 9 samples, got 5"),
        ((places, x[:5]), "points must have shape"),
        ((0.5 * places, x), "% of the pupil is farther"),
        ((np.repeat(places, 2, axis=0), np.repeat(x, 2)), "two samples are at the same point"),
        ((places, np.where(x == x[7], np.nan, x)), "the first is sample 7"),
    ):
        with pytest.raises(ValueError, match=message):
            Wavefront.from_samples(*bad, pupil, WAVELENGTH)


@pytest.mark.parametrize("seed", [2, 10])
def test_the_error_of_few_samples_holds(seed):
    """Waves a few of 250 samples wide: of nine pixels in ten, and of the map's numbers against a finer one."""
    rng = np.random.default_rng(seed)
    x, y = in_disc(rng.random((2, 250)))
    way = rng.normal(0.0, 4.0, (2, 2)) / 1e-3

    def form(x, y):
        return 1e-7 * np.sin(way[0, 0] * x + way[0, 1] * y) + 5e-8 * np.cos(way[1, 0] * x + way[1, 1] * y)

    made = Wavefront.from_samples(np.stack([x, y], axis=1), form(x, y), Disc(1e-3), WAVELENGTH, pixel_count=32)
    assert np.mean(np.abs(made.opd[made.lit] - form(*made.points.T)) < made.opd_error) > 0.9
    coordinate, pixel, weight, intensity = pupil_grid(Disc(1e-3), 96)
    exact = Wavefront(form(*np.meshgrid(coordinate, coordinate)), weight, pixel, WAVELENGTH, intensity=intensity)
    for name, told in made.quantities.items():
        assert abs(told.value - exact.quantities[name].value) <= told.error, name


@pytest.mark.parametrize(
    ("pupil", "pixel_count"),
    [(Annulus(0.02, 0.016), 8), (Polygon([[0.0, 0.0], [0.02, 0.002], [0.006, 0.018]]), 12)],
    ids=["ring", "triangle"],
)
def test_many_samples_make_a_map_of_few_pixels(pupil, pixel_count: int):
    """Samples all over the pupil, of a smooth wave; centres of pixels on its rim lie outside, farther than samples do.

    Expected: the mean over 131,072 points of the pupil, to the reported error.
    """

    def wave(flat: np.ndarray) -> np.ndarray:
        u, v = flat.T / 0.02
        return 4e-8 * (u + v * u - 0.5 * v**2)

    samples, many = (pupil.flat_sample(count, "sobol", 1)[0] * pupil.reach for count in (2000, 1 << 17))
    found = Wavefront.from_samples(samples, wave(samples), pupil, 633e-9, pixel_count=pixel_count)
    exact = abs(np.mean(np.exp(2j * np.pi / 633e-9 * wave(many)))) ** 2
    strehl = found.quantities["strehl"]
    assert abs(strehl.value - exact) <= strehl.error + 1e-5


def test_a_map_of_scattered_samples_can_be_pickled_and_keeps_its_samples():
    """Its error is measured when it is first read: in another process, or after the caller has reused the arrays."""
    places = in_disc(np.random.default_rng(2).random((2, 120))).T
    values = 5e-8 * np.sin(3.0 * places[:, 0] / 1e-3)
    made = Wavefront.from_samples(places, values, Disc(1e-3), WAVELENGTH, pixel_count=16, error=1e-9)
    again = pickle.loads(pickle.dumps(made))
    same = Wavefront.from_samples(places, values, Disc(1e-3), WAVELENGTH, pixel_count=16, error=1e-9)
    expected = dict(same.error)
    places[:], values[:] = 0.0, 1.0
    assert made.error == again.error == expected
    assert again.quantities == made.quantities
