"""Transmission along rays: Beer and Lambert's law in exact cases, the same on every engine, into pupils and echoes."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import erf

from aerokernels import Disc, IndexField, Plane, RayBundle, estimate_strehl, flow, simulate_echo, trace, wavefront
from aerokernels.lidar import Detector, Laser, Receiver, Target

BACKENDS = ["opencl", "warp", "reference"]
HALF, COUNT = 0.01, 65
AXIS = np.linspace(-HALF, HALF, COUNT)


def still(values=None) -> IndexField:
    """A cube of undisturbed gas, of 2 cm."""
    values = np.zeros((COUNT,) * 3) if values is None else values
    step = AXIS[1] - AXIS[0]
    return IndexField.from_samples(values, origin=(-HALF,) * 3, spacing=(step,) * 3, geometry="volume")


def slanted(count=20) -> tuple[RayBundle, np.ndarray, np.ndarray]:
    """Rays through the cube, and the distances at which they enter and leave it."""
    start = np.stack([np.linspace(-3e-3, 3e-3, count), np.linspace(2e-3, -3e-3, count), np.full(count, -0.03)], axis=1)
    rays = RayBundle(start, [[0.1, 0.05, 1.0]])
    cosine = rays.direction[0, 2]
    return rays, np.full(count, 0.02 / cosine), np.full(count, 0.04 / cosine)


def blob(points, height=100.0, width=3e-3):
    return height * np.exp(-(points**2).sum(axis=1) / (2.0 * width**2))


def test_nothing_is_absorbed_where_nothing_absorbs():
    rays, *_ = slanted(3)
    assert (trace(still(), rays, outputs="opd").transmission == 1.0).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_beer_and_lambert_in_a_slab(backend):
    """exp(-30 L - 2 rest) to 1e-12, whatever outputs were asked for."""
    rays, enter, leave = slanted()
    traced = trace(
        still().with_absorption(30.0, ambient=2.0), rays, until=Plane((0, 0, 0.05), (0, 0, 1)), outputs="opd",
        backend=backend,
    )  # fmt: skip
    whole = 0.08 / rays.direction[0, 2]
    expected = np.exp(-30.0 * (leave - enter) - 2.0 * (whole - leave + enter))
    np.testing.assert_allclose(traced.transmission, expected, rtol=1e-12)


@pytest.mark.parametrize("sampled", [False, True])
def test_a_gaussian_blob(sampled):
    """Against the error function: to 1e-6, as a function and as samples of twenty to its width."""
    rays, enter, leave = slanted()
    grid = np.stack([axis.ravel() for axis in np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")], axis=1)
    coefficient = blob(grid).reshape((COUNT,) * 3) if sampled else blob
    traced = trace(still().with_absorption(coefficient), rays)
    along = rays.position @ rays.direction[0]
    aside = (rays.position**2).sum(axis=1) - along**2
    column = erf((leave + along) / (np.sqrt(2.0) * 3e-3)) - erf((enter + along) / (np.sqrt(2.0) * 3e-3))
    depth = 100.0 * np.exp(-aside / (2.0 * 3e-3**2)) * 3e-3 * np.sqrt(np.pi / 2.0) * column
    np.testing.assert_allclose(traced.transmission, np.exp(-depth), rtol=1e-6)


@pytest.mark.parametrize(
    ("backend", "precision"), [("opencl", "float32"), ("warp", "float64"), ("reference", "float64")]
)
def test_a_curved_ray(backend, precision):
    """In a graded-index rod, in which rays turn by 0.04 rad: against an ordinary differential equation, to 1e-6."""
    middle, strength, end = 1.5, 28.0, 0.03
    across, along = np.linspace(-4e-3, 4e-3, 81), np.linspace(0.0, end, 31)
    x, y, _ = np.meshgrid(across, across, along, indexing="ij")
    step = across[1] - across[0]
    rod = IndexField.from_samples(
        middle * np.sqrt(1.0 - strength**2 * (x**2 + y**2)) - middle, origin=(-4e-3, -4e-3, 0.0),
        spacing=(step, step, along[1]), geometry="volume", ambient_index=middle,
    )  # fmt: skip

    def coefficient(points):
        return 50.0 * np.exp(-((points[:, 0] - 1e-3) ** 2 + points[:, 1] ** 2) / (2.0 * 1e-3**2))

    def rates(_, state):
        place, tangent = state[:3], state[3:6]
        index = middle * np.sqrt(1.0 - strength**2 * (place[0] ** 2 + place[1] ** 2))
        force = -((middle * strength) ** 2) / index * np.array([place[0], place[1], 0.0])
        return [*(tangent / index), *force, coefficient(place[None])[0]]

    def arrives(_, state):
        return state[2] - end

    arrives.terminal = True
    starts = np.array([[2e-3, 0.0, 0.0], [1e-3, 1e-3, 0.0]])
    expected = []
    for start in starts:
        index = middle * np.sqrt(1.0 - strength**2 * (start[0] ** 2 + start[1] ** 2))
        solved = solve_ivp(rates, (0.0, 1.0), [*start, 0, 0, index, 0], rtol=1e-11, atol=1e-13, events=arrives)
        expected.append(np.exp(-solved.y[6, -1]))
    rays = RayBundle(starts - [0.0, 0.0, 1e-3], [[0.0, 0.0, 1.0]])
    traced = trace(rod.with_absorption(coefficient), rays, backend=backend, precision=precision, tolerance=1e-4)
    np.testing.assert_allclose(traced.transmission, expected, rtol=1e-6)


def test_pupils_are_weighted_by_the_amplitude():
    """A cylindrical lens and absorption that is strongest in the middle of a disc: both answers give one ratio."""
    field = still(np.broadcast_to(0.9 * AXIS[:, None, None] ** 2, (COUNT,) * 3))
    pupil = Disc(radius=4e-3, center=(0.0, 0.0, -0.02))

    def coefficient(points):
        return 200.0 * np.exp(-(points[:, 0] ** 2 + points[:, 1] ** 2) / (2.0 * 2e-3**2))

    dark = field.with_absorption(coefficient)
    wave = wavefront(dark, pupil, pixel_count=64, wavelength=905e-9)
    clear = wavefront(field, pupil, pixel_count=64, wavelength=905e-9)
    middle = wave.intensity[32, 32] / clear.intensity[32, 32]
    assert middle == pytest.approx(np.exp(-200.0 * 0.02), rel=0.02)
    np.testing.assert_allclose(wave.weight**2, wave.intensity * clear.weight**2 / np.maximum(clear.intensity, 1e-9))
    seen = [estimate_strehl(each, pupil, wavelength=905e-9, ray_count=4096) for each in (dark, field)]
    for estimate, map_ in zip(seen, (wave, clear), strict=True):
        assert estimate.value == pytest.approx(map_.strehl(), abs=3e-3)
    assert seen[0].value < seen[1].value - 0.01  # the rim, where the phase is greatest, has more of the light


def test_an_echo_is_weakened_on_both_ways():
    """A uniform absorber of 5 /m over 2 cm: the power falls by exp(-2 x 5 x 0.02) / cos of the divergence."""
    parts = Laser(peak_power=75.0), Target(distance=1.5), Receiver(), Detector()
    reach = 0.05
    field = IndexField.from_samples(
        np.zeros((8, 8)), origin=(0.0, 0.01), spacing=(reach / 7, 0.02 / 7), geometry="axisymmetric"
    )
    clear, dark = (simulate_echo(*parts, field=each) for each in (field, field.with_absorption(5.0)))
    assert dark.power.max() / clear.power.max() == pytest.approx(np.exp(-2.0 * 5.0 * 0.02), rel=5e-5)


def test_coefficients_of_a_mixture(tmp_path):
    """Number density times cross-section, the latter from a table of HAPI's columns."""
    (tmp_path / "water.txt").write_text("# 1/cm cm2\n 2000.0 1e-22\n 3000.0 3e-22\n")
    section = flow.cross_section(tmp_path / "water.txt", 4e-6)
    assert section == pytest.approx(2e-26)
    moist = flow.Composition({"N2": 0.78, "O2": 0.21, "H2O": 0.01})
    mean = 0.78 * 28.0134 + 0.21 * 31.9988 + 0.01 * 18.015
    expected = 1.2 / (mean * 1e-3) * 6.02214076e23 * 0.01 * section
    assert flow.absorption_coefficient(1.2, moist, {"H2O": section}) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("call", "fault"),
    [
        (lambda: still().with_absorption(-1.0), "finite and not negative"),
        (lambda: still().with_absorption(np.ones((3, 3, 3))), "shape \\(3, 3, 3\\), the samples"),
        (lambda: flow.absorption_coefficient(1.0, flow.Composition({"N2": 1.0}), {"H2O": 1e-26}), "has no H2O"),
        (lambda: flow.cross_section(__file__, 4e-6), "no table of wave numbers"),
    ],
)
def test_what_cannot_be_is_refused(call, fault):
    with pytest.raises(ValueError, match=fault):
        call()
