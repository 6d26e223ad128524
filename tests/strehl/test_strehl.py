"""The Strehl ratio: closed forms, Marechal's limit, and the estimator against exact wavefronts of analytic fields."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import j1, ndtri

import aerokernels
from aerokernels import Body, Disc, IndexField, available_backends, strehl, strehl_marechal
from aerokernels.rays import unit_disc_samples

# The media of this page end at the faces of their boxes: what lies beyond is known to be ambient.
estimate_strehl = partial(aerokernels.estimate_strehl, allow_truncation=True)
pytestmark = pytest.mark.filterwarnings("ignore:.* of the pupil looks through disturbed air:UserWarning")

WAVELENGTH = 905e-9
WAVE_NUMBER = 2.0 * np.pi / WAVELENGTH


def disc(count: int = 1600):
    return unit_disc_samples(count, "gauss")


# --- wavefronts ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("waves", [0.0, 0.1, 0.5, 1.2, 2.3])
def test_pure_tilt(waves):
    """OPD = a x over a disc: (2 J1(v) / v)^2 with v = k a; 40 rings and 40 angles are exact to rounding here."""
    points, weights = disc()
    v = max(2.0 * np.pi * waves, 1e-9)
    opd = waves * WAVELENGTH * points[:, 0]
    assert strehl(opd, WAVELENGTH, weights) == pytest.approx((2.0 * j1(v) / v) ** 2, abs=1e-12)
    assert strehl(opd, WAVELENGTH, weights, remove="tilt", points=points) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("waves", [0.0, 0.25, 1.0, 1.7])
def test_pure_defocus(waves):
    """OPD = d r^2: (sin(x) / x)^2 with x = k d / 2; nil at a whole wave. Removing tilt changes nothing."""
    points, weights = disc()
    opd = waves * WAVELENGTH * np.sum(points**2, axis=1)
    expected = np.sinc(waves) ** 2
    assert strehl(opd, WAVELENGTH, weights) == pytest.approx(expected, abs=1e-12)
    assert strehl(opd, WAVELENGTH, weights, ("piston", "tilt"), points=points) == pytest.approx(expected, abs=1e-12)


def test_marechal_is_the_limit_of_small_wavefronts():
    """Coma and defocus of 1/20 to 1/160 wave: exact minus Marechal falls as the third power or faster, to nothing."""
    points, weights = disc()
    shape = np.sum(points**2, axis=1) * (1.0 + points[:, 0])
    sizes = WAVELENGTH / np.array([20.0, 40.0, 80.0, 160.0])
    gaps = [
        abs(strehl(a * shape, WAVELENGTH, weights) - strehl_marechal(a * shape, WAVELENGTH, weights)) for a in sizes
    ]
    assert np.polyfit(np.log(sizes), np.log(gaps), 1)[0] > 2.8
    assert gaps[-1] < 1e-6


def test_marechal_is_exact_for_a_normal_wavefront():
    """OPD distributed normally with k sigma = 0.8, by its 20 000 quantiles: exp(-0.64). Tails cut off: 1e-4."""
    opd = 0.8 / WAVE_NUMBER * ndtri((np.arange(20_000) + 0.5) / 20_000)
    assert strehl_marechal(opd, WAVELENGTH) == pytest.approx(np.exp(-0.64), abs=1e-4)
    assert strehl(opd, WAVELENGTH) == pytest.approx(np.exp(-0.64), abs=1e-4)


def test_marechal_fails_for_a_shock():
    """Decision 8: a share p of the pupil sees phi = 5 pi more: exact 1 - 2 p (1 - p)(1 - cos phi), Marechal nothing."""
    opd = 2.5 * WAVELENGTH * (np.arange(1000) < 70)
    assert strehl(opd, WAVELENGTH) == pytest.approx(1.0 - 4.0 * 0.07 * 0.93, abs=1e-12)
    assert strehl_marechal(opd, WAVELENGTH) == pytest.approx(np.exp(-0.07 * 0.93 * (5.0 * np.pi) ** 2), rel=1e-9)


@given(seed=st.integers(0, 10_000), size=st.floats(0.0, 1e-5), piston=st.floats(-1e-3, 1e-3))
@settings(max_examples=60, deadline=None)
def test_what_does_not_change_a_strehl_ratio(seed, size, piston):
    """Between 0 and 1; a piston (1100 waves: rounding 1e-12), the sign, the order and scaled weights do nothing."""
    rng = np.random.default_rng(seed)
    opd, weights = size * rng.standard_normal(50), rng.uniform(0.1, 1.0, 50)
    value = strehl(opd, WAVELENGTH, weights)
    assert -1e-15 <= value <= 1.0 + 1e-12
    order = rng.permutation(50)
    for other in (
        strehl(opd + piston, WAVELENGTH, weights, ()),
        strehl(-opd, WAVELENGTH, weights),
        strehl(opd[order], WAVELENGTH, 7.0 * weights[order]),
        strehl(opd.reshape(5, 10), WAVELENGTH, weights.reshape(5, 10)),
    ):
        assert other == pytest.approx(value, abs=1e-10)
    assert strehl_marechal(opd + piston, WAVELENGTH, weights, ()) == pytest.approx(
        strehl_marechal(opd, WAVELENGTH, weights), abs=1e-6
    )


def test_a_map_knows_where_its_pixels_lie():
    """A two-axis wavefront needs no points for its tilt; pixels outside the pupil weigh nothing and may be NaN."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 31), np.linspace(-1.0, 1.0, 31), indexing="ij")
    share = (x**2 + y**2 <= 1.0).astype(float)
    tilted = np.where(share > 0.0, 1e-6 * x - 2e-6 * y, np.nan)
    assert strehl(tilted, WAVELENGTH, share, "tilt") == pytest.approx(1.0, abs=1e-12)
    assert strehl(tilted, WAVELENGTH, share) < 0.2
    with pytest.raises(ValueError, match="give the wavefront as a map"):
        strehl(tilted[share > 0.0], WAVELENGTH, remove="tilt")


