"""Quadrature over a pupil by as many rays as the wavefront needs: right, honest, and not blind to what is narrow."""

import numpy as np
import pytest

from aerokernels import Annulus, Disc, IndexField, Mask, Rectangle, estimate_strehl, prepare_strehl
from aerokernels.tracing.tasks.quadrature import lattice_points, lattice_sizes

WAVE = 905e-9
ASKED = 1 << 17
OPTIONS = {"ray_count": ASKED, "wavelength": WAVE, "backend": "opencl", "allow_truncation": True}
H = 1e-4
pytestmark = pytest.mark.filterwarnings("ignore:.*looks through disturbed air")


def volume(depth: float, needle: float = 0.0) -> IndexField:
    """A lens without symmetry, 41 x 41 x 17 nodes of 0.1 mm; a needle along z, one node wide, off its centre."""
    x, y, z = (H * (np.arange(count) - (count - 1) / 2) for count in (41, 41, 17))
    gx, gy, gz = np.meshgrid(x, y, z, indexing="ij")
    made = depth * np.exp(-((gx / 1.2e-3) ** 2) - ((gy - 3e-4) / 9e-4) ** 2) * np.cos(gz / 6e-4) ** 2
    made[27, 16, :] += needle
    return IndexField.from_samples(made, origin=(x[0], y[0], z[0]), spacing=(H,) * 3, geometry="volume")


@pytest.fixture(scope="module", autouse=True)
def _opencl():
    pytest.importorskip("pyopencl")


@pytest.mark.parametrize("smoothed", [0, 1, 3])
def test_lattices_integrate_smooth_functions_without_bias(smoothed: int):
    """Of exp(i (3 u + 5 v)), periodic by substitution where it is not, means of 64 shifts within four standard errors.

    On both axes smoothed the error of 610 points is below 1e-6; without a substitution it is about 1 / n.
    """
    rng = np.random.default_rng(7)
    turns = 5.0 if smoothed == 3 else 2.0 * np.pi  # periodic on the second axis unless that is made so
    exact = (np.expm1(3j) / 3j) * (np.expm1(1j * turns) / (1j * turns))
    found = []
    for seeds in rng.integers(0, 2**32, (64, 2), dtype=np.uint32):
        square, weight = lattice_points(610, smoothed, seeds)
        found.append(np.mean(weight * np.exp(1j * (square @ [3.0, turns]))))
    error = np.std(found) / 8.0
    assert abs(np.mean(found) - exact) < 4.0 * error + 1e-14
    assert np.std(found) < (1e-6 if smoothed else 1e-2)


@pytest.mark.parametrize("pupil", [Disc(1e-3), Annulus(1e-3, 4e-4), Rectangle(1.6e-3, 1.1e-3)], ids=repr)
def test_few_rays_give_what_many_do(pupil):
    """The ratio of all rays asked for, within the standard errors of both; an error of 2e-5 at most is reported."""
    pupil = type(pupil)(**{**vars(pupil), "center": np.array([1e-4, 0.0, -1.2e-3])})
    field = volume(3e-4)
    few = estimate_strehl(field, pupil, seed=3, **OPTIONS)
    all_of_them = estimate_strehl(field, pupil, seed=3, bundle="off", **OPTIONS)
    assert all_of_them.traced_ray_count == ASKED and few.traced_ray_count < ASKED / 4
    assert few.error["sampling"] < 2e-5
    assert abs(few.value - all_of_them.value) < 4.0 * np.hypot(few.standard_error, all_of_them.standard_error)
    assert few.opd_rms == pytest.approx(all_of_them.opd_rms, rel=2e-3)
    assert np.abs(few.boresight - all_of_them.boresight).max() < 1e-7
    assert 0.0 <= few.blocked < 1e-6
    assert any("shifted lattices" in reason for reason in few.plan.reasons)


def test_the_standard_error_of_lattices_is_honest():
    """Scatter of twelve seeds against the error each tells: equal within a factor of two (chi-square, as for Sobol)."""
    seen = prepare_strehl(volume(3e-4), Disc(1e-3, (1e-4, 0.0, -1.2e-3)), **OPTIONS)
    found = [seen(seed) for seed in range(12)]
    told = np.sqrt(np.mean([each.standard_error**2 for each in found]))
    assert 0.5 < told / np.std([each.value for each in found], ddof=1) < 2.0


def test_an_edge_takes_all_rays():
    """Pixels open or shut at random are no smooth map of the square: as many rays as asked for are traced."""
    shut = Mask(np.random.default_rng(2).integers(0, 2, (9, 9)), 2e-4, (0.0, 0.0, -1.2e-3))
    found = estimate_strehl(volume(3e-4), shut, **OPTIONS)
    assert found.traced_ray_count >= ASKED
    assert any("too rough" in reason for reason in found.plan.reasons)


def test_cells_are_never_skipped():
    """As many rays as leave no cell out: a needle of one node changes the ratio by what all rays say.

    On a grid so fine that no lattice is enough, every ray is traced.
    """
    pupil = Disc(1e-3, (1e-4, 0.0, -1.2e-3))
    sizes = lattice_sizes(volume(1e-4), pupil, ASKED // 16, 16, "auto")
    area = np.pi * pupil.radius**2
    assert min(sizes) * 16 >= area / (0.75 * H) ** 2
    with_needle, without = (estimate_strehl(volume(1e-5, peak), pupil, **OPTIONS).value for peak in (6e-4, 0.0))
    true = estimate_strehl(volume(1e-5, 6e-4), pupil, bundle="off", **OPTIONS)
    assert abs(true.value - without) > 20.0 * true.standard_error
    assert abs(with_needle - true.value) < 4.0 * np.hypot(true.standard_error, 6e-6)
    fine = IndexField.from_samples(
        np.zeros((301, 301, 2)), origin=(-1.5e-3,) * 3, spacing=(1e-5,) * 3, geometry="volume"
    )
    assert lattice_sizes(fine, pupil, ASKED // 16, 16, "auto") == ()


def test_bundle_is_checked():
    with pytest.raises(ValueError, match="bundle 'on' is not known"):
        estimate_strehl(volume(1e-5), Disc(1e-3, (0.0, 0.0, -1.2e-3)), bundle="on", **OPTIONS)
