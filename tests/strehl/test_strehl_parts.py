"""Parts of estimates over pupils: sums of the reference backend, ratios from sums, budgets, and results of traces."""

import dataclasses

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Plane, RayBundle, Rectangle, estimate_strehl, trace
from aerokernels.strehl.budget import STANDARD_ERRORS
from aerokernels.strehl.estimate import PreparedStrehl, prepare_strehl
from aerokernels.strehl.ratio import combined, met_nothing
from aerokernels.tracing import RayStatus
from aerokernels.tracing.engines.reference.engine import PupilRun
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.pupil.job import REPLICATES
from aerokernels.tracing.pupil.quadrature import radial_points
from aerokernels.tracing.pupil.sums import PupilTask, replicate_seeds
from aerokernels.tracing.result import TraceResult, output_mask

UP = np.array([0.0, 0.0, 1.0])
WAVE = 1e-6


def prism(geometry: str = "volume", scale: float = 1e-4) -> IndexField:
    """Air in a box of 12 mm, about 10 mm long, bent along both axes across."""

    def along(z):
        return np.where((z > 1.5e-3) & (z < 8.5e-3), np.sin(np.pi * (z - 1e-3) / 8e-3) ** 2, 0.0)

    axis = np.linspace(-6e-3, 6e-3, 13)
    z = np.linspace(0.0, 10e-3, 11)
    if geometry == "axisymmetric":
        r, z = np.meshgrid(axis[6:], z, indexing="ij")
        contrast = scale * (1.0 + (r / 4e-3) ** 2) * along(z)
        return IndexField.from_samples(contrast, origin=(0.0, 0.0), spacing=(1e-3, 1e-3), geometry=geometry)
    x, y, z = np.meshgrid(axis, axis, z, indexing="ij")
    contrast = scale * (1.0 + x / 6e-3 + 0.5 * (y / 6e-3) ** 2) * along(z)
    return IndexField.from_samples(contrast, origin=(-6e-3, -6e-3, 0.0), spacing=(1e-3,) * 3, geometry=geometry)


def task_of(pupil=None, terms=(), **more) -> PupilTask:
    field = prism("axisymmetric" if more.get("is_radial") else "volume")
    pupil = pupil or Rectangle(4e-3, 3e-3, (5e-4, -3e-4, -1e-3))
    until = Plane((0.0, 0.0, 12e-3), UP)
    plan = TracePlan("adaptive", "reference", "cpu", "float64", 1000, None, 1e-3, ())
    return PupilTask(field, pupil, UP, until, plan, WAVE, 24, 3, terms=terms, **more)


@pytest.mark.parametrize("terms", [(), ("tilt",), ("focus", "tilt")])
def test_sums_of_the_reference_are_those_of_its_rays(terms):
    """Of the rays that `trace` traces through each replicate's points: moments in metres, phasors about the surface."""
    task, seed = task_of(terms=terms), 5
    sums = PupilRun(task)(seed)
    paths, places = [], []
    for replicate in range(3):
        rays = RayBundle.collimated(task.pupil, 24, direction=UP, seed=3 * seed + replicate)
        result = trace(task.field, rays, until=task.until, backend="reference", precision="float64", method="adaptive")
        place = (rays.position - task.pupil.center) @ np.stack(task.pupil.axes, axis=1)
        x, y, w = *place.T, result.opd
        q = x * x + y * y
        expected = [24.0, *(np.sum(one) for one in (x, y, w, x * x, x * y, y * y, x * w, y * w, w * w))]
        np.testing.assert_allclose(sums.moments[replicate, :10], expected, rtol=1e-8, atol=1e-15)
        np.testing.assert_allclose(
            sums.moments[replicate, 12:], [np.sum(x * q), np.sum(y * q), np.sum(q * q), np.sum(q * w)], rtol=1e-8
        )
        assert sums.moments[replicate, 10] == pytest.approx(result.step_error.max(), rel=1e-6)
        assert sums.moments[replicate, 11] == result.evaluation_count.sum()
        paths.append(w)
        places.append(place)
    x, y = np.concatenate(places).T
    w = np.concatenate(paths)
    columns = [np.ones_like(x), *([x, y] if "tilt" in terms else []), *([x * x + y * y] if "focus" in terms else [])]
    fit = np.linalg.lstsq(np.stack(columns, axis=1), w - w.mean(), rcond=None)[0]
    slopes = np.stack(columns[1:], axis=1) @ fit[1:] if terms else 0.0 * w
    phases = 2.0 * np.pi / WAVE * (w - w.mean() - slopes)
    np.testing.assert_allclose(sums.phasors, np.exp(1j * phases).reshape(3, 24).sum(axis=1), rtol=1e-6)
    assert sums.ray_count == 72 and np.abs(phases).max() > 0.03


