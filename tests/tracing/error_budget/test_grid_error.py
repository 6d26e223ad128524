"""Does the budget's interpolation error cover the error of grids as coarse as the structure of the air?

Set-up: fields of tests/draws/coarse_draws.py, linear and cubic in every geometry, 120 of 1 to 6 cells a length and 32
of 8 to 20. The truth is the integral of the interpolant minus the formula along the straight line. Richardson's
estimate alone misses 3 and 3 of them: the coarser levels do not see the structure and agree by chance.

Where the samples resolve the field, the estimate of next_order.py is the error itself to a few per cent.
"""

import numpy as np
import pytest

from aerokernels.medium import Body, IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.error_budget.grid_error import greatest, grid_error, spread
from tests.draws.coarse_draws import draw


def plane(length: float) -> Plane:
    return Plane((0.0, 0.0, length), (0.0, 0.0, 1.0))


@pytest.mark.parametrize(("least", "most", "seeds"), [(1.0, 6.0, range(120, 240)), (8.0, 20.0, range(32, 64))])
def test_the_budget_covers_grids_that_barely_resolve_the_field(least, most, seeds):
    missed = []
    for seed in seeds:
        case = draw(seed, least, most)
        result = trace(case.field, case.rays, until=plane(case.length), precision="float64", tolerance=1e-5)
        assert result.ok.all()
        true = np.abs(case.grid_errors()).max()
        if result.error["interpolation"] < true:
            missed.append((seed, case.name, result.error["interpolation"] / true))
    assert not missed


@pytest.mark.parametrize("seed", range(18))
def test_the_estimate_is_the_error_where_the_samples_resolve_the_field(seed):
    """At 12 to 16 cells a length the estimate and its bound are within 20 % of the greatest error, never below 0.97.

    Errors that cancel along all lines, to 1e-8 of contrast times length, are left out.
    """
    case = draw(seed, 12.0, 16.0)
    true = np.abs(case.grid_errors()).max()
    if true < 1e-8 * np.abs(case.field.samples.samples).max() * case.length:
        pytest.skip("the errors cancel along the lines")
    found = grid_error(case.field, case.rays, plane(case.length))
    assert found.shape == (2, case.rays.ray_count)
    assert 0.97 * true <= greatest(found) <= 1.2 * true


def test_no_nodes_are_looked_at_beyond_the_stop_or_inside_a_body():
    """A ray that ends before the rough half of a field, or begins behind it in a body, has no error from it."""
    samples = np.zeros((33, 33))
    samples[:, 4:12] = 1e-5 * np.random.default_rng(1).normal(size=(33, 8))
    profile = np.array([[-2e-3, 2e-3], [2e-3, 2e-3], [2e-3, 20e-3], [-2e-3, 20e-3]])
    grid = {"origin": (-16e-3, 0.0), "spacing": (1e-3, 1e-3), "geometry": "planar", "interpolation": "linear"}
    field = IndexField.from_samples(samples, **grid)
    inside = IndexField.from_samples(samples, body=Body(profile, "planar"), **grid)
    rays = RayBundle(np.array([[0.0, 0.3e-3, 6e-3]]), np.array([[0.0, 0.0, 1.0]]))
    assert greatest(grid_error(field, rays, plane(30e-3))) > 1e-9
    assert greatest(grid_error(inside, rays, plane(30e-3))) < 1e-10
    early = RayBundle(np.array([[0.0, 0.3e-3, 0.0]]), np.array([[0.0, 0.0, 1.0]]))
    assert greatest(grid_error(field, early, plane(1e-4))) < 1e-10


def test_a_bound_of_unknown_sign_spreads_in_full():
    """Standard deviation 1 of the estimates, and a constant bound of 2: a phase error of up to 3."""
    errors = np.array([[1.0, -1.0, 1.0, -1.0], [2.0, 2.0, 2.0, 2.0]])
    assert spread(errors) == pytest.approx(3.0) and greatest(errors) == pytest.approx(3.0)
    assert spread(np.zeros((2, 0))) == 0.0 and greatest(np.zeros((2, 0))) == 0.0
