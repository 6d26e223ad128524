"""Pupils, points, Zernike polynomials, sensors and comparisons of waveforms."""

import numpy as np
import pytest

from aerokernels import (
    Annulus,
    Disc,
    Mask,
    Polygon,
    RayBundle,
    Rectangle,
    Sensor,
    compare_waveforms,
    strehl,
    strehl_marechal,
    zernike,
)
from aerokernels.sobol import sobol_numbers, sobol_points

from .records import Nudge

STAGES = ("pupils/", "zernike", "sobol", "sensor", "compare", "strehl/", "rays", "wavefront/terms")
PLACE = (0.01, -0.02, 0.3), (0.2, -0.1, 1.0)
PUPILS = {
    "disc": lambda nudge: Disc(nudge(0.02), *PLACE),
    "ring": lambda nudge: Annulus(nudge(0.02), 0.007, *PLACE),
    "rectangle": lambda nudge: Rectangle(nudge(0.03), 0.01, *PLACE),
    "polygon": lambda nudge: Polygon(
        nudge(np.array([[-0.02, -0.01], [0.01, -0.015], [0.02, 0.01], [0.0, 0.004], [-0.01, 0.02]])), *PLACE
    ),
    "mask": lambda nudge: Mask(nudge(np.array([[0.0, 0.5, 1.0], [1.0, 1.0, 0.25]])), (0.005, 0.01), *PLACE),
}


@pytest.mark.parametrize("name", PUPILS)
def test_pupil(answers, name: str):
    """Areas, coverage of pixels by powers, points, and maps from the square."""

    def case(nudge: Nudge):
        pupil = PUPILS[name](nudge)
        x, y = np.linspace(-0.021, 0.023, 12), np.linspace(-0.018, 0.02, 9)
        inside = pupil.transmission(*(axis.ravel() for axis in np.meshgrid(x, y)))
        found = (
            pupil.axes,
            pupil.reach,
            pupil.area,
            pupil.half_extent,
            pupil.inner_ratio or 0.0,
            pupil.square_map,
            inside,
        )
        covers = pupil.coverage(x, y), pupil.coverage(x, y, 2)
        rays = [RayBundle.collimated(pupil, 40, sampling=sampling, seed=2) for sampling in ("sobol", "gauss")]
        rays += [RayBundle.through(pupil, (0.0, 0.1, -1.0), 33, toward_point=toward) for toward in (False, True)]
        return *found, covers, [(one.position, one.direction, one.weight) for one in rays]

    answers(case)


def test_fan(answers):
    """Rays within a cone."""

    def case(nudge: Nudge):
        found = [
            RayBundle.divergent(nudge(np.array([0.1, 0.2, 0.3])), (0.1, -0.2, 1.0), 0.3, 50, sampling=one)
            for one in ("sobol", "gauss")
        ]
        return [(one.position, one.direction, one.weight) for one in found]

    answers(case)


def test_zernike(answers):
    """Indices of three orders, and polynomials."""

    def case(nudge: Nudge):
        rng = np.random.default_rng(2)
        x, y = nudge(rng.uniform(-0.7, 0.7, (2, 30)))
        noll = [zernike.noll_to_nm(j) for j in range(1, 40)]
        others = [zernike.ansi_to_nm(j) for j in range(39)], [zernike.fringe_to_nm(j) for j in range(1, 38)]
        back = [(zernike.nm_to_noll(*one), zernike.nm_to_ansi(*one), zernike.nm_to_fringe(*one)) for one in noll]
        return noll, others, back, zernike.zernike_modes(21, x, y), zernike.zernike_polynomial(5, -3, x, y)

    answers(case)


def test_points(answers):
    """Sobol points, plain and scrambled."""

    def case(nudge: Nudge):
        numbers = [sobol_numbers(dimension, 5) for dimension in (1, 3)]
        return [sobol_points(33, 3, seed, scramble) for seed in (0, 7) for scramble in (True, False)], numbers

    answers(case)


def test_sensor(answers):
    """Exposures with and without noise."""

    def case(nudge: Nudge):
        light = nudge(np.linspace(0.0, 1.4, 60))
        sensors = Sensor(), Sensor(500.0, 0.5, 4.0, 20.0, 8), Sensor(shot_noise=False, read_noise=0.0, bits=3)
        return [one.expose(light, seed) for one in sensors for seed in (0, 4)]

    answers(case)


def test_waveforms(answers):
    """Echoes that are shifted, wider, weaker, clipped or of another shape."""

    def case(nudge: Nudge):
        time = np.arange(120) * 1.5e-10
        first = np.exp(-((time - 8e-9) ** 2) / (2e-9) ** 2)
        found = []
        for shift, width, height in ((7e-10, 2e-9, 0.8), (-1.3e-9, 3.3e-9, 1.2)):
            other = height * np.exp(-((time - 8e-9 - shift) ** 2) / width**2)
            found += [
                compare_waveforms(time, nudge(np.minimum(first, 0.9)), other, threshold=level, greatest_lag=lag)
                for level, lag in ((None, None), (0.3, 2e-9))
            ]
        return found, [one.width_range for one in found]

    answers(case)


def test_strehl(answers):
    """Ratios of maps, with terms removed."""

    def case(nudge: Nudge):
        rng = np.random.default_rng(4)
        points, opd, weight = (
            rng.uniform(-1.0, 1.0, (50, 2)),
            nudge(rng.normal(0.0, 5e-8, 50)),
            rng.uniform(0.0, 1.0, 50),
        )
        return [
            rule(opd + 3e-8 * points[:, 0], 500e-9, weight, remove, points=points)
            for rule in (strehl, strehl_marechal)
            for remove in ((), ("piston",), ("piston", "tilt"))
        ]

    answers(case)
