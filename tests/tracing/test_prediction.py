"""What a plan predicts before any ray is traced, against what the trace then took."""

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import trace
from aerokernels.tracing.step_bound import predict_evaluations
from tests.random_fields import mesh_field, uniform_field

from .backends import WAVE


def through(count: int) -> RayBundle:
    """Rays through the whole box, within some 0.1 rad of the axis."""
    rng = np.random.default_rng(1)
    position = np.c_[rng.uniform(-8e-4, 8e-4, (count, 2)), np.full(count, -1e-3)]
    return RayBundle(position, np.c_[rng.normal(0.0, 0.03, (count, 2)), np.ones(count)])


@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone", "bilinear"])
def test_evaluations_under_error_control(interpolation):
    """A prediction along the diagonal of the box, by averages: right within a factor of three."""
    field = mesh_field() if interpolation == "bilinear" else uniform_field("volume", interpolation)
    rays = through(400)
    predicted = predict_evaluations(field, 1e-3 * WAVE, rays.direction)
    found = np.median(trace(field, rays, method="adaptive").evaluation_count)
    assert found / 3.0 < predicted < 3.0 * found


def test_even_samples_keep_what_they_promise():
    """Evaluations are those predicted, but for rays traced again; the error is the pilot's, and a few times it."""
    field, rays = uniform_field("volume", amplitude=1e-4), through(5000)
    result = trace(field, rays)
    plan = result.plan
    assert plan.sample_count == plan.predicted_evaluations == np.median(result.evaluation_count)
    assert 0.0 < plan.predicted_error < plan.tolerance
    exact = trace(field, rays[::20], method="adaptive", tolerance=1e-6, precision="float64")
    error = np.abs(result.opd[::20] - exact.opd).max() / WAVE
    assert error < 4.0 * plan.predicted_error + 1e-5
    reported = plan.as_dict()
    assert reported["predicted_evaluations"] == plan.sample_count
    assert reported["predicted_error"] == plan.predicted_error


def test_a_fixed_step_predicts_its_cost():
    field, rays = uniform_field("volume", amplitude=1e-5), through(100)
    result = trace(field, rays, method="fixed", step=2e-4)
    found = np.median(result.evaluation_count)
    assert found / 3.0 < result.plan.predicted_evaluations < 3.0 * found
    assert result.plan.predicted_error is None
