"""A symmetric set-up by radial quadrature: the Strehl ratio of the disc and the exact one, and only where it may."""

from functools import partial

import numpy as np
import pytest

import aerokernels
from aerokernels import Body, Disc, IndexField, Plane, RayBundle, available_backends, flow, trace
from aerokernels.tracing.engines.reference import pupil as reference_pupil
from aerokernels.tracing.pupil import run as pupil_run
from aerokernels.tracing.tasks.quadrature import RADIAL_RAYS, radial_points
from aerokernels.tracing.tasks.sums import PupilTask

# The lens of this page ends at the faces of its box: what lies beyond is known to be ambient.
estimate_strehl = partial(aerokernels.estimate_strehl, allow_truncation=True)
pytestmark = pytest.mark.filterwarnings("ignore:.* of the pupil looks through disturbed air:UserWarning")

WAVELENGTH = 905e-9
WAVE_NUMBER = 2.0 * np.pi / WAVELENGTH
REPLICATES = 16
SIZE, LENGTH, PUPIL = 4e-3, 0.02, 6e-3


def engine(name: str) -> dict[str, str]:
    """Backend and device for `estimate_strehl` on the CPU; the test is skipped, visibly, where there is none."""
    for info in available_backends():
        if info.backend == name and info.available and (info.device == "cpu" or info.description.startswith("CPU")):
            return {"backend": name, "device": info.device}
    pytest.skip(f"no {name} on a CPU here")


def lens(
    peak: float = 1e-5, body: Body | None = None, geometry: str = "axisymmetric", node_count: int = 161
) -> IndexField:
    """Contrast peak exp(-r^2 / s^2), constant in z over 20 mm, on nodes of 1/16 mm up to 10 mm."""
    r = np.linspace(0.0, 0.01, node_count)
    samples = np.repeat(peak * np.exp(-(r**2) / SIZE**2)[:, None], 9, axis=1)
    spacing = (r[1], LENGTH / 8)
    return IndexField.from_samples(samples, origin=(0.0, 0.0), spacing=spacing, geometry=geometry, body=body)


def exact_strehl(peak: float = 1e-5, inner: float = 0.0) -> float:
    """Of the lens, over the ring from `inner` to the pupil's rim, by 200 Gauss-Legendre points in r^2.

    A ray from r keeps the slope m'(r) z: W = L m + m'^2 (L^3 / 3 + L^2 R / 2) at a plane a radius R beyond the lens.
    """
    node, weight = np.polynomial.legendre.leggauss(200)
    r = np.sqrt(inner**2 + (PUPIL**2 - inner**2) * 0.5 * (node + 1.0))
    contrast = peak * np.exp(-(r**2) / SIZE**2)
    slope = -2.0 * r / SIZE**2 * contrast
    path = LENGTH * contrast + slope**2 * (LENGTH**3 / 3.0 + 0.5 * LENGTH**2 * PUPIL)
    return float(np.abs(0.5 * weight @ np.exp(1j * WAVE_NUMBER * path)) ** 2)


def ball(radius: float) -> Body:
    """A ball on the axis in the middle of the lens."""
    angle = np.linspace(0.0, np.pi, 181)
    profile = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1) + [0.0, 0.5 * LENGTH]
    profile[[0, -1], 0] = 0.0
    return Body(profile, "axisymmetric")


@pytest.fixture(scope="module")
def mach3() -> IndexField:
    """The shipped Mach 3 field, where rays of a pupil in the dome's centre can go."""
    return flow.shipped("mach3").index_field().resample(1e-4, region=((0.0, -0.009), (0.0075, 0.0044)))


DOME = Disc(PUPIL, (0.0, 0.0, -8e-3))


# --- the points ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "order"),
    [
        (lambda u: np.exp(3j * u), 3.0),
        (lambda u: np.exp(8j * np.abs(u - 0.37)), 2.0),
        (lambda u: np.where(u < 0.37, 1.0, -1.0), 1.0),
    ],
    ids=["smooth", "kink", "jump"],
)
def test_the_error_falls_as_said(shape, order):
    """Spread over 64 offsets while the count doubles six times: the order fitted is the one said, within 0.2."""
    counts = 2 ** np.arange(5, 12)
    spread = []
    for count in counts:
        squared, weight = radial_points(int(count), 64, seed=3)
        spread.append(np.std((weight * shape(squared)).mean(axis=1)))
    assert -np.polyfit(np.log(counts), np.log(spread), 1)[0] == pytest.approx(order, abs=0.2)


