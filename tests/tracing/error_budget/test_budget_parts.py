"""Parts of error budgets: which rays are traced again and to which stops, what differences mean, how causes add up."""

import dataclasses

import numpy as np
import pytest

from aerokernels import ArcLength, IndexField, Plane, RayBundle
from aerokernels.tracing import RayStatus
from aerokernels.tracing.error_budget import budget
from aerokernels.tracing.error_budget.rays import COMPARED, PLACES, SHARPEST, SUBSET, roughness, subset
from aerokernels.tracing.lines import SIDE, box_span
from aerokernels.tracing.plan import BundleCounts, TracePlan
from tests.random_air import random_air

PLAN = TracePlan("adaptive", "warp", "cpu", "float32", 100, None, 1e-2, ())
OK = int(RayStatus.OK)


def field_of(geometry: str = "volume", interpolation: str = "cubic", seed: int = 131) -> IndexField:
    return random_air(
        geometry, seed, lambda random, shape: 1e-4 * random.normal(size=shape), (9, 8, 10), (-1.0, -1.0, 0.5),
        (0.25, 0.3, 0.4), interpolation=interpolation,
    )  # fmt: skip


def rays_through(count: int = 40) -> RayBundle:
    rng = np.random.default_rng(132)
    return RayBundle(
        np.c_[rng.uniform(-0.8, 0.8, (count, 2)), np.full(count, -1.0)], rng.normal((0, 0, 1), 0.2, (count, 3))
    )


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_roughness_along_rays(geometry: str, interpolation: str):
    """The sum over 192 even places of |fourth| (second) differences about the nearest node, times the length.

    At an end the nearest whole stencil is taken; on the axis the samples are mirrored.
    """
    field, rays = field_of(geometry, interpolation), rays_through()
    grid = field.samples
    found = roughness(field, rays.position, rays.direction)
    span = box_span(field, rays.position, rays.direction)
    weights = [1, -4, 6, -4, 1] if interpolation == "cubic" else [1, -2, 1]
    half = len(weights) // 2
    assert PLACES == 192 and (geometry == "axisymmetric" or (~span.meets).any())
    for row in range(0, 40, 3):
        total, length = 0.0, max(span.leave[row] - span.enter[row], 0.0)
        for k in range(PLACES if span.meets[row] else 0):
            place = rays.position[row] + (span.enter[row] + (k + 0.5) / PLACES * length) * rays.direction[row]
            local = {"volume": place, "planar": place[1:], "axisymmetric": [np.hypot(*place[:2]), place[2]]}[geometry]
            node = [
                int(np.clip(round((x - o) / s), 0, n - 1))
                for x, o, s, n in zip(local, grid.origin, grid.spacing, grid.shape, strict=True)
            ]
            for axis, count in enumerate(grid.shape):
                least = 0 if geometry == "axisymmetric" and axis == 0 else half
                middle = min(max(node[axis], least), count - 1 - half)
                change = 0.0
                for offset, weight in zip(range(-half, half + 1), weights, strict=True):
                    at = list(node)
                    at[axis] = abs(middle + offset)
                    change += weight * grid.samples[tuple(at)]
                total += abs(change)
        assert found[row] == pytest.approx(total * length, rel=1e-9, abs=1e-18)


