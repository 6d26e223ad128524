"""Plans, bounds and error budgets of traces by the kernels: random bundles through random fields, and pupils."""

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Plane, Rectangle, estimate_strehl, prepare_strehl, trace
from aerokernels.rays import RayBundle
from tests.draws.bundle_draws import draw
from tests.draws.hard_bundles import UNTIL, hard_field

from .records import Nudge
from .scenes import SINGLE, ball, nudged

STAGES = ("tracing/", "strehl/")
pytestmark = pytest.mark.filterwarnings("ignore")  # rays above the tolerance, air that ends: they are in the answers


@pytest.mark.parametrize("backend", ["opencl", "warp"])
@pytest.mark.parametrize(
    ("geometry", "bundle", "stop"),
    [
        ("volume", "along z", "far"),
        ("volume", "crossing", "within"),
        ("planar", "beam", "beyond"),
        ("planar", "spanwise", "box"),
        ("axisymmetric", "along z", "box"),
        ("axisymmetric", "fan", "far"),
        ("volume", "faces", "beyond"),
    ],
)
def test_rays(answers, geometry: str, bundle: str, stop: str, backend: str):
    """300 rays by error control, and their budget."""
    if backend == "warp" and stop != "within":
        pytest.skip("kernels of OpenCL give the same answers")

    def case(nudge: Nudge):
        fixed = {"feature": "blob", "contrast": "1e-5", "interpolation": "cubic", "precision": "float32"}
        fixed |= {"count": "300", "tolerance": "1e-2", "method": "auto"}
        one = draw(5, geometry=geometry, bundle=bundle, stop=stop, **fixed)
        found = trace(nudged(one.field, nudge), one.rays, **one.settings, backend=backend)
        return found.error, found.status_summary(), found.truncation

    answers(case, nudge=SINGLE)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize(
    "until", [None, Plane((0.0, 0.0, 0.2), (0.0, 0.2, 1.0)), Plane((0.0, 0.0, 0.02), (0.1, 0.0, 1.0))]
)
def test_leapfrog(answers, geometry: str, until):
    """Rays enough for a pilot: the number of samples and what they miss."""

    def case(nudge: Nudge):
        rng = np.random.default_rng(5)
        start = np.c_[rng.uniform(-0.03, 0.03, (4200, 2)), np.full(4200, -0.05)]
        rays = RayBundle(start, np.c_[rng.normal(0.0, 0.02, (4200, 2)), np.ones(4200)])
        found = trace(ball(nudge, geometry, 2e-5), rays, until=until, backend="opencl", outputs=("opd", "step_error"))
        return found.error

    answers(case, nudge=SINGLE)


@pytest.mark.parametrize("seed", [1, 10])
def test_patches(answers, seed: int):
    """A bundle of lines through a point or of parallel lines, most of which are interpolated."""

    def case(nudge: Nudge):
        _, field = hard_field(seed)
        across = np.linspace(-0.9e-3, 0.9e-3, 110)
        u, v = (axis.ravel() for axis in np.meshgrid(across, across, indexing="ij"))
        place = np.c_[u, v, np.full(u.size, -1.55e-3)]
        toward = np.array([[0.05, -0.08, 1.0]]) if seed % 2 else place + np.array([1e-4, 0.0, 20e-3])
        found = trace(nudged(field, nudge), RayBundle(place, toward), until=UNTIL, backend="opencl", outputs=("opd",))
        return found.error

    answers(case, nudge=SINGLE)


PUPILS = {
    "disc": Disc(0.015, (0.0, 0.0, -0.05)),
    "ring": Annulus(0.015, 0.005, (0.0, 0.0, -0.05)),
    "aside": Rectangle(0.02, 0.012, (0.004, -0.01, -0.05), (0.1, 0.05, 1.0)),
}


@pytest.mark.parametrize("pupil", PUPILS)
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_pupil(answers, geometry: str, pupil: str):
    """Strehl ratios by lattices, by the symmetry, and by Sobol points, with their budgets."""

    def case(nudge: Nudge):
        field = ball(nudge, geometry, 2e-6)
        options = {"wavelength": 905e-9, "backend": "opencl", "allow_truncation": True}
        found = estimate_strehl(field, PUPILS[pupil], ray_count=100_000, **options)
        few = prepare_strehl(field, PUPILS[pupil], ray_count=4096, bundle="off", symmetry=False, **options)
        other = few(3)
        return found.error, found.quantities, other.error, other.quantities

    answers(case, nudge=SINGLE)