# --- the same answer -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["warp", "opencl"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("remove", ["piston", "tilt"])
def test_a_lens_against_its_exact_strehl_ratio(name, precision, remove):
    """Error sources reported by the estimate: steps, spline, precision, sampling; 1e-7 for what the formula leaves out.

    No tilt at all is found.
    """
    options = engine(name) | {"precision": precision, "remove": remove, "tolerance": 1e-4}
    estimate = estimate_strehl(lens(), Disc(PUPIL), symmetry=True, **options)
    reported = np.sqrt(sum(estimate.error[cause] ** 2 for cause in ("step", "interpolation", "precision", "sampling")))
    assert abs(estimate.value - exact_strehl()) < reported + 1e-7 < 1e-4
    assert estimate.standard_error < 1e-7
    assert estimate.traced_ray_count == REPLICATES * RADIAL_RAYS and estimate.blocked == pytest.approx(0.0, abs=1e-12)
    assert estimate.evaluation_count >= estimate.traced_ray_count
    assert (estimate.boresight == 0.0).all()
    assert {"compile", "kernel", "total"} <= set(estimate.seconds)


@pytest.mark.parametrize("normal", [1.0, -1.0])
@pytest.mark.parametrize("direction", [None, 1.0, -1.0])
def test_either_way_along_the_axis(normal, direction):
    """The lens is the same from both ends; the pupil may look along z or against it, and so may the rays."""
    along = normal if direction is None else direction
    pupil = Disc(PUPIL, (0.0, 0.0, 0.0 if along > 0.0 else LENGTH), (0.0, 0.0, normal))
    direction = None if direction is None else (0.0, 0.0, direction)
    estimate = estimate_strehl(lens(), pupil, direction=direction, symmetry=True, tolerance=1e-4)
    assert estimate.value == pytest.approx(exact_strehl(), abs=1e-4)


