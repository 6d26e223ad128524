"""Pictures: cameras and backgrounds, schlieren and shadows, and what is read from a picture."""

import numpy as np
import pytest

from aerokernels import (
    Annulus,
    Camera,
    Disc,
    DotPattern,
    Sensor,
    background_displacement,
    bos,
    image_through,
)
from aerokernels.schlieren import Bench, interferogram, schlieren, shadowgraph
from aerokernels.schlieren.fronts import fit_curve, inner_bands, outer_fronts, smoothed
from aerokernels.schlieren.line_of_sight import line_of_sight
from aerokernels.schlieren.shock_angle import measure_shock_angle
from aerokernels.schlieren.stand_off import measure_stand_off
from aerokernels.schlieren.view import PictureView
from tests.draws.camera_draws import draw_camera

from .records import Nudge
from .scenes import SINGLE, ball, nudged

pytestmark = pytest.mark.filterwarnings("ignore")
STAGES = ("imaging/", "schlieren/", "sensor")


@pytest.mark.parametrize("seed", range(4))
def test_camera(answers, seed: int):
    """Displacements and blur of random views, with their errors."""

    def case(nudge: Nudge):
        one = draw_camera(seed)
        found = background_displacement(
            nudged(one.air.field, nudge),
            one.camera,
            aperture_rays=one.aperture_rays,
            allow_truncation=True,
            backend="opencl",
        )
        return found.error, found.blur_error

    answers(case, nudge=SINGLE)


CAMERA = Camera(Disc(0.004, (0.0, 0.0, -0.1)), 0.05, 2e-5, (10, 14), distance=0.6, focus=0.5)


@pytest.mark.parametrize("pattern", [DotPattern(3.0, 0.2, 4), np.random.default_rng(3).random((30, 36))])
def test_background(answers, pattern):
    """Pictures of dots, and of a picture, through a ball of air."""

    def case(nudge: Nudge):
        given = {} if isinstance(pattern, DotPattern) else {"pattern_pixel": 1.2 * CAMERA.scene_pixel}
        found = bos(
            ball(nudge, "volume", 2e-5),
            CAMERA,
            pattern,
            sensor=Sensor(),
            seed=2,
            aperture_rays=4,
            **given,
            allow_truncation=True,
            backend="opencl",
        )
        return found.traced.error

    answers(case, nudge=SINGLE)


@pytest.mark.parametrize("distance", [0.6, np.inf])
def test_image(answers, distance: float):
    """A scene seen through air by kernels over the picture."""

    def case(nudge: Nudge):
        camera = Camera(Disc(0.004, (0.0, 0.0, -0.1)), 0.05, 5e-6, distance=distance, focus=0.5)
        scene = np.random.default_rng(1).random((16, 20))
        found = image_through(
            ball(nudge, "volume", 2e-5),
            scene,
            camera,
            psf_nodes=2,
            psf_pixels=9,
            pupil_pixels=12,
            wavelengths=[500e-9, 600e-9],
            weights=[1.0, 2.0],
            allow_truncation=True,
            backend="opencl",
        )
        return found.image, found.reference, found.spreads, found.displacement

    answers(case, nudge=SINGLE)


BENCHES = {
    "plain": None,
    "slit": Bench(1e-4, 1.0, source_points=3),
    "ring": Bench(2e-4, 0.5, Annulus(1e-4, 4e-5), focus=0.1),
}
VIEW = {"pixel_count": (10, 14), "extent": (-0.02, 0.03, -0.02, 0.02), "backend": "opencl"}


@pytest.mark.parametrize("view", ["x", "z", (0.2, 1.0, 0.1)])
@pytest.mark.parametrize("kind", ["schlieren", "shadow", "fringes"])
def test_bench(answers, kind: str, view):
    """What a knife edge, a screen and an interferometer show."""

    def case(nudge: Nudge):
        field = ball(nudge, "volume", 2e-5)
        if kind == "schlieren":
            edges = ("vertical", 0.4)
            found = [
                schlieren(field, view=view, knife_edge=edge, cut_off=0.4, sensitivity=2e4, rays_per_pixel=2, **VIEW)
                for edge in edges
            ]
            return found, schlieren(field, view=view, bench=Bench(1e-4, 1.0), **VIEW)
        if kind == "shadow":
            return [shadowgraph(field, view=view, distance=0.3, source_angle=angle, **VIEW) for angle in (0.0, 0.01)]
        found = [
            interferogram(field, view=view, fringe_spacing=spacing, fringe_angle=0.4, wavelength=500e-9, **VIEW)
            for spacing in (None, 0.02)
        ]
        return found, line_of_sight(field, view=view, focus=0.1, tilt=(0.01, 0.0), rays_per_pixel=2, **VIEW)

    answers(case, nudge=SINGLE)


class Picture(PictureView):
    """A picture that is given by itself."""

    def __init__(self, intensity: np.ndarray, horizontal: np.ndarray, vertical: np.ndarray):
        self.intensity, self.horizontal, self.vertical = intensity, horizontal, vertical


def shock_picture(nudge: Nudge, curve: float = 0.0) -> Picture:
    """A bright band along a slanted, bent line before a dark body, with noise."""
    rng = np.random.default_rng(5)
    right, up = np.linspace(-0.03, 0.05, 80), np.linspace(-0.03, 0.03, 61)
    x, y = np.meshgrid(right, up)
    off = np.abs(y) - 0.5 * (0.04 - x) - curve * (x - 0.01) ** 2
    picture = 0.5 + 0.3 * np.exp(-((off / 0.002) ** 2)) + rng.normal(0.0, 0.003, x.shape)
    return Picture(nudge(np.where(np.abs(y) < 0.2 * (0.035 - x), 0.02, picture)), right, up)


@pytest.mark.parametrize("half", ["upper", "lower", "both"])
@pytest.mark.parametrize("degree", [1, 2])
def test_angle(answers, half: str, degree: int):
    """The angle of a shock, and where it stands."""

    def case(nudge: Nudge):
        picture = shock_picture(nudge, 2.0 * (degree - 1))
        return measure_shock_angle(picture, (-0.01, 0.03), half=half, degree=degree)

    answers(case)


def test_stand_off(answers):
    """The distance of a bow shock from a nose."""
    answers(lambda nudge: measure_stand_off(shock_picture(nudge), 0.012))


def test_fronts(answers):
    """Fronts and bands on lines."""

    def case(nudge: Nudge):
        rng = np.random.default_rng(8)
        place = np.arange(70.0)
        lines = 0.5 + 0.3 * np.clip((place - rng.uniform(20.0, 40.0, 12)[:, None]) / 6.0, 0.0, 1.0)
        lines = nudge(lines + rng.normal(0.0, 0.004, lines.shape))
        front = outer_fronts(lines, 0.4)
        return (
            front,
            smoothed(lines, 1.3),
            inner_bands(lines, front, 7.0),
            fit_curve(np.arange(12.0), np.linspace(3.0, 5.0, 12) ** 2 + 0.1 * front, 2, 0.5),
        )

    answers(case)