def test_sums_along_a_radius_and_of_lattices():
    """Weights p'(t) of a radial replicate, of points along x; lattices take the square map of a disc."""
    disc = Disc(3e-3, (0.0, 0.0, -1e-3))
    sums = PupilRun(task_of(disc, is_radial=True))(7)
    squared, weight = radial_points(24, 3, 7)
    np.testing.assert_allclose(sums.moments[:, 0], 24.0, rtol=1e-12)
    np.testing.assert_allclose(sums.moments[:, 4], 0.5 * 9e-6 * (weight * squared).sum(axis=1), rtol=1e-9)
    np.testing.assert_allclose(sums.moments[:, 6], sums.moments[:, 4])
    assert not sums.moments[:, [1, 2, 5]].any()
    task = dataclasses.replace(task_of(disc), per_replicate=144, generator=89)
    lattice = PupilRun(task)(7)
    # A mean over the disc of r^2 is R^2 / 2, of x^2 a half of that; the lattice is exact to 1e-4.
    means = lattice.moments.sum(axis=0) / lattice.moments[:, 0].sum()
    np.testing.assert_allclose(means[[4, 6]], 0.25 * 9e-6, rtol=1e-3)
    assert np.abs(means[[1, 2]]).max() < 1e-5 and lattice.ray_count == 432
    assert replicate_seeds(7, 3).shape == (3, 2)


def test_ratios_from_sums():
    """|sum of phasors / count|^2, Marechal's by the rms about the terms; no ray is an error."""
    rng = np.random.default_rng(221)
    x, y = rng.uniform(-1e-3, 1e-3, (2, 60))
    w = 3e-8 * rng.normal(size=60) + 2e-4 * x
    q = x * x + y * y
    none = 0.0 * x
    terms = (none + 1.0, x, y, w, x * x, x * y, y * y, x * w, y * w, w * w, none, none, x * q, y * q, q * q, q * w)
    total = np.array([np.sum(one) for one in terms])
    phasor = np.exp(2j * np.pi / WAVE * w).reshape(4, 15).sum(axis=1)
    for remove in (("piston",), ("piston", "tilt")):
        found = combined(total, phasor, WAVE, remove)
        columns = [np.ones(60)] + ([x, y] if "tilt" in remove else [])
        matrix = np.stack(columns, axis=1)
        rms = np.sqrt(np.mean((w - matrix @ np.linalg.lstsq(matrix, w, rcond=None)[0]) ** 2))
        assert found["opd_rms"] == pytest.approx(rms, rel=1e-6)
        assert found["marechal"] == pytest.approx(np.exp(-((2 * np.pi * rms / WAVE) ** 2)), rel=1e-6)
        assert found["value"] == pytest.approx(abs(np.mean(np.exp(2j * np.pi / WAVE * w))) ** 2, rel=1e-9)
    with pytest.raises(ValueError, match="no ray of the pupil arrived"):
        combined(0.0 * total, phasor, WAVE, ("piston",))
    field = prism()
    size = np.sqrt(2 * 12e-3**2 + 10e-3**2)
    greatest = np.abs(field.samples.samples).max() * size
    assert met_nothing(field, 0.0, WAVE, 0.99 * greatest / WAVE) and not met_nothing(
        field, 0.0, WAVE, 1.01 * greatest / WAVE
    )


def test_the_budget_of_a_ratio():
    """Its error by three standard errors and by the bound of each phase error; all causes are reported."""
    options = {"wavelength": WAVE, "ray_count": 4096, "backend": "reference", "precision": "float64", "bundle": "off"}
    found = estimate_strehl(prism(), Disc(2e-3, (0.0, 0.0, -1e-3)), **options)
    error = found.error
    assert error["sampling"] == pytest.approx(STANDARD_ERRORS * found.standard_error)
    squares = sum(v * v for name, v in error.items() if name != "total")
    assert error["total"] == pytest.approx(np.sqrt(squares), rel=1e-9)
    assert error["truncation"] == pytest.approx(0.0, abs=1e-6) and error["resampling"] == 0.0
    assert found.ray_count == 4096 == found.traced_ray_count and found.blocked == 0.0