@pytest.mark.parametrize("name", ["warp", "opencl"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_the_shipped_field_gives_what_the_disc_gives(mach3, name, precision):
    """Same rays' errors on both, so within the standard errors; the other moments follow."""
    options = engine(name) | {"precision": precision, "ray_count": 65_536}
    radial, disc = (estimate_strehl(mach3, DOME, symmetry=way, **options) for way in ("auto", "off"))
    assert radial.traced_ray_count == REPLICATES * RADIAL_RAYS and disc.traced_ray_count == 65_536
    assert abs(radial.value - disc.value) < 4.0 * np.hypot(radial.standard_error, disc.standard_error)
    assert radial.standard_error < disc.standard_error
    assert radial.opd_rms == pytest.approx(disc.opd_rms, rel=1e-4)
    assert radial.marechal == pytest.approx(disc.marechal, abs=1e-5)
    assert (radial.boresight == 0.0).all() and np.abs(disc.boresight).max() < 1e-7


def test_blocked_rays_carry_no_light():
    """A ball of 3.1 mm on the axis: 27 % of the pupil is dark. The edge is felt, and all rays asked for are spent.

    Error: the wall is known to (0.05 mm)^2 / (8 * 3 mm) = 1e-7 m, and met within a step that is no longer than a node
    of that grid; an edge known to 1e-6 m moves the dark share by 2e-4. An edge costs one ray in n either way: standard
    errors alike (each of 15 degrees of freedom, so a factor of 3).
    """
    field, asked = lens(body=ball(3.1e-3)), 16 * 7000
    radial, disc = (estimate_strehl(field, Disc(PUPIL), ray_count=asked, symmetry=way) for way in (True, False))
    assert radial.traced_ray_count == asked + REPLICATES * RADIAL_RAYS
    assert any("as at an edge" in reason for reason in radial.plan.reasons)
    assert radial.blocked == pytest.approx((3.1 / 6.0) ** 2, abs=2e-3)
    assert radial.value == pytest.approx(exact_strehl(inner=3.1e-3), abs=1e-3)
    assert abs(radial.value - disc.value) < 4.0 * np.hypot(radial.standard_error, disc.standard_error)
    assert abs(radial.blocked - disc.blocked) < 1e-4
    assert radial.standard_error < 3.0 * disc.standard_error


def test_a_slit_of_light_is_found():
    """Only 1e-3 mm of the rim sees past the ball, less than lies between the rays of the first fan: no refusal."""
    radius, rim = 3e-3, 3.001e-3
    estimate = estimate_strehl(lens(0.0, body=ball(radius)), Disc(rim), symmetry=True, tolerance=1e-2)
    assert estimate.value == pytest.approx(1.0, abs=1e-9)
    assert 1.0 - estimate.blocked == pytest.approx(1.0 - (radius / rim) ** 2, rel=0.5)
    with pytest.raises(ValueError, match="no ray of the pupil arrived"):
        estimate_strehl(lens(body=ball(4e-3)), Disc(1e-3), ray_count=1024, symmetry=True)


# --- an honest error -------------------------------------------------------------------------------------------------


def test_the_standard_error_covers_the_error(mach3):
    """40 seeds against ten fans of twice the rays: two standard errors of 15 degrees of freedom cover 93.6 %.

    A binomial of 40 at 0.936 has a spread of 1.5: 37.4 expected, at least 32 asked for (3.5 of them).
    """
    options = {"ray_count": 16 * 256, "precision": "float64"}
    estimates = [estimate_strehl(mach3, DOME, seed=seed, **options) for seed in range(40)]
    finer = [estimate_strehl(mach3, DOME, seed=seed, **options | {"ray_count": 10**6}) for seed in range(100, 110)]
    truth = float(np.mean([estimate.value for estimate in finer]))
    values = np.array([estimate.value for estimate in estimates])
    reported = np.array([estimate.standard_error for estimate in estimates])
    assert (np.abs(values - truth) < 2.0 * reported).sum() >= 32
    assert 0.5 < np.sqrt(np.mean(reported**2)) / np.std(values, ddof=1) < 2.0
    assert len(np.unique(values)) == 40


# --- only where it may -----------------------------------------------------------------------------------------------


def volume() -> IndexField:
    return IndexField.from_samples(np.zeros((5, 5, 5)), origin=(-0.01,) * 3, spacing=(5e-3,) * 3, geometry="volume")


@pytest.mark.parametrize(
    ("field", "pupil", "direction", "reason"),
    [
        (volume, Disc(PUPIL), None, "the field is a volume, not axisymmetric"),
        (lambda: lens(geometry="planar"), Disc(PUPIL), None, "the field is planar, not axisymmetric"),
        (lens, Disc(PUPIL, (0.0, 1e-6, 0.0)), None, "the pupil's centre is 1e-06 m from the axis of symmetry"),
        (lens, Disc(PUPIL, normal=(1e-6, 0.0, 1.0)), None, "the pupil's normal makes an angle of 1e-06 rad"),
        (lens, Disc(PUPIL, normal=(1.0, 0.0, 0.0)), (0.0, 0.0, 1.0), "the pupil's normal makes an angle of 1.57 rad"),
        (lens, Disc(PUPIL), (0.0, 1e-6, 1.0), "the look direction makes an angle of 1e-06 rad"),
    ],
    ids=["volume", "planar", "offset", "tilted pupil", "edge on", "tilted look"],
)
def test_not_where_the_set_up_is_not_symmetric(field, pupil, direction, reason):
    options = {"direction": direction, "ray_count": 2048}
    estimate = estimate_strehl(field(), pupil, **options)
    assert estimate.traced_ray_count == 2048
    assert any(reason in why for why in estimate.plan.reasons)
    with pytest.raises(ValueError, match=f"symmetry=True, but {reason}.*or leave symmetry at 'auto'"):
        estimate_strehl(field(), pupil, symmetry=True, **options)


@pytest.mark.parametrize("symmetry", ["on", None, 1, 0.0])
def test_an_unknown_choice_is_refused(symmetry):
    with pytest.raises((TypeError, ValueError), match=r"symmetry must be .*True or False, got"):
        estimate_strehl(lens(), Disc(PUPIL), symmetry=symmetry)


def test_the_reference_backend_traces_the_same_radial_quadrature():
    """Its sums are those of the kernels, for the same few rays."""
    pupil, field, stop = Disc(PUPIL), lens(node_count=11), Plane((0.0, 0.0, 0.03), (0.0, 0.0, 1.0))
    sums = []
    for backend, runner in (("reference", reference_pupil), ("opencl", pupil_run)):
        options = {"backend": backend, "device": "cpu", "precision": "float64", "method": "adaptive"}
        plan = trace(field, RayBundle((0.0, 0.0, 0.0), pupil.normal), until=stop, **options).plan
        task = PupilTask(field, pupil, pupil.normal, stop, plan, WAVELENGTH, 4, 2, is_radial=True)
        sums.append(runner.PupilRun(task)(7))
    slow, fast = sums
    assert slow.moments.shape == fast.moments.shape
    assert slow.moments[:, :10] == pytest.approx(fast.moments[:, :10], rel=1e-4, abs=1e-15)
    # The kernels' phases are as they are, the reference's from the mean on.
    for one, other in zip(slow.phasors, fast.phasors, strict=True):
        assert abs(one) == pytest.approx(abs(other), abs=4e-3)