def test_rays_that_are_traced_again():
    """All of a few; of many 128 evenly spread ones and the 64 in the sharpest air of 4096, all of which arrived."""
    field = field_of()
    few = rays_through(SUBSET)
    np.testing.assert_array_equal(subset(field, few, np.ones(SUBSET, bool)), np.arange(SUBSET))
    rng = np.random.default_rng(133)
    count = 9000
    many = RayBundle(np.c_[rng.uniform(-0.8, 0.8, (count, 2)), np.full(count, -1.0)], [0.0, 0.0, 1.0])
    good = rng.uniform(size=count) < 0.9
    chosen = many.rows(subset(field, many, good))
    arrived = np.flatnonzero(good)

    def even(number):
        return arrived[np.linspace(0, len(arrived) - 1, number).round().astype(int)]

    compared = even(COMPARED)
    strength = roughness(field, many.position[compared], many.direction[compared])
    sharpest = compared[np.argsort(strength, kind="stable")[-SHARPEST:]]
    rows = sorted({*even(SUBSET - SHARPEST).tolist(), *sharpest.tolist()})
    np.testing.assert_array_equal(chosen.position, many.position[rows])


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_stops_at_which_fields_of_two_boxes_are_compared(geometry: str):
    """The given one; without one the planes of the faces by which rays leave, or tangents on a curved side."""
    field, rays = field_of(geometry), rays_through(60)
    until = Plane((0, 0, 9), (0, 0, 1))
    ((rows, stop),) = budget._common_stops(field, rays, until)
    assert stop is until and rows.tolist() == list(range(60))
    span, seen = box_span(field, rays.position, rays.direction), []
    for rows, stop in budget._common_stops(field, rays, None):
        faces = set(span.exit_face[rows].tolist())
        assert len(faces) == 1 and span.meets[rows].all()
        (face,) = faces
        for row in rows:
            end = rays.position[row] + span.leave[row] * rays.direction[row]
            assert abs((end - stop.point) @ stop.normal) < 1e-9
            if face == SIDE:
                np.testing.assert_allclose(stop.normal, end * [1, 1, 0] / np.hypot(*end[:2]), atol=1e-12)
            else:
                np.testing.assert_array_equal(stop.normal, np.eye(3)[face // 2])
        seen += rows.tolist()
        assert face != SIDE or len(rows) == 1
    leaves = np.flatnonzero(span.meets & (span.exit_face >= 0))
    on_side = span.exit_face[leaves] == SIDE
    assert len(seen) == len(set(seen)) == (~on_side).sum() + min(on_side.sum(), budget.SIDE_RAYS)


class Answers:
    """OPD, statuses and own errors by a law of field, precision, tolerance and method, in place of a trace."""

    def __init__(self, arrived):
        self.arrived, self.plans = arrived, []

    def __call__(self, field, rays, plan, until, wavelength):
        self.plans.append((field, plan, until))
        count = rays.ray_count
        opd = np.arange(count) * 1e-6 + (plan.precision == "float32") * 3e-9 + 1e-7 * plan.tolerance
        opd = opd + 5e-8 * (plan.method != "adaptive") + 1e-5 * (field.samples.shape[-1] - 10)
        status = np.where(self.arrived[:count], OK, int(RayStatus.MAX_STEPS))
        return opd, status, np.full(count, 7e-9)


def test_differences_are_what_they_are_named_for():
    """By a law in place of traces: precision float32 less float64, steps float64 less the far tighter tolerance."""
    field, rays = field_of(), rays_through(12)
    arrived = np.arange(12) % 3 > 0
    law = Answers(arrived)
    retrace = budget.Retrace(law, ArcLength(3.0), 1e-6)
    found = budget.opd_errors(field, rays, PLAN, retrace)
    np.testing.assert_allclose(found["precision"], np.full(8, 3e-9), rtol=1e-6)
    np.testing.assert_allclose(found["step"], np.full(8, 1e-7 * (1e-2 - 1e-3 / 64)), rtol=1e-6)
    np.testing.assert_array_equal(found["refractivity"], [0.0])
    tight = law.plans[0][1]
    assert tight.method == "adaptive" and tight.precision == "float64" and tight.tolerance == 1e-3 / 64.0
    assert (
        tight.backend == "warp"
        and tight.max_steps >= PLAN.max_steps
        and all(stop.length == 3.0 for *_, stop in law.plans)
    )
    straight = dataclasses.replace(PLAN, method="straight", precision="float64", tolerance=1e-4)
    found = budget.opd_errors(field, rays, straight, retrace)
    assert not found["precision"].any()
    np.testing.assert_allclose(found["step"], np.full(8, 5e-8 + 1e-7 * (1e-4 - 1e-4 / 64)), rtol=1e-6)
    by_reference = dataclasses.replace(PLAN, backend="reference", precision="float64")
    found = budget.opd_errors(field, rays, by_reference, retrace)
    assert found["step"].tolist() == [7e-9] * 8 and found["precision"].tolist() == [0.0]
    found = budget.opd_errors(field, rays, dataclasses.replace(by_reference, method="straight"), retrace)
    np.testing.assert_allclose(found["step"], np.full(8, 5e-8 + 1e-7 * (1e-2 - 1e-3 / 64)), rtol=1e-6)
    linear = budget._tight(field_of(interpolation="linear"), PLAN)
    assert linear.tolerance == 1e-3 / 8.0 and linear.sample_count == 0 and linear.step is None


def test_a_resampled_field_is_compared_with_its_source():
    """The change of the path between both, at the same stop, and the source's own interpolation error."""
    source = field_of()
    field, rays = source.resample(0.4), rays_through(12)
    law = Answers(np.ones(12, bool))
    retrace = budget.Retrace(law, ArcLength(3.0), 1e-6)
    found = budget.opd_errors(field, rays, PLAN, retrace)
    change = 1e-5 * (field.samples.shape[-1] - source.samples.shape[-1])
    np.testing.assert_allclose(found["resampling"], np.full(12, change), rtol=1e-6, atol=1e-18)
    assert any(one is source for one, *_ in law.plans) and len(found["interpolation"]) == 12
    lost = dataclasses.replace(field, resampling=dataclasses.replace(field.resampling, source=None))
    found = budget.opd_errors(lost, rays, PLAN, retrace)
    assert len(found["resampling"]) == len(found["interpolation"]) == 0


def test_causes_are_added_up():
    """Three times the greatest of each, bundle and loss as they are, roundings on top; root of squares, no models."""
    field, rays = field_of(), rays_through(12)
    law = Answers(np.ones(12, bool))
    retrace = budget.Retrace(law, ArcLength(3.0), 1e-6)
    plan = dataclasses.replace(PLAN, bundle=BundleCounts(9, 8, 7, 4e-7))
    lost = np.linspace(0.0, 2e-6, 12)
    found = budget.error_budget(field, rays, np.ones(12, bool), plan, retrace, lost)
    rounding = budget.float64_rounding(field, rays)
    sizes = np.abs(np.concatenate([rays.position.ravel(), *field.box]))
    assert rounding == pytest.approx(4.0 * np.finfo(float).eps * sizes.max(), rel=1e-12, abs=0.0)
    assert found["step"] == pytest.approx(3.0 * 1e-7 * (1e-2 - 1e-3 / 64), rel=1e-6)
    assert found["precision"] == pytest.approx(3.0 * 3e-9 + rounding, rel=1e-6)
    assert found["bundle"] == 4e-7 and found["sampling"] == 0.0 == found["refractivity"]
    assert found["truncation"] == 2e-6 and found["resampling"] == 0.0
    squares = sum(v * v for name, v in found.items() if name not in ("total", "refractivity"))
    assert found["total"] == pytest.approx(np.sqrt(squares), rel=1e-12)
    parts = budget.combine({"step": 3.0, "precision": 4.0, "refractivity": 9.0})
    assert parts["total"] == 5.0 and parts["refractivity"] == 9.0 and parts["bundle"] == 0.0
    none = budget.error_budget(field, rays, np.zeros(12, bool), plan, retrace, lost)
    assert all(np.isnan(value) for value in none.values()) and set(none) == {*budget.CAUSES, "total"}
    assert np.isnan(budget._greatest(np.zeros(0))) and budget._greatest(np.array([1.0, -3.0])) == 3.0
    assert budget.column_error(field) == 0.0