@pytest.mark.parametrize("call", [strehl, strehl_marechal])
@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (([0.0, np.nan], WAVELENGTH), {}, "1 bad of 2 samples"),
        (([], WAVELENGTH), {}, "not empty"),
        (([0.0], 0.0), {}, "wavelength must be a positive length in metres, got 0.0"),
        (([0.0], np.nan), {}, "wavelength must be a positive length"),
        (([0.0, 0.0], WAVELENGTH, [1.0]), {}, "one for each of the 2 samples; got 1"),
        (([0.0], WAVELENGTH), {"remove": "coma"}, r"cannot remove \['coma'\]: choose from piston, tilt, focus"),
    ],
)
def test_what_is_refused(call, arguments, options, message):
    with pytest.raises(ValueError, match=message):
        call(*arguments, **options)


# --- the estimator ---------------------------------------------------------------------------------------------------

PEAK, SIZE, LENGTH, PUPIL = 1e-5, 4e-3, 0.02, 6e-3


def gaussian_rod(peak: float = PEAK, body: Body | None = None, node_count: int = 161) -> IndexField:
    """Contrast peak exp(-r^2 / s^2), constant in z over 20 mm, up to r = 10 mm on nodes of 1/16 mm."""
    r = np.linspace(0.0, 0.01, node_count)
    samples = np.repeat(peak * np.exp(-(r**2) / SIZE**2)[:, None], 9, axis=1)
    return IndexField.from_samples(
        samples, origin=(0.0, 0.0), spacing=(0.01 / (node_count - 1), LENGTH / 8), geometry="axisymmetric", body=body
    )


def total_but_truncation(error: dict) -> float:
    """Root sum of squares of the causes of an error but the end of the known air, which is the medium's own end."""
    return float(np.sqrt(sum(error[cause] ** 2 for cause in error if cause not in ("truncation", "total"))))


def exact_wavefront(r: np.ndarray, peak: float = PEAK, beyond: float = 0.0) -> np.ndarray:
    """OPD of the rod [m] at a plane `beyond` its end, over start radii, to second order in the contrast.

    A ray from r with slope m'(r) z: W = L m + m'^2 (L^3 / 3 + L^2 beyond / 2); the second term is 1e-5 wave here.
    """
    contrast = peak * np.exp(-(r**2) / SIZE**2)
    slope = -2.0 * r / SIZE**2 * contrast
    return LENGTH * contrast + slope**2 * (LENGTH**3 / 3.0 + 0.5 * LENGTH**2 * beyond)


