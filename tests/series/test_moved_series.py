"""Parts of series by exact answers: linear samples, chords of meshes, tilts about their mean, planes in any order."""

import numpy as np
import pytest
import xarray

from aerokernels import Disc, QuadMesh, statistics
from aerokernels.series.line_integrals import MeshIntegrals
from aerokernels.series.linking import _linked_and_path
from aerokernels.series.plane_values import PlaneValues
from aerokernels.series.pupil_grid import pupil_grid

from .fourier import WAVELENGTH

GRID = pupil_grid(Disc(0.02), 16)


def test_jitter_is_the_rms_of_tilts_about_their_mean():
    """OPD (a + b_t) x + c_t y: the mean of x tilts is a + mean b; jitter is the rms of b and c about their means."""
    rng = np.random.default_rng(1)
    a, b, c = 3e-6, rng.normal(0.0, 1e-7, 64), rng.normal(2e-6, 2e-7, 64)
    maps = (a + b)[:, None] * GRID.coordinates[:, 0] + c[:, None] * GRID.coordinates[:, 1]
    opd = np.stack([GRID.spread(one) for one in maps])
    given = {"opd": (("time", "y", "x"), opd), "weight": (("y", "x"), GRID.weight)}
    places = {"time": 1e-5 * np.arange(64), "y": GRID.y, "x": GRID.x}
    found = statistics(xarray.Dataset(given, places, {"wavelength": WAVELENGTH}))
    assert float(found.boresight_x) == pytest.approx(a + b.mean(), rel=1e-6)
    assert float(found.boresight_y) == pytest.approx(c.mean(), rel=1e-6)
    assert float(found.jitter_x) == pytest.approx(b.std(), rel=0.02)
    assert float(found.jitter_y) == pytest.approx(c.std(), rel=0.02)
    assert float(found.opd_rms) < 1e-6 * float(found.opd_rms_with_tilt)


def test_two_snapshots_have_one_mode():
    """Maps m + d and m - d: the mean square about the mean is that of d, all of it in the first mode."""
    rng = np.random.default_rng(4)
    mean, change = rng.normal(0.0, 1e-7, (2, len(GRID.coordinates)))
    opd = np.stack([GRID.spread(mean + change), GRID.spread(mean - change)])
    given = {"opd": (("time", "y", "x"), opd), "weight": (("y", "x"), GRID.weight)}
    places = {"time": [0.0, 1e-5], "y": GRID.y, "x": GRID.x}
    found = statistics(xarray.Dataset(given, places, {"wavelength": WAVELENGTH}))
    lit = GRID.weight[GRID.weight > 0.0]
    assert float(found.pod_energy[0]) == pytest.approx(float(np.average(change**2, weights=lit)), rel=1e-9)
    assert (np.abs(found.pod_energy[1:]) < 1e-9 * float(found.pod_energy[0])).all()


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
def test_linear_samples_of_a_plane_stay_linear(interpolation: str):
    """Between all nodes, up to the edges; points outside have none. Mirrored at the first node what is even does so."""
    rng = np.random.default_rng(2)
    places = rng.uniform(0.0, 1.0, (80, 2)) * [8.0, 11.0]
    within = np.arange(80) % 5 > 0
    first, second = np.meshgrid(np.arange(9.0), np.arange(12.0), indexing="ij")
    plane = 1.0 + 0.3 * first - 0.2 * second
    expected = np.where(within, 1.0 + places @ [0.3, -0.2], 0.0)
    found = PlaneValues(places, (9, 12), within, interpolation)(plane)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    if interpolation == "cubic":
        even = PlaneValues(places, (9, 12), within, interpolation, even=True)(first**2 - 0.2 * second)
        inner = within & (places[:, 0] < 6.0)
        np.testing.assert_allclose(even[inner], (places[:, 0] ** 2 - 0.2 * places[:, 1])[inner], atol=2e-2)


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("slope", [0.0, 0.4, -0.4])
def test_a_constant_on_a_mesh_adds_up_to_the_chord(geometry: str, slope: float):
    """Rays across a rectangle, or a cylinder, of cells: 4 samples a cell leave one sample's length at each end.

    A density linear in z adds up to the chord times its value in the chord's middle.
    """
    half, length = 0.02, 0.06
    first = np.linspace(0.0 if geometry == "axisymmetric" else -half, half, 11)
    mesh = QuadMesh.structured(*np.meshgrid(first, np.linspace(0.01, 0.01 + length, 31), indexing="ij"), geometry)
    direction = np.array([0.0, slope, 1.0]) / np.hypot(1.0, slope)
    y = np.array([-0.012, 0.0, 0.004, 0.013, 0.05])
    start = np.stack([np.zeros(5), y, np.full(5, -0.01)], axis=1)
    lines = MeshIntegrals(mesh, start, direction)
    enter, leave = np.full(5, 0.02), np.full(5, 0.02 + length)  # along z
    if slope:
        side = np.sort(np.stack([(-half - y) / slope, (half - y) / slope]), axis=0)
        enter, leave = np.maximum(enter, side[0]), np.minimum(leave, side[1])
    else:
        leave = np.where(np.abs(y) < half, leave, enter)
    chord = np.maximum(leave - enter, 0.0) * np.hypot(1.0, slope)
    np.testing.assert_array_equal(lines.inside, chord > 0.0)
    np.testing.assert_allclose(lines.length, chord, atol=1.5e-3)
    z = np.asarray(mesh.vertices)[:, 1]
    value = 1.2 + 3.0 * (0.5 * (enter + leave) - 0.01)
    np.testing.assert_allclose(lines(1.2 + 3.0 * z), chord * value, atol=3e-3)
    np.testing.assert_allclose(lines(np.full(len(mesh.cells), 1.2), 1.0), 0.2 * lines.length, atol=1e-12)


def test_planes_may_be_counted_from_either_end():
    """Covariances along rays, from the first plane or from the last: the same shares of the variance."""
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(40, 3, 30))
    smooth = sum(np.roll(noise, k, axis=2) * w for k, w in ((-2, 0.3), (-1, 0.7), (0, 1.0), (1, 0.7), (2, 0.3)))
    weights = np.full((3, 30), 1e-3)
    weights[:, [0, -1]] *= 0.5
    before = _linked_and_path(smooth, weights)
    after = _linked_and_path(smooth[:, :, ::-1], weights[:, ::-1])
    np.testing.assert_allclose(after, before, rtol=1e-9)
    np.testing.assert_allclose(_linked_and_path(2.0 * smooth, weights), 4.0 * before, rtol=1e-9)
    # The variance of the integral, about the mean over the snapshots, which is corrected for afterwards.
    integral = smooth @ weights[0]
    np.testing.assert_allclose(before[1].mean(), integral.var(axis=0, ddof=0).mean(), rtol=1e-9)