def test_counts_and_plans():
    """Rays come in sixteen replicates, rounded up; a plan tells its first rays; what is no count is refused."""
    field, pupil = prism(), Disc(2e-3, (0.0, 0.0, -1e-3))
    options = {"wavelength": WAVE, "backend": "reference", "precision": "float64"}
    assert REPLICATES == 16
    found = estimate_strehl(field, pupil, ray_count=50, **options)
    assert found.ray_count == 64 == found.traced_ray_count
    job = PreparedStrehl(field, pupil, ray_count=50, **options).job
    assert job.plan.method == "adaptive" and job.predicted_ray_count == 64
    assert PreparedStrehl(field, pupil, ray_count=10**6, **options).job.predicted_ray_count == 16 * 144
    assert PreparedStrehl(field, pupil, ray_count=10**6, bundle="off", **options).job.predicted_ray_count == 10**6
    for bad in (15, 16.5, "16"):
        with pytest.raises((ValueError, TypeError)):
            estimate_strehl(field, pupil, ray_count=bad, **options)
    del options["backend"]  # the reference takes a second for each estimate
    prepared = prepare_strehl(field, pupil, ray_count=64, direction=[0.0, 0.01, 1.0], **options)
    assert isinstance(prepared, PreparedStrehl) and prepared.request.look[1] == pytest.approx(
        0.01 / np.hypot(0.01, 1.0)
    )
    one, other = prepared(1), prepared(2)
    assert one.value != other.value and prepared(1).value == one.value
    stronger = prepared.with_field(prism(scale=2e-4))
    assert stronger.field is not field and stronger(1).opd_rms == pytest.approx(2.0 * one.opd_rms, rel=1e-3)
    assert [each.value for each in prepared.for_fields([field, prism()], 1)] == [one.value, one.value]


# --- results of traces -----------------------------------------------------------------------------------------------


def result_of(status, opd=None, weight=None, **more) -> TraceResult:
    plan = TracePlan("adaptive", "warp", "cpu", "float32", 100, None, 1e-3, ())
    count = len(status)
    weight = np.full(count, 1.0 / count) if weight is None else np.asarray(weight)
    return TraceResult(np.array(status), plan, {}, WAVE, weight, opd=opd, **more)


def test_numbers_of_a_result():
    """Rms about the mean over the rays that arrived, by their shares; statuses by name; outputs as bits."""
    rng = np.random.default_rng(222)
    opd, weight = rng.normal(size=6), rng.uniform(1.0, 2.0, 6)
    status = [int(one) for one in (RayStatus.OK, RayStatus.OK, RayStatus.HIT_BODY, RayStatus.TOLERANCE_NOT_MET,
                                   RayStatus.OK, RayStatus.MAX_STEPS)]  # fmt: skip
    result = result_of(status, opd, weight / weight.sum())
    good = [0, 1, 3, 4]
    assert result.ok.tolist() == [True, True, False, True, True, False] and result.ray_count == 6
    mean = np.average(opd[good], weights=weight[good])
    rms = np.sqrt(np.average((opd[good] - mean) ** 2, weights=weight[good]))
    told = result.quantities["opd_rms"]
    assert told.value == pytest.approx(rms, rel=1e-12) and np.isnan(told.error)
    assert result.status_summary() == {"OK": 3, "HIT_BODY": 1, "TOLERANCE_NOT_MET": 1, "MAX_STEPS": 1}
    assert not result.truncation.any() and result.truncation.shape == (6,)
    assert result_of(status).quantities == {} and np.isnan(result_of([status[2]], opd[:1]).quantities["opd_rms"].value)
    names = (
        "position",
        "direction",
        "optical_path",
        "opd",
        "arc_length",
        "step_error",
        "step_count",
        "evaluation_count",
    )
    assert [output_mask(frozenset([name])) for name in names] == [1, 2, 4, 8, 16, 32, 64, 128]
    assert output_mask(frozenset(("opd", "position"))) == 9
    with pytest.raises(ValueError, match="not among the outputs: this result has opd, status"):
        result.on_device("direction")
    assert result.on_device("opd") is opd