def exact_strehl(pupil_radius: float = PUPIL, peak: float = PEAK, beyond: float = 0.0) -> float:
    """By 200 Gauss-Legendre points in r^2."""
    node, weight = np.polynomial.legendre.leggauss(200)
    phase = WAVE_NUMBER * exact_wavefront(pupil_radius * np.sqrt(0.5 * (node + 1.0)), peak, beyond)
    return float(np.abs(0.5 * weight @ np.exp(1j * phase)) ** 2)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_estimate_against_exact_quadrature(precision):
    """Set-up: a plane wave along the rod, pupil of 12 mm on its axis, OPD from 0.22 wave at the centre down.

    Formula: the closed wavefront above, quadrature in r^2. Expected: 0.887, within the error the estimate tells.
    Error sources, all reported: sampling (16 replicates of Sobol points), steps, spline, precision.
    """
    asked = {"ray_count": 65_536, "precision": precision, "tolerance": 1e-4, "symmetry": "off"}
    estimate = estimate_strehl(gaussian_rod(), Disc(PUPIL), **asked)
    # The plane lies a pupil radius and a thousandth of the box beyond the rod.
    exact = exact_strehl(beyond=PUPIL)
    assert abs(estimate.value - exact) < total_but_truncation(estimate.error) < 1e-4
    assert estimate.error["sampling"] == pytest.approx(2.13 * estimate.standard_error)
    assert estimate.ray_count == 65_536 and estimate.blocked == 0.0
    assert estimate.evaluation_count >= estimate.ray_count
    assert {"compile", "kernel", "total"} <= set(estimate.seconds)

    node, weight = np.polynomial.legendre.leggauss(200)
    opd = exact_wavefront(PUPIL * np.sqrt(0.5 * (node + 1.0)))
    rms = np.sqrt(0.5 * weight @ (opd - 0.5 * weight @ opd) ** 2)
    assert estimate.opd_rms == pytest.approx(rms, rel=1e-3)
    assert estimate.marechal == pytest.approx(np.exp(-((WAVE_NUMBER * rms) ** 2)), abs=1e-3)
    assert np.abs(estimate.boresight).max() < 1e-8


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 1.0), (0.3, -0.2, 1.0)])
def test_nothing_in_the_way_is_a_strehl_ratio_of_1(tilt):
    estimate = estimate_strehl(gaussian_rod(0.0), Disc(PUPIL), ray_count=4096, direction=tilt)
    assert abs(estimate.value - 1.0) < 1e-12 and estimate.standard_error < 1e-12
    assert estimate.opd_rms < 1e-15 and estimate.blocked == 0.0


def test_the_standard_error_is_honest_and_falls_faster_than_random():
    """Scatter of twelve seeds against the standard error each tells, and its fall from 2^10 to 2^14 rays.

    Expected: equal within a factor of two (chi-square of 11 and of 15 degrees of freedom); 16 times the rays lower the
    error by more than the 4 of independent points.
    """
    field, pupil, reported, scatter = gaussian_rod(), Disc(PUPIL), [], []
    for count in (1024, 16_384):
        estimates = [estimate_strehl(field, pupil, ray_count=count, seed=seed, symmetry="off") for seed in range(12)]
        reported.append(np.sqrt(np.mean([e.standard_error**2 for e in estimates])))
        scatter.append(np.std([e.value for e in estimates], ddof=1))
    assert all(0.5 < a / b < 2.0 for a, b in zip(reported, scatter, strict=True))
    assert reported[0] / reported[1] > 8.0


def test_the_error_of_marechals_ratio_covers_its_spread_over_seeds():
    """512 rays for each of 24 seeds; their mean stands for the truth. Twice the spread covers 95 of 100."""
    field, pupil = gaussian_rod(), Disc(PUPIL)
    estimates = [estimate_strehl(field, pupil, ray_count=512, seed=seed, symmetry="off") for seed in range(24)]
    seen = [one.quantities["marechal"] for one in estimates]
    value, error = np.array([[one.value, one.error] for one in seen]).T
    assert np.mean(np.abs(value - value.mean()) <= error) >= 0.85
    assert np.median(error) <= 5.0 * value.std()


