"""Wavefronts and waves: modes, spreads and errors of maps; slabs, screens, bounds and verdicts of waves."""

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Rectangle, Wave, Wavefront, split_step, validity, wavefront
from aerokernels.wavefront import point_spread_function
from aerokernels.waves.bounds import change_bound
from tests.draws.wave_draws import draw_view

from .records import Nudge
from .scenes import SINGLE, ball, nudged

pytestmark = pytest.mark.filterwarnings("ignore")
STAGES = ("wavefront/", "waves/", "strehl/")
PUPILS = {
    "disc": Disc(0.01, (0.001, 0.0, -0.04)),
    "ring": Annulus(0.012, 0.004, (0.0, 0.0, -0.04)),
    "rectangle": Rectangle(0.02, 0.011, (0.0, 0.002, -0.04), (0.0, 0.05, 1.0)),
}


@pytest.mark.parametrize("pupil", PUPILS)
@pytest.mark.parametrize("geometry", ["volume", "planar"])
def test_map(answers, pupil: str, geometry: str):
    """A traced map of pixels: terms, modes, images and their errors."""

    def case(nudge: Nudge):
        found = wavefront(
            ball(nudge, geometry),
            PUPILS[pupil],
            wavelength=600e-9,
            pixel_count=12,
            backend="opencl",
            allow_truncation=True,
        )
        plain = found.remove("piston", "tilt")
        psf = (
            plain.psf(padding=3),
            found.psf(np.linspace(-4e-5, 4e-5, 9), wavelengths=[500e-9, 600e-9], weights=[1.0, 2.0]),
        )
        numbers = (
            found.strehl(),
            found.rms,
            found.peak_to_valley,
            found.tilt,
            found.zernike(11),
            found.zernike_errors(11),
        )
        images = plain.otf(), plain.mtf(), plain.encircled_energy(), plain.centroid, plain.fwhm, plain.pssn(0.1)
        structure = plain.structure_function()
        errors = [one.error for one in (*psf, *images[:3], structure)]
        others = found.without_zernike(4, 5).rms, found.at_wavelength(1e-6).strehl(), found.quantities
        return psf, numbers, images, structure, errors, others, plain.image_quantities(0.2), found.error

    answers(case, nudge=SINGLE)


def test_scattered(answers):
    """A map of points that are anywhere, with its error."""

    def case(nudge: Nudge):
        rng = np.random.default_rng(6)
        points = rng.uniform(-0.012, 0.012, (40, 2))
        opd = nudge(3e-8 * np.sin(300.0 * points[:, 0]) * np.cos(200.0 * points[:, 1]) + 1e-6 * points[:, 0])
        found = Wavefront.from_samples(points, opd, PUPILS["ring"], 600e-9, pixel_count=12, opd_error=1e-9)
        return found, found.error

    answers(case)


def test_spread(answers):
    """Images of a map that is given by itself."""

    def case(nudge: Nudge):
        x, y = np.meshgrid(np.linspace(-1.0, 1.0, 12), np.linspace(-1.0, 1.0, 12))
        opd, mask = nudge(5e-8 * (x**2 - x * y)), (np.hypot(x, y) < 0.9).astype(float)
        found = (
            point_spread_function(opd, mask, 1e-3, 500e-9, padding=4),
            point_spread_function(opd, mask, 1e-3, 500e-9, half_width=1e-4),
        )
        return found, [one.fwhm for one in found]

    answers(case)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("light", ["pupil", "slanted", "wave"])
def test_wave(answers, geometry: str, light: str):
    """Steps through a ball of air, and what is left of it."""

    def case(nudge: Nudge):
        field = ball(nudge, geometry, 1e-5)
        pupil = Disc(0.008, (0.0, 0.001, -0.04), (0.0, 0.1 if light == "slanted" else 0.0, 1.0))
        found = split_step(field, pupil, wavelength=1e-6, pixel_count=48, step_count=6 if light == "slanted" else None)
        if light == "wave":
            start = Wave(found.amplitude[::-1], found.pixel, 1e-6, (0.0, 0.0, -0.04), ambient_index=field.ambient_index)
            found = split_step(field, start, pixel_count=48, paraxial=True, step_count=4)
        further = found.propagate(0.5)
        return found, found.strehl(), further, found.psf(np.linspace(-1e-4, 1e-4, 7)).intensity

    answers(case, nudge=1e-10)


@pytest.mark.parametrize("seed", range(4))
def test_verdict(answers, seed: int):
    """Whether rays are enough, by the field's bounds and by a wave."""

    def case(nudge: Nudge):
        view = draw_view(seed)
        field = nudged(view.field, nudge)
        bound = change_bound(field, view.pupil, view.pupil.normal, view.wavelength)
        found = [validity(field, view.pupil, wavelength=view.wavelength, limit=limit) for limit in (1e-2, 1e-4)]
        return bound, found, [one.good for one in found], found[0].decided

    answers(case, nudge=1e-9)