def ball(radius: float, z: float) -> Body:
    angle = np.linspace(0.0, np.pi, 181)
    profile = np.stack([radius * np.sin(angle), z + radius * np.cos(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    return Body(profile, "axisymmetric")


def test_blocked_rays_carry_no_light():
    """Set-up: a ball of 3 mm ahead of a pupil of 6 mm, in the rod. Expected: a quarter of the rays end on it.

    The Strehl ratio is that of the ring outside: the quadrature from r = 3 to 6 mm. Error: the wall is known to a grid
    of 0.05 mm, bilinear, (0.05 mm)^2 / (8 * 3 mm) = 1e-7 m; no step is longer than the wall is away, or one node of
    that grid; sampling of a sharp edge, about 16384^(-3/4) = 7e-4.
    """
    body = ball(3e-3, 0.01)
    estimate = estimate_strehl(gaussian_rod(body=body), Disc(PUPIL), ray_count=16_384, symmetry="off")
    assert estimate.blocked == pytest.approx(0.25, abs=2e-3)
    node, weight = np.polynomial.legendre.leggauss(200)
    r = np.sqrt(3e-3**2 + (PUPIL**2 - 3e-3**2) * 0.5 * (node + 1.0))
    ring = np.abs(0.5 * weight @ np.exp(1j * WAVE_NUMBER * exact_wavefront(r))) ** 2
    assert estimate.value == pytest.approx(ring, abs=1e-3)


def test_a_pupil_that_sees_nothing_is_refused():
    with pytest.raises(ValueError, match=r"no ray of the pupil arrived.*move the pupil"):
        estimate_strehl(gaussian_rod(body=ball(4e-3, 0.01)), Disc(1e-3), ray_count=64)


def opencl_device(gpu: bool) -> str:
    """The best OpenCL device of a kind; the test is skipped, with the reason, where there is none."""
    found = [info for info in available_backends() if info.backend == "opencl"]
    for info in found:
        if info.available and info.description.startswith("GPU") == gpu:
            return info.device
    missing = "; ".join(info.reason for info in found if not info.available)
    pytest.skip(f"no OpenCL {'GPU' if gpu else 'CPU'} here" + (f": {missing}" if missing else ""))


@pytest.mark.slow
@pytest.mark.parametrize("gpu", [False, pytest.param(True, marks=pytest.mark.gpu)], ids=["cpu", "gpu"])
@pytest.mark.parametrize("remove", ["tilt", "piston"])
@pytest.mark.parametrize(("precision", "allowed"), [("float64", 1e-9), ("float32", 1e-5)])
def test_warp_and_opencl_agree(precision, allowed, remove, gpu):
    """The same seed gives the same rays on both; a pupil aside of the rod's axis, so that there is tilt to remove.

    Errors: rounding, 2e-7 wave in float32; a step more or less for some rays. 1e-5 and 1e-9 asked for.
    """
    pupil = Disc(3e-3, center=(2e-3, 1e-3, 0.0))
    asked = {"ray_count": 16 * 1100, "precision": precision, "remove": remove, "seed": 9}
    ours = estimate_strehl(gaussian_rod(), pupil, backend="opencl", device=opencl_device(gpu), **asked)
    theirs = estimate_strehl(gaussian_rod(), pupil, backend="warp", device="cpu", **asked)
    assert (
        ours.plan.backend == "opencl" and ours.ray_count == theirs.ray_count and ours.blocked == theirs.blocked == 0.0
    )
    assert 0.1 < theirs.value < 0.999 and np.abs(theirs.boresight).max() > 1e-6
    for name in ("value", "marechal", "standard_error"):
        assert abs(getattr(ours, name) - getattr(theirs, name)) < allowed
    assert abs(ours.opd_rms - theirs.opd_rms) < allowed * WAVELENGTH
    assert np.abs(ours.boresight - theirs.boresight).max() < allowed * WAVELENGTH / 3e-3


@pytest.mark.slow
def test_the_reference_backend_agrees():
    """A few rays through the same field in SciPy, another sample of the pupil: equal within twice both errors."""
    field, pupil = gaussian_rod(node_count=21), Disc(PUPIL)
    slow = estimate_strehl(field, pupil, ray_count=32, backend="reference", remove="tilt")
    fast = estimate_strehl(field, pupil, ray_count=16_384, remove="tilt", symmetry="off")
    assert slow.plan.backend == "reference" and slow.ray_count == 32
    assert abs(slow.value - fast.value) < 2.0 * sum(total_but_truncation(each.error) for each in (slow, fast))
    assert slow.error["step"] < 1e-6 and slow.evaluation_count > 32


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"field": np.zeros((3, 3))}, TypeError, "field must be an IndexField, got ndarray"),
        ({"pupil": 6e-3}, TypeError, "pupil must be a Disc, .* or Mask, got float"),
        ({"wavelength": 0.0}, ValueError, "wavelength must be a positive length"),
        ({"ray_count": 15}, ValueError, "ray_count must be a whole number of at least 16, got 15"),
        ({"ray_count": 1e6 + 0.5}, ValueError, "ray_count must be a whole number"),
        ({"remove": ("piston", "defocus")}, ValueError, r"cannot remove \['defocus'\]"),
        ({"method": "euler"}, ValueError, "method 'euler' is not known"),
        ({"precision": "float16"}, ValueError, "precision 'float16' is not known"),
        ({"backend": "fortran"}, ValueError, "fortran"),
        ({"direction": (0.0, 0.0, 0.0)}, ValueError, "direction must not be the zero vector"),
        ({"tolerance": 0.0}, ValueError, "tolerance must be positive"),
        ({"step": 1e-3}, ValueError, "step belongs to method 'fixed', not to 'auto'"),
    ],
)
def test_what_the_estimator_refuses(change, kind, message):
    with pytest.raises(kind, match=message):
        estimate_strehl(**{"field": gaussian_rod(), "pupil": Disc(PUPIL), **change})
